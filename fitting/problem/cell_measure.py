"""How much of the pairs of directions each cell of a grid stands for."""

import numpy as np

from gonio.data.layouts import Layout
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
    cells = layout.solid_angles(wi, wo)
    if cells is None:
        raise GonioError("Scattered samples have no cells to weigh by solid angle; leave --weight out for this table.")
    return cells * cosines if weight == "projected-solid-angle" else cells
