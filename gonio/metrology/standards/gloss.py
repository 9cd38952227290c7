"""Specular gloss [ISO 2813:2014, ASTM D523]: the source's image and the receptor integrated, black glass as 100."""

import functools
import math

import numpy as np

from gonio.metrology.standards.apertures import Rule, joined, mirror, pairs, ray, rectangle
from gonio.metrology.standards.standard import Aperture, StandardQuantity
from gonio.models.geometry.directions import Direction

SOURCE = (0.75, 2.5)
"""Angles of the source's image, degrees: in the plane of incidence, across it."""
RECEPTORS = {20: (1.8, 3.6), 60: (4.4, 11.7), 85: (4.0, 6.0)}
"""Likewise of the receptor at each angle."""
GLASS = 1.567
"""Refractive index of the black glass that has 100 gloss units at each angle."""
ORDERS = ((3, 6), (2, 4))
"""Nodes along each side of the source, and of each panel of the receptor; the rougher rule bounds the error."""


def fresnel_of_glass(cosine: np.ndarray) -> np.ndarray:
    """Unpolarised reflectance of a plane dielectric of index `GLASS`."""
    inside = np.sqrt(GLASS**2 - 1 + cosine**2)
    s = (cosine - inside) / (cosine + inside)
    p = (GLASS**2 * cosine - inside) / (GLASS**2 * cosine + inside)
    return (s**2 + p**2) / 2


def gloss() -> list[StandardQuantity]:
    """Specular gloss at 20°, 60° and 85°."""
    return list(_gloss())


@functools.cache
def _gloss() -> tuple[StandardQuantity, ...]:
    # Kept: a page asks for quantities twice, and their apertures are the same for every subject.
    made = []
    for angle, size in RECEPTORS.items():
        (fine, glass, images), (coarse, *_) = (_flux(math.radians(angle), size, *orders) for orders in ORDERS)
        scaled = tuple((theta, 100 * w / glass) for theta, w in images)
        integral = Aperture(_times(fine, 100 / glass), _times(coarse, 100 / glass), scaled, True)
        geometry = (
            f"{angle}°: source {SOURCE[0]}° × {SOURCE[1]}°, receptor {size[0]}° × {size[1]}°; n = {GLASS} mirrors 100"
        )
        made.append(
            StandardQuantity(
                f"gloss {angle}°", "ISO 2813, ASTM D523", geometry, "gloss", (integral,), least=1.0, unit="GU"
            )
        )
    return tuple(made)


def _flux(
    angle: float, size: tuple[float, float], source_order: int, order: int
) -> tuple[Rule, float, list[tuple[float, float]]]:
    """What the receptor gets of a source of even radiance, what of black glass, and weights of mirrored images."""
    axis = ray(angle).directions
    source = rectangle(axis, tuple(np.radians(SOURCE)), source_order)
    share = source.solid_angle / source.solid_angle.sum()
    rules, images = [], []
    for k, w in enumerate(share):
        wi = Direction(*(c[k : k + 1] for c in source.directions))
        image = mirror(wi)
        towards = Direction(*(c[0] for c in image))
        receptor = rectangle(mirror(axis), tuple(np.radians(size)), order, towards)
        single = ray(0.0)._replace(directions=wi)
        rules.append(pairs(single, np.array([w]), receptor, receptor.projected))
        images.append((math.acos(float(wi.z[0])), float(w)))
    glass = float(np.sum(share * fresnel_of_glass(source.directions.z)))
    return joined(rules), glass, images


def _times(rule: Rule, factor: float) -> Rule:
    return rule._replace(weight=rule.weight * factor)
