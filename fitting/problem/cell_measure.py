"""How much of the pairs of directions each cell of a grid stands for."""

import numpy as np

from gonio.data.layout import Layout
from gonio.models.errors import GonioError, nearest
from gonio.models.geometry.directions import Direction

WEIGHTS = ("solid-angle", "cosine", "projected-solid-angle")


def measure_of(weight: str, layout: Layout, wi: Direction, wo: Direction) -> np.ndarray:
    """Weights (n,) of the squared residuals at these directions, up to a factor.

    `solid-angle`: dωi dωo of the cells; `cosine`: cosθi cosθo; `projected-solid-angle`: their product, so that what
    counts is reflected power. GonioError for another name, and where scattered samples have no cells.
    """
    if weight not in WEIGHTS:
        raise GonioError(f"Unknown weight '{weight}'; {nearest(weight, WEIGHTS)}")
    cosines = np.asarray(wi.z) * np.asarray(wo.z)
    if weight == "cosine":
        return cosines
    cells = pair_measure(layout, wi, wo)
    return cells * cosines if weight == "projected-solid-angle" else cells


def _spacing(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return np.interp(angle, axis, np.gradient(axis)) if axis.size > 1 else np.ones_like(angle)


def _polar(w: Direction) -> np.ndarray:
    return np.arctan2(np.hypot(w.x, w.y), w.z)


def pair_measure(layout: Layout, wi: Direction, wo: Direction) -> np.ndarray:
    """dωi dωo of the cells at these directions (n,), up to a factor; the rim of a grid counts half a step outwards.

    In half/difference coordinates dωi dωo = 4 cosθd dωh dωd [Walter 2007, eq. 14]. GonioError for scattered samples,
    which have no cells.
    """
    axes = layout.axes
    if layout.name == "scattered":
        raise GonioError("Scattered samples have no cells to weigh by solid angle; leave --weight out for this table.")
    if layout.name == "half_difference":
        plus, minus = ([a + s * b for a, b in zip(wi, wo, strict=True)] for s in (1, -1))
        theta_h = _polar(Direction(*plus))
        theta_d = np.arctan2(*(np.sqrt(sum(c * c for c in v)) for v in (minus, plus)))
        h = np.maximum(np.sin(theta_h), np.sin(axes["theta_h"][1:2] / 2).sum()) * _spacing(axes["theta_h"], theta_h)
        d = np.maximum(np.sin(theta_d), np.sin(axes["theta_d"][1:2] / 2).sum()) * np.cos(theta_d)
        return h * d * _spacing(axes["theta_d"], theta_d)
    theta_i, theta_o = _polar(wi), _polar(wo)
    sizes = []
    for name, theta in (("theta_i", theta_i), ("theta_o", theta_o)):
        axis = np.unique(np.abs(axes[name]))
        # A node at the pole stands for the cap around it, not for nothing.
        least = np.sin(axis[1] / 4) if axis.size > 1 and axis[0] == 0 else 0.0
        sizes.append(np.maximum(np.sin(theta), least) * _spacing(axis, theta))
    return sizes[0] * sizes[1]
