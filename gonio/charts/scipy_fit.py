"""A fit without gonio: SciPy's bounded least squares on a NumPy model of Lambert + GGX."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.models.geometry.directions import Direction

START, LOW, HIGH = np.array([0.5, 0.5, 0.3]), np.array([0.0, 0.0, 1e-3]), np.array([1.0, 5.0, 1.0])


class Cosines(NamedTuple):
    """Cosines of light, detector and half vector with the normal, shapes (n,)."""

    i: np.ndarray
    o: np.ndarray
    h: np.ndarray


def cosines(wi: Direction, wo: Direction) -> Cosines:
    """The cosines that the model needs, of directions with components (n,)."""
    total = [np.asarray(a) + np.asarray(b) for a, b in zip(wi, wo, strict=True)]
    return Cosines(np.asarray(wi.z), np.asarray(wo.z), total[2] / np.sqrt(sum(c * c for c in total)))


def lambert_ggx(x: np.ndarray, c: Cosines) -> np.ndarray:
    """f, 1/sr, of (rho, scale, alpha): ρ/π + s·D·G/(4 cosθi cosθo) with F = 1 [Walter 2007, Heitz 2014]."""
    rho, scale, alpha = x
    a2 = alpha * alpha
    density = a2 / (np.pi * (c.h**2 * (a2 - 1) + 1) ** 2)
    shadow = c.o * np.sqrt(a2 + (1 - a2) * c.i**2) + c.i * np.sqrt(a2 + (1 - a2) * c.o**2)
    return rho / np.pi + scale * density * 0.5 / shadow


COMPARED: dict[str, Callable[[np.ndarray, Cosines, np.ndarray], np.ndarray]] = {
    "sigma": lambda v, c, u: v / u,
    "linear": lambda v, c, u: v,
    "cbrt": lambda v, c, u: np.cbrt(v * c.i),
    "log1p": lambda v, c, u: np.sign(v) * np.log1p(np.abs(v)),
}


def scipy_fit(c: Cosines, y: np.ndarray, u: np.ndarray, loss: str) -> np.ndarray:
    """(rho, scale, alpha) from one start, with slopes by differences; readings y and their uncertainties u, (n,)."""
    from scipy.optimize import least_squares

    compared = COMPARED[loss]
    target = compared(y, c, u)
    solution = least_squares(
        lambda x: compared(lambert_ggx(x, c), c, u) - target, START, bounds=(LOW, HIGH), x_scale="jac", method="trf"
    )
    return solution.x
