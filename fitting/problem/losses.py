"""Losses: how model and reading are compared, depending on what is known of the noise.

Each residual is w·(T(f c) − T(y c)), where c is cosθi or 1 and w the weight of the reading:

- `sigma`: T(v) = v, c = 1, w = 1/u: the likelihood of the noise, where the standard uncertainty u is known;
- `linear`: the same with w = 1;
- `cbrt`: T(v) = v/(v² + ε²)^⅓, c = cosθi: the cube root [Löw et al. 2012, as BRDF-space weighting by compression],
  signed, and linear within the floor ε, which removes its pole at 0;
- `log`: T(v) = sign(v) log(1 + |v|/ε), c = cosθi [Löw et al. 2012, eq. 17, where ε = 1];
- `log1p`: the same with c = 1 and ε = 1, as others publish it.

The floor ε is the noise where the table knows it (see `weights.loss_floor`).
"""

from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

LOSSES = ("sigma", "linear", "cbrt", "log", "log1p")
_GUESS = 6142909891733356544.0  # of the bits: (4/3) · 1023 · 2⁵², less what halves the worst error of the first guess


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
