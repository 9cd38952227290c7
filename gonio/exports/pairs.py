"""Pairs of directions at which a surface and its expression in a renderer are compared, and how much each counts.

Half vectors lie on a polar grid about the normal whose tilts are even in their logarithm up to a degree and nearly even
beyond, so that lobes of any width are resolved; incidences are Gauss nodes of √cosθ, since f² of a lobe that is masked
at grazing incidence only counts there most.
"""

import dataclasses
import functools

import numpy as np

from gonio.models.geometry.directions import Direction, dot

LOWEST = float(np.cos(np.deg2rad(86)))
"""Cosine of the most grazing light of which albedos are compared."""
LEAST_TILT, EVEN_SHARE = 1e-4, 8.0
"""Radians from which on tilts are even in their logarithm; steps of even ones among all."""


@dataclasses.dataclass(frozen=True)
class Pairs:
    """n pairs of directions above the horizon, of `incidences` directions of the light.

    `flux`: cosθo dωo; `incidence`: the number of the light of each pair; `share`: cosθi dωi/π of each light.
    """

    wi: Direction
    wo: Direction
    flux: np.ndarray
    incidence: np.ndarray
    share: np.ndarray

    @functools.cached_property
    def weight(self) -> np.ndarray:
        """cosθi cosθo dωi dωo/π², (n,): sums to 1."""
        return self.share[self.incidence] * self.flux / np.pi

    @functools.cached_property
    def cosines(self) -> np.ndarray:
        """Of the lights, with the normal."""
        cosines = np.zeros(self.share.size)
        cosines[self.incidence] = self.wi.z
        return cosines

    @functools.cached_property
    def h(self) -> Direction:
        """The half vectors."""
        x, y, z = (a + b for a, b in zip(self.wi, self.wo, strict=True))
        length = np.sqrt(x * x + y * y + z * z)
        return Direction(x / length, y / length, z / length)

    @functools.cached_property
    def cos_d(self) -> np.ndarray:
        """Cosines between half vectors and the light, (n, 1)."""
        return np.clip(dot(self.wi, self.h), 0.0, 1.0)[:, None]

    def through(self) -> "Pairs":
        """The same pairs with the detector mirrored to behind the surface."""
        return dataclasses.replace(self, wo=Direction(self.wo.x, self.wo.y, -self.wo.z))

    def where(self, mask: np.ndarray) -> "Pairs":
        """Those of the pairs that a mask (n,) takes."""
        wi, wo = (Direction(*(c[mask] for c in w)) for w in (self.wi, self.wo))
        return Pairs(wi, wo, self.flux[mask], self.incidence[mask], self.share)

    def albedo(self, f: np.ndarray) -> np.ndarray:
        """∫ f cosθo dωo for each light, (lights, C), by the rule that the pairs are."""
        sums = [np.bincount(self.incidence, self.flux * channel, minlength=self.share.size) for channel in f.T]
        return np.stack(sums, axis=1)


def joined(front: Pairs, behind: Pairs) -> Pairs:
    """Pairs of both sides as one; each light counts as two, one a side."""
    wi, wo = (Direction(*map(_appended, a, b)) for a, b in ((front.wi, behind.wi), (front.wo, behind.wo)))
    incidence = _appended(front.incidence, behind.incidence + front.share.size)
    return Pairs(wi, wo, _appended(front.flux, behind.flux), incidence, _appended(front.share, behind.share))


def _appended(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.concatenate([a, b])


def polar_pairs(lights: int, tilts: int, azimuths: int, turns: int = 1) -> Pairs:
    """The grid of pairs.

    Args:
        lights: polar angles of the light.
        tilts: of the half vector.
        azimuths: of the half vector, over the half circle; over the whole one where the light turns.
        turns: azimuths of the light over the half circle; 1 for an isotropic surface.
    """
    u, weight = np.polynomial.legendre.leggauss(lights)
    root = (1 - u) / 2
    theta_i, share = np.arccos(root**2), 4 * weight * root**3
    phi_i = (np.arange(turns) + 0.5) * np.pi / turns if turns > 1 else np.zeros(1)
    theta_h, d_theta = _tilts(tilts)
    circle = np.pi if turns == 1 else 2 * np.pi
    phi_h = (np.arange(azimuths) + 0.5) * circle / azimuths
    grid = np.meshgrid(np.arange(lights), phi_i, np.arange(tilts), phi_h, indexing="ij")
    light, phi, tilt, turn = (a.ravel() for a in grid)
    light, tilt = light.astype(int), tilt.astype(int)
    wi, h = _direction(theta_i[light], phi), _direction(theta_h[tilt], phi + turn)
    cos_d = dot(wi, h)
    wo = Direction(*(2 * cos_d * b - a for a, b in zip(wi, h, strict=True)))
    above = (cos_d > 1e-6) & (wo.z > 1e-6)
    flux = 4 * cos_d * np.sin(theta_h[tilt]) * d_theta[tilt] * (2 * np.pi / azimuths) * wo.z
    incidence = np.repeat(np.arange(lights * turns), tilts * azimuths)
    return Pairs(wi, wo, flux, incidence, np.repeat(share / 2 / turns, turns)).where(above)


def _tilts(count: int) -> tuple[np.ndarray, np.ndarray]:
    fine = np.concatenate([np.zeros(1), np.geomspace(1e-3 * LEAST_TILT, np.pi / 2, 4096)])
    place = np.arcsinh(fine / LEAST_TILT) + EVEN_SHARE * fine / (np.pi / 2)
    edges = np.interp(np.linspace(0, place[-1], 2 * count + 1), place, fine)
    return edges[1::2], np.diff(edges[::2])


def _direction(theta: np.ndarray, phi: np.ndarray) -> Direction:
    sin = np.sin(theta)
    return Direction(sin * np.cos(phi), sin * np.sin(phi), np.cos(theta))
