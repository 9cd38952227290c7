"""Total integrated scatter and scatter in angular bands, of light at normal incidence."""

import itertools

import numpy as np

from gonio.metrology.standards.apertures import ray
from gonio.metrology.standards.reflectance import around
from gonio.metrology.standards.standard import StandardQuantity

CONE = 2.5
"""Degrees about the mirror direction within which light is not scattered [ASTM F1048]."""
BANDS = (CONE, 5.0, 15.0, 45.0, 85.0, 90.0)


def scatter(behind: bool) -> list[StandardQuantity]:
    """Scatter outside a cone over all light, and the share of the light in bands, in front or behind the sample."""
    light = ray(0.0)
    inside = around(light, 0.0, CONE, behind)
    rings = tuple(around(light, a, b, behind) for a, b in itertools.pairwise(BANDS))
    where, side = ("straight through", " behind") if behind else ("the mirror direction", "")
    made = [
        StandardQuantity(
            f"total integrated scatter{side}", "ASTM F1048, SEMI MF1048",
            f"light at 0°; what leaves {CONE:g}° to 90° from {where}, over all that leaves on that side", "scatter",
            (inside, *rings), _share_outside,
        ),
        StandardQuantity(
            f"total scattering{side}", "ISO 13696", f"light at 0°; what leaves {CONE:g}° to 85° from {where}",
            "scatter", rings[:-1], lambda v: np.sum(v, axis=0),
        ),
    ]  # fmt: skip
    made += [
        StandardQuantity(
            f"scatter{side}", "angular band", f"light at 0°; what leaves {a:g}° to {b:g}° from {where}", "scatter",
            (band,), place=f"{a:g}° to {b:g}°",
        )
        for a, b, band in zip(BANDS[:-1], BANDS[1:], rings, strict=True)
    ]  # fmt: skip
    return made


def _share_outside(values: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sum(values[1:], axis=0) / np.sum(values, axis=0)
