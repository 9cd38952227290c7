"""The largest albedo of a fitted model: first by the fit's own compiled program, and to a bound where it nears 1."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.readings import laid_directions
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.sides import Hemispheres

INCIDENCES = np.radians([0.0, 30, 60, 75, 85])
AZIMUTHS = np.radians([0.0, 90.0])
RADII, TURNS = 48, 32
MANY = 32  # channels
LEAST_NODES, MOST_VALUES = 1 << 12, 1 << 19  # directions, and values of f, that are evaluated at a time
NARROWEST, WIDEST = 1e-4, 1e3  # slopes of the half vector between which a lobe has its width
CREATES = 0.02  # albedo above 1 from which on an isotropic model surely creates energy: what this sum may err by
SUSPECT = 0.95  # albedo from which on it is computed to a bound


class LargestAlbedo(NamedTuple):
    """The largest of the directional albedos at some incidences (radians), and the index of its channel."""

    value: float
    theta_i: float
    phi_i: float
    channel: int


class Nodes(NamedTuple):
    """Directions (n,) of a sum over the hemisphere at each of I incidences, and the weights f is to be summed with."""

    wi: Direction
    wo: Direction
    weight: np.ndarray
    incidence: np.ndarray

    def thinned(self) -> "Nodes":
        """A third of the directions, with the same weight at each incidence: 2 % off as well."""
        some = self.part(slice(1, None, 3))
        share = np.bincount(self.incidence, self.weight) / np.bincount(some.incidence, some.weight)
        return some._replace(weight=some.weight * share[some.incidence])

    def part(self, those: slice) -> "Nodes":
        """Some of them."""
        wi, wo = (Direction(*(c[those] for c in w)) for w in (self.wi, self.wo))
        return Nodes(wi, wo, self.weight[those], self.incidence[those])


@functools.lru_cache(maxsize=2)
def nodes(isotropic: bool = False) -> Nodes:
    """Nodes about the mirror direction, back to the light and over the hemisphere, by the balance heuristic.

    Three rules, each of one density over the directions, share the integrand in the ratio of their densities
    [Veach & Guibas 1995]: round lobes of any width about either direction are resolved to 2 %, and so is a diffuser. Of
    a narrow brushed lobe more than half may be missed.
    """
    columns: list[np.ndarray] = []
    for index, (theta, phi) in enumerate((t, p) for t in INCIDENCES for p in azimuths_of(isotropic)):
        wi = np.array(from_spherical(theta, phi, np))
        back = np.array([-wi[0], -wi[1], wi[2]])
        u, v = (g.ravel() for g in np.meshgrid(_midpoints(RADII), _midpoints(TURNS), indexing="ij"))
        mirror, retro = _reflected(wi, u, v), _reflected(back, u, v)
        sine = np.sqrt(u)
        even = np.stack([sine * np.cos(2 * np.pi * v), sine * np.sin(2 * np.pi * v), np.sqrt(1 - u)])
        for wo in (mirror, retro, even):
            density = _density(wi, wo) + _density(back, wo) + np.maximum(wo[2], 0.0) / np.pi
            weight = np.where(wo[2] > 0, wo[2] / np.maximum(density, 1e-300) / u.size, 0.0)
            columns.append(np.stack([*np.repeat(wi[:, None], u.size, 1), *wo, weight, np.full(u.size, float(index))]))
    every = np.concatenate(columns, axis=1)
    every = every[:, every[6] > 0]
    return Nodes(Direction(*every[:3]), Direction(*every[3:6]), every[6], every[7].astype(int))


def _midpoints(n: int) -> np.ndarray:
    return (np.arange(n) + 0.5) / n


def _reflected(w: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Mirror images of a direction in facets of all slopes."""
    slope = NARROWEST * np.sinh(u * np.arcsinh(WIDEST / NARROWEST))
    m = np.stack([slope * np.cos(2 * np.pi * v), slope * np.sin(2 * np.pi * v), np.ones_like(slope)])
    m /= np.sqrt(slope**2 + 1)
    return 2.0 * (w @ m) * m - w[:, None]


def _density(w: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Density over the sphere, 1/sr, with which `_reflected` places directions."""
    h = w[:, None] + wo
    h = h / np.maximum(np.linalg.norm(h, axis=0), 1e-300)
    cosine = np.maximum(h[2], 1e-9)
    slope = np.sqrt(np.maximum(1 - cosine**2, 0.0)) / cosine
    slope = np.maximum(slope, 1e-3 * NARROWEST)
    by_slope = 1.0 / (np.arcsinh(WIDEST / NARROWEST) * np.hypot(slope, NARROWEST))
    facets = by_slope / (2 * np.pi * slope * cosine**3)
    return np.where(slope < WIDEST, facets / (4.0 * np.maximum(w @ h, 1e-9)), 0.0)


def azimuths_of(isotropic: bool) -> np.ndarray:
    """Azimuths of incidence that stand for all: one of an isotropic surface."""
    return AZIMUTHS[:1] if isotropic else AZIMUTHS


def largest_albedo(
    values: Callable[[Direction, Direction], np.ndarray], channels: int = 1, isotropic: bool = False
) -> LargestAlbedo:
    """The largest directional albedo of a model of round lobes at `INCIDENCES` from two azimuths, to 2 %.

    Args:
        values: f (n, C), 1/sr, at directions of shape (n,).
        channels: C; the directions are taken in parts, and of many channels only a third of them.
        isotropic: whether f is known to depend on the azimuths only by their difference: one azimuth is enough.
    """
    albedo = np.zeros((INCIDENCES.size * azimuths_of(isotropic).size, channels))
    for part in laid_nodes(isotropic, channels):
        f = values(part.wi, part.wo)
        incidences, starts = np.unique(part.incidence, return_index=True)  # the nodes of each stand together
        albedo[incidences] += np.add.reduceat(part.weight[:, None] * np.nan_to_num(f), starts)
    return _largest(albedo)


@functools.lru_cache(maxsize=4)
def laid_nodes(isotropic: bool, channels: int) -> list[Nodes]:
    """Nodes for so many channels, in parts, where a fit's programs read them without a copy."""
    every, rows = nodes(isotropic), max(LEAST_NODES, MOST_VALUES // channels)
    if channels > MANY:
        every = every.thinned()
    parts = (every.part(slice(first, first + rows)) for first in range(0, every.weight.size, rows))
    return [n._replace(wi=laid_directions(n.wi, channels), wo=laid_directions(n.wo, channels)) for n in parts]


def confirmed(rough: LargestAlbedo, brdf: AbstractBRDF) -> LargestAlbedo:
    """The same to 1e-4 where the rough one nears 1, and for brushed lobes, which `nodes` may miss.

    See `gonio.models.albedo.directional_albedo`.
    """
    return rough if brdf.isotropic and rough.value < SUSPECT else bounded_largest_albedo(brdf)


def bounded_largest_albedo(brdf: AbstractBRDF) -> LargestAlbedo:
    """The largest directional albedo of a model at `INCIDENCES`, to 1e-4; with what it transmits.

    From two azimuths, of an isotropic one from one.
    """
    theta, phi = (a.ravel() for a in np.meshgrid(INCIDENCES, azimuths_of(brdf.isotropic), indexing="ij"))
    albedo = directional_albedo(brdf, theta, phi, 1e-4).value.reshape(theta.size, -1)
    if Hemispheres.TRANSMISSION in brdf.hemispheres:
        albedo = albedo + directional_transmittance(brdf, theta, phi, 1e-4).value.reshape(theta.size, -1)
    return _largest(albedo)


def _largest(albedo: np.ndarray) -> LargestAlbedo:
    worst, channel = np.unravel_index(int(np.argmax(albedo)), albedo.shape)
    theta, phi = divmod(int(worst), len(albedo) // INCIDENCES.size)
    return LargestAlbedo(float(albedo[worst, channel]), float(INCIDENCES[theta]), float(AZIMUTHS[phi]), int(channel))
