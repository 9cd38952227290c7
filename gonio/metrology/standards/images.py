"""How sharply a surface mirrors: haze, distinctness of image and contrast gloss, as goniometric approximations.

The instruments of these standards have lamps and lenses of their own; here f is averaged over slits of their angles for
collimated light, and the ratio of two such averages taken.
"""

import math

import numpy as np

from gonio.metrology.standards.apertures import joined, mirror, pairs, ray, rectangle
from gonio.metrology.standards.reflectance import single
from gonio.metrology.standards.standard import Aperture, StandardQuantity

INCIDENCE = 30.0
SLIT, HAZE_SLIT, SPECULAR_SLIT = (0.14, 1.0), (0.4, 1.0), (1.0, 1.0)
"""Angles of the receptors, degrees, in the plane of incidence and across it."""
ORDERS = (6, 4)
APPROXIMATE = "goniometric approximation"


def images() -> list[StandardQuantity]:
    """Reflection haze 2° and 5° off, distinctness of image, contrast gloss."""
    centre, standard = slit(INCIDENCE, 0.0, SLIT), f"after ASTM E430 ({APPROXIMATE})"
    light, narrow = f"light collimated at {INCIDENCE:g}°", f"{SLIT[0]}° × {SLIT[1]:g}°"
    haze = f"{light}; mean f of {HAZE_SLIT[0]}° × {HAZE_SLIT[1]:g}°, ±{{}}° off, over that of {narrow} in the mirror"
    made = [
        StandardQuantity(
            f"haze {off}°", standard, f"{haze.format(off)} direction", "gloss",
            (slit(INCIDENCE, off, HAZE_SLIT), centre), lambda v: 100 * _quotient(v), least=1.0, unit="%",
        )
        for off in (2, 5)
    ]  # fmt: skip
    made.append(
        StandardQuantity(
            "distinctness of image", standard, f"{light}; 1 less the mean f of {narrow} 0.3° off over that in the "
            "mirror direction", "gloss", (slit(INCIDENCE, 0.3, SLIT), centre), lambda v: 100 * (1 - _quotient(v)),
            least=1.0, unit="%",
        )
    )  # fmt: skip
    mirrored = slit(45.0, 0.0, SPECULAR_SLIT)
    made.append(
        StandardQuantity(
            "contrast gloss", f"after Hunter 1937 ({APPROXIMATE})",
            "mean f of 1° × 1° at 45°:45° over f at 45°:0°", "gloss", (mirrored, single(45.0, 0.0, 0.0)), _quotient,
        )
    )  # fmt: skip
    return made


def _quotient(values: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return values[0] / values[1]


def slit(incidence: float, off: float, size: tuple[float, float]) -> Aperture:
    """Mean f over a slit for collimated light; angles in degrees; off the mirror direction the mean of both sides."""
    angle, solid, rules = math.radians(incidence), 1.0, []
    light = ray(angle)
    image = mirror(light.directions)
    towards = image._replace(**{k: v[0] for k, v in image._asdict().items()})
    for order in ORDERS:
        parts = []
        for sign in (1, -1) if off else (0,):
            axis = mirror(ray(angle + sign * math.radians(off)).directions)
            beam = rectangle(axis, (math.radians(size[0]), math.radians(size[1])), order, towards)
            parts.append(pairs(light, np.ones(1), beam, beam.projected))
        total = joined(parts)
        solid = float(total.weight.sum())
        rules.append(total._replace(weight=total.weight / solid))
    return Aperture(*rules, images=() if off else ((angle, 1 / solid),), mirror=not off, moves=True)
