"""Angles that users give: plain numbers or arrays of any broadcastable shape, radians or degrees."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gonio.models.errors import GonioError

MOST_TURNS = 2
"""Whole turns of an azimuth, either way; more are taken for degrees."""
SLACK = 5e-7
"""Radians by which rounding, of single precision too, may carry an angle over its limit."""


def radian_arrays(degrees: bool, lower: bool = False, **angles: ArrayLike) -> list[np.ndarray]:
    """The angles as float64 arrays of one shape, radians.

    Args:
        degrees: whether the numbers given are degrees.
        lower: whether directions may lie behind the sample, polar angles up to π.
        angles: polar angles by names that begin with "theta", azimuths by others.

    Raises:
        GonioError: what is no number, not finite, out of range (degrees given as radians, say), or does not broadcast.
    """
    arrays = {}
    for name, angle in angles.items():
        values = as_numbers(name, angle)
        polar = name.startswith("theta")
        high = (math.pi if lower else math.pi / 2) if polar else MOST_TURNS * 2 * math.pi
        low = 0.0 if polar else -high
        radians = np.radians(values) if degrees else values
        outside = ~((radians >= low - SLACK) & (radians <= high + SLACK))
        if outside.any():
            domain = f"{math.degrees(low):g} to {math.degrees(high):g} degrees"
            unit = "degrees" if degrees else "radians"
            remedy = "give angles in there" if degrees else "give radians in there, or pass degrees=True"
            raise GonioError(f"{name} has the angle {values[outside].flat[0]:g} {unit}, outside {domain}; {remedy}")
        rounded = radians.size and (radians.min() < low or radians.max() > high)
        arrays[name] = np.clip(radians, low, high) if rounded else radians
    return broadcast(**arrays)


def as_numbers(name: str, values: ArrayLike) -> np.ndarray:
    """Values as a float64 array, NaN where a mask hides them. Raises GonioError for what is none."""
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biuf":
            raise TypeError
        numbers = array.astype(np.float64)
        return np.where(np.ma.getmaskarray(values), np.nan, numbers) if np.ma.isMaskedArray(values) else numbers
    except (TypeError, ValueError):
        if type(values).__module__.startswith("jax"):
            raise GonioError(
                f"{name} is traced by JAX, which can follow no NumPy array; inside jit, grad or vmap call "
                "material.brdf.f with two of gonio.models.geometry.directions.Direction"
            ) from None
        raise GonioError(f"{name} is no array of numbers; give numbers, or lists of one shape") from None


def broadcast(**arrays: np.ndarray) -> list[np.ndarray]:
    """The arrays in one shape. Raises GonioError, with the shapes, where they have none in common."""
    try:
        return list(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        shapes: dict[str, Any] = {name: array.shape for name, array in arrays.items()}
        text = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise GonioError(f"the shapes do not broadcast: {text}; give arrays of one shape, or numbers") from None
