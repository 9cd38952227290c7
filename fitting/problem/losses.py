"""Losses: what is subtracted from what, by what is known of the noise.

Each residual is w·(T(f c) − T(y c)), where c is cosθi or 1 and w the weight of the cell:

- `sigma`: T(v) = v, c = 1, w = 1/u: the noise's own likelihood, where the standard uncertainty u is known;
- `linear`: the same with w = 1;
- `cbrt`: T(v) = v/(v² + ε²)^⅓, c = cosθi: the cube root [Löw et al. 2012, as BRDF-space weighting by compression],
  signed, and linear within the floor ε, which takes its pole at 0 away;
- `log`: T(v) = sign(v) log(1 + |v|/ε), c = cosθi [Löw et al. 2012, eq. 17, where ε = 1];
- `log1p`: the same with c = 1 and always ε = 1, as others publish it.

The floor ε is the noise where the table knows it (see `loss_floor`): below it a reading tells nothing.
"""

import jax.numpy as jnp
import numpy as np

from gonio.fitting.problem.cube_root import inverse_cube_root

LOSSES = ("sigma", "linear", "cbrt", "log", "log1p")


def uses_cosine(loss: str) -> bool:
    """Whether the loss compares f cosθi rather than f."""
    return loss in ("cbrt", "log")


def transform(loss: str, v, floor, xp=jnp):
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
