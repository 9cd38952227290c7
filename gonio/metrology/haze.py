"""Haze of what a material transmits at normal incidence: by angle, and as an integrating sphere reads it."""

from collections.abc import Callable

import numpy as np

from gonio.data.material import Material

DEVIATED = np.radians(2.5)
"""Light that is deviated by more than this is haze [ASTM D1003]."""
PORT, BEAM = np.radians(4.0), np.radians(2.7)
"""Half-angles, seen from the entrance of the sphere, of its exit port and of the beam that reaches it without a sample:
the port subtends 8° and leaves a ring of 1.3° about the beam [ASTM D1003, clause 5]."""
PANELS, ORDERS, AZIMUTHS = 14, (12, 18), 32


def haze_by_angle(material: Material) -> tuple[np.ndarray, np.ndarray]:
    """(share of the transmitted light that is deviated by more than 2.5°, bound), each (channels,)."""
    return _haze(material, lambda angle: np.ones_like(angle), [DEVIATED])


def haze_of_sphere(material: Material) -> tuple[np.ndarray, np.ndarray]:
    """(haze as an integrating sphere reads it, bound), each (channels,): the share that misses the exit port.

    A ray of the beam goes to a point of the disc that the beam fills at the port; a deviation moves it, and what still
    meets the port is lost to the sphere: of deviations below 1.3° all, beyond 6.7° none.
    """
    return _haze(material, _share_in_port, [PORT - BEAM, PORT, PORT + BEAM])


def _share_in_port(angle: np.ndarray) -> np.ndarray:
    """Share of the beam's disc that lies in the port when it is displaced by an angle: two circles' common area."""
    d = np.clip(angle, PORT - BEAM, PORT + BEAM)
    near = np.arccos(np.clip((d**2 + BEAM**2 - PORT**2) / (2 * d * BEAM), -1, 1))
    far = np.arccos(np.clip((d**2 + PORT**2 - BEAM**2) / (2 * d * PORT), -1, 1))
    # Heron's form of the kite between the centres and the two points that the circles share.
    kite = (PORT + BEAM - d) * (d + BEAM - PORT) * (d - BEAM + PORT) * (d + BEAM + PORT)
    common = BEAM**2 * near + PORT**2 * far - 0.5 * np.sqrt(np.maximum(kite, 0.0))
    return np.where(angle <= PORT - BEAM, 1.0, np.where(angle >= PORT + BEAM, 0.0, common / (np.pi * BEAM**2)))


def _haze(
    material: Material, kept: Callable[[np.ndarray], np.ndarray], edges: list[float]
) -> tuple[np.ndarray, np.ndarray]:
    whole = material.transmittance(0.0, tolerance=1e-9)
    fine, rough = (_straight(material, kept, edges, order) for order in reversed(ORDERS))
    nothing = whole.value <= whole.bound
    t = np.where(nothing, np.nan, whole.value)
    straight = fine / t
    return 1 - straight, (np.abs(fine - rough) + straight * whole.bound) / t


def _straight(
    material: Material, kept: Callable[[np.ndarray], np.ndarray], edges: list[float], order: int
) -> np.ndarray:
    """∫ f_t cosθ kept(θ) dω about the direction straight through, (channels,), by panels that shrink towards it."""
    x, w = np.polynomial.legendre.leggauss(order)
    bounds = np.concatenate([[0.0], edges[0] * 0.5 ** np.arange(PANELS)[::-1], edges[1:]])
    half = np.diff(bounds)[:, None] / 2
    angle = (bounds[:-1, None] + half * (1 + x)).ravel()
    weight = (half * w).ravel() * np.sin(angle) * np.cos(angle) * kept(angle)
    azimuth = 2 * np.pi * np.arange(1 if material.brdf.isotropic else AZIMUTHS) / AZIMUTHS
    f = material.f(0.0, 0.0, np.pi - angle[:, None], azimuth[None, :])
    return 2 * np.pi * np.einsum("i,ijc->c", weight, f) / azimuth.size
