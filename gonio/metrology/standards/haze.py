"""Haze of what a material transmits at normal incidence: by angle, and as an integrating sphere reads it."""

import numpy as np

from gonio.metrology.standards.apertures import graded, pairs, ray, turned_about
from gonio.metrology.standards.standard import Aperture, Hemisphere, StandardQuantity
from gonio.models.geometry.directions import Direction

DEVIATED = np.radians(2.5)
"""Light that is deviated by more than this is haze [ASTM D1003]."""
PORT, BEAM = np.radians(4.0), np.radians(2.7)
"""Half-angles, seen from the entrance of the sphere, of its exit port and of the beam that reaches it without a sample:
the port subtends 8° and leaves a ring of 1.3° about the beam [ASTM D1003, clause 5]."""
ORDERS = ((18, 32), (12, 24))


def haze() -> list[StandardQuantity]:
    """Haze by angle and of a sphere.

    In a sphere a ray of the beam goes to a point of the disc that the beam fills at the port; a deviation moves it, and
    what still meets the port is lost: of deviations below 1.3° all, beyond 6.7° none.
    """
    whole = Hemisphere(0.0, behind=True)
    cut, lens = _straight([DEVIATED]), _straight([PORT - BEAM, PORT, PORT + BEAM])
    geometry = "light at 0°; share of what is transmitted that "
    return [
        StandardQuantity(
            "haze beyond 2.5°", "ASTM D1003, by angle", f"{geometry}is deviated by more than 2.5°", "transmission",
            (cut, whole), _missed, least=0.01, place="θi 0°",
        ),
        StandardQuantity(
            "haze of a sphere", "ASTM D1003", f"{geometry}misses a port of 8° for a beam of 5.4°", "transmission",
            (lens, whole), _missed, least=0.01, place="θi 0°",
        ),
    ]  # fmt: skip


def _missed(values: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1 - values[0] / values[1]


def _straight(edges: list[float]) -> Aperture:
    """∫ f_t |cosθ| kept(θ) dω about the direction straight through, by panels that shrink towards it."""
    light, rules = ray(0.0), []
    for order, turns in ORDERS:
        panels = np.concatenate([graded(edges[0]), edges[1:]])
        beam = turned_about(Direction(*(np.array([c]) for c in (0.0, 0.0, -1.0))), panels, order, turns)
        deviation = np.arccos(np.clip(-beam.directions.z, -1, 1))
        kept = _share_in_port(deviation) if edges[1:] else np.ones_like(deviation)
        rules.append(pairs(light, np.ones(1), beam, beam.projected * kept))
    return Aperture(*rules, mirror=True)


def _share_in_port(angle: np.ndarray) -> np.ndarray:
    """Share of the beam's disc that lies in the port when it is displaced by an angle: two circles' common area."""
    d = np.clip(angle, PORT - BEAM, PORT + BEAM)
    near = np.arccos(np.clip((d**2 + BEAM**2 - PORT**2) / (2 * d * BEAM), -1, 1))
    far = np.arccos(np.clip((d**2 + PORT**2 - BEAM**2) / (2 * d * PORT), -1, 1))
    # Heron's form of the kite between the centres and the two points that the circles share.
    kite = (PORT + BEAM - d) * (d + BEAM - PORT) * (d - BEAM + PORT) * (d + BEAM + PORT)
    common = BEAM**2 * near + PORT**2 * far - 0.5 * np.sqrt(np.maximum(kite, 0.0))
    return np.where(angle <= PORT - BEAM, 1.0, np.where(angle >= PORT + BEAM, 0.0, common / (np.pi * BEAM**2)))
