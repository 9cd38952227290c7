"""Losses: how model and reading are compared, depending on what is known of the noise; weights of the residuals.

Each residual is w·(T(f c) − T(y c)), where c is cosθi or 1 and w the weight of the reading:

- `sigma`: T(v) = v, c = 1, w = 1/u: the likelihood of the noise, where the standard uncertainty u is known;
- `linear`: the same with w = 1;
- `cbrt`: T(v) = v/(v² + ε²)^⅓, c = cosθi: the cube root [Löw et al. 2012, as BRDF-space weighting by compression],
  signed, and linear within the floor ε, which removes its pole at 0;
- `log`: T(v) = sign(v) log(1 + |v|/ε), c = cosθi [Löw et al. 2012, eq. 17, where ε = 1];
- `log1p`: the same with c = 1 and ε = 1, as others publish it.

The floor ε is the noise where the table knows it (see `loss_floor`).
"""

from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from gonio.data.layouts import Layout
from gonio.fitting.problem.readings import Readings
from gonio.models.errors import GonioError, nearest
from gonio.models.geometry.directions import Direction

LOSSES = ("sigma", "linear", "cbrt", "log", "log1p")
_GUESS = 6142909891733356544.0  # of the bits: (4/3) · 1023 · 2⁵², less what halves the worst error of the first guess
WEIGHTS = ("solid-angle", "cosine", "projected-solid-angle")
NO_UNCERTAINTY = "The loss 'sigma' needs standard uncertainties above 0, and this table has none; choose another loss."


def uses_cosine(loss: str) -> bool:
    """Whether the loss compares f cosθi rather than f."""
    return loss in ("cbrt", "log")


def transform(loss: str, v: Any, floor: Any, xp: ModuleType = jnp) -> tuple[Any, Any]:
    """(T(v), T'(v)) of a loss; shapes of v."""
    if loss == "cbrt":
        s = v * v + floor * floor
        inverse = 1.0 / np.cbrt(s) if xp is np else inverse_cube_root(s)
        return v * inverse, (1.0 - (2.0 / 3.0) * (v * v / s)) * inverse
    if loss in ("log", "log1p"):
        unit = floor if loss == "log" else 1.0
        size = xp.abs(v)
        return xp.sign(v) * xp.log1p(size / unit), 1.0 / (unit + size)
    return v, xp.ones_like(v)


def floor_of(loss: str, compared: np.ndarray) -> float:
    """The floor of a loss: a hundredth of the median size of what is compared (1 where the loss has none)."""
    if loss != "cbrt" or not compared.size:
        return 1.0
    typical = float(np.median(np.abs(compared), overwrite_input=True))
    if typical == 0.0:
        typical = float(np.max(np.abs(compared)))
    return 0.01 * typical if typical > 0 else 1.0


def inverse_cube_root(s: Any) -> Array:
    """s^(−1/3) for normal s > 0, any shape; to 2e-16 in double precision.

    A first guess within 4 % from the exponent [Kahan 1991], then two steps of fifth order for 1 − s y³ = 0: vectorised,
    and fourteen times as fast as `jnp.cbrt` (libm, one number at a time), which serves other precisions.
    """
    s = jnp.asarray(s)
    if s.dtype != jnp.float64:
        return 1.0 / jnp.cbrt(s)
    bits = jax.lax.bitcast_convert_type(jax.lax.stop_gradient(s), jnp.int64).astype(s.dtype)
    y = jax.lax.bitcast_convert_type((_GUESS - bits / 3.0).astype(jnp.int64), s.dtype)
    for _ in range(2):
        e = 1.0 - s * y * y * y
        y = y + y * (e * (1 / 3 + e * (2 / 9 + e * (14 / 81 + e * (35 / 243)))))
    return y


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
