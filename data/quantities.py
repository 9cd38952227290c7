"""What the values of a file of readings may be besides the BRDF, and how they become it."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.models.errors import GonioError, nearest


class StoredQuantity(NamedTuple):
    """A quantity that files store in place of the BRDF f."""

    meaning: str
    per_f: Callable[[np.ndarray, np.ndarray], np.ndarray | float]
    """Stored value over f, by cos theta_i and cos theta_o."""


QUANTITIES = {
    "brdf": StoredQuantity("f, 1/sr, without the cosine", lambda cos_i, cos_o: 1.0),
    "brdf_cos": StoredQuantity("f cos(theta_o), 1/sr", lambda cos_i, cos_o: cos_o),
    "brdf_cos_i": StoredQuantity("f cos(theta_i), 1/sr", lambda cos_i, cos_o: cos_i),
    "reflectance_factor": StoredQuantity("π f, relative to a perfect diffuser", lambda cos_i, cos_o: math.pi),
    "i_over_f": StoredQuantity("π f cos(theta_i), I/F", lambda cos_i, cos_o: math.pi * cos_i),
}


def brdf_of(values: np.ndarray, quantity: str, cos_i: np.ndarray, cos_o: np.ndarray) -> np.ndarray:
    """The BRDF, 1/sr, of stored values.

    Args:
        values: of shape (n, channels), of `quantity`.
        quantity: a key of `QUANTITIES`.
        cos_i, cos_o: cosines of the polar angles, (n,); readings at the horizon are returned as they are.

    Raises:
        GonioError: an unknown quantity.
    """
    if quantity not in QUANTITIES:
        raise GonioError(f"quantity {quantity!r} is unknown; {nearest(quantity, QUANTITIES)}")
    factor = np.broadcast_to(QUANTITIES[quantity].per_f(cos_i, cos_o), cos_i.shape)
    return values / np.where(factor > 0, factor, 1.0)[:, None]
