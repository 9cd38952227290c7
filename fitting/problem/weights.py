"""Weights of the residuals: standard uncertainties, solid angles of the cells, and the floor of a loss."""

import numpy as np

from gonio.data.layouts import Layout
from gonio.fitting.problem.losses import floor_of, uses_cosine
from gonio.fitting.problem.readings import Readings
from gonio.models.errors import GonioError, nearest
from gonio.models.geometry.directions import Direction

WEIGHTS = ("solid-angle", "cosine", "projected-solid-angle")
NO_UNCERTAINTY = "The loss 'sigma' needs standard uncertainties above 0, and this table has none; choose another loss."


def sigma_of(readings: Readings) -> np.ndarray | None:
    """The standard uncertainties to weight with (n, C), or None where none is known.

    Unknown (NaN) and exact (0) cells among known ones get the median: they then weigh as an ordinary cell.
    """
    known = readings.valid & np.isfinite(readings.u_f) & (readings.u_f > 0)
    if not known.any():
        return None
    return np.where(known, readings.u_f, np.median(readings.u_f[known]))


def relative_sigma(readings: Readings, f: np.ndarray, share: float) -> np.ndarray:
    """Standard uncertainties (n, C) that are a share of |f| (n, C), with a floor of 1e-6 of its median."""
    typical = np.median(np.abs(f[readings.valid]))
    return share * np.maximum(np.abs(f), 1e-6 * typical if typical > 0 else 1.0)


def residual_weights(readings: Readings, loss: str, sigma: np.ndarray | None) -> np.ndarray:
    """Weight of each residual (n, C): 0 where there is no reading, 1/σ with the loss `sigma`, times √cell_weight."""
    weight = np.where(readings.valid, 1.0, 0.0)
    if loss == "sigma":
        if sigma is None:
            raise GonioError(NO_UNCERTAINTY)
        weight = weight / np.where(readings.valid, sigma, 1.0)
    if readings.cell_weight is not None:
        share = readings.cell_weight / np.mean(readings.cell_weight)
        weight = weight * np.sqrt(share)[:, None]
    return weight


def loss_floor(readings: Readings, loss: str) -> float:
    """The floor ε of a loss, in the units of what it compares.

    The median standard uncertainty of the readings (times cosθi where the loss has it) for `cbrt` and `log`; without
    one, a hundredth of the median reading for `cbrt`, and 1 for the others.
    """
    cosine = np.asarray(readings.wi.z)[:, None] if uses_cosine(loss) else 1.0
    sigma = sigma_of(readings) if uses_cosine(loss) else None
    if sigma is not None:
        return float(np.median((sigma * cosine)[readings.valid]))
    if loss != "cbrt":
        return floor_of(loss, readings.f)
    compared = readings.f * cosine
    return floor_of(loss, compared if readings.valid.all() else compared[readings.valid])


def cell_weights(weight: str, layout: Layout, wi: Direction, wo: Direction) -> np.ndarray:
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
