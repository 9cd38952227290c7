"""Directions into which tilted facets mirror or refract light, and how densely; NumPy, any shape."""

import math

import numpy as np

from gonio.models.geometry.directions import Direction

MIN_TILT = 1e-3  # radians, of the facets that views of highlights begin with


def facet_direction(wi: Direction, facet: Direction, bend: float = 1.0) -> Direction:
    """Where a facet sends light, mirrored into the front hemisphere where it goes through; NaN in total reflection.

    Args:
        wi: to the light, z > 0, mirrored where it is behind.
        facet: its normal, z > 0.
        bend: index of the light's medium over that of the other one, of what is refracted. 1 is what is mirrored, and
            what goes straight through: its mirror image.
    """
    cos = sum(a * b for a, b in zip(wi, facet, strict=True))
    if bend == 1.0:
        return Direction(*(2 * cos * m - w for w, m in zip(wi, facet, strict=True)))
    with np.errstate(invalid="ignore"):
        along = bend * cos - np.sqrt(1 + bend**2 * (cos**2 - 1))
    x, y, z = (along * m - bend * w for w, m in zip(wi, facet, strict=True))
    return Direction(x, y, -z)


def facet_density(wi: Direction, wo: Direction, bend: float = 1.0) -> np.ndarray:
    """Density, 1/sr, of wo as `facet_direction` of facets whose tilt is even in its logarithm, from `MIN_TILT` on."""
    through = bend != 1.0
    beyond = wo._replace(z=-wo.z) if through else wo
    # Of an interface the facet's normal is on the side of the light, and the light leaves on the other one.
    up = -1.0 if bend < 1.0 else 1.0
    h = Direction(*(up * (bend * a + b) for a, b in zip(wi, beyond, strict=True)))
    i_h, o_h = (sum(a * b for a, b in zip(w, h, strict=True)) for w in (wi, beyond))
    length = np.maximum(np.sqrt(sum(c * c for c in h)), 1e-9)
    sine = np.hypot(h.x, h.y) / length
    tilt = np.maximum(np.arctan2(sine, h.z / length), MIN_TILT)
    per_facet = 1.0 / (2 * math.pi * np.sin(tilt) * tilt * math.log(math.pi / 2 / MIN_TILT))
    facing = (h.z > 0) & (i_h > 0) & (o_h < 0) if through else h.z > 0
    jacobian = np.abs(o_h) / length**3 if through else 1.0 / (2.0 * length)
    return np.where((sine >= np.sin(MIN_TILT)) & facing, per_facet * jacobian, 0.0)
