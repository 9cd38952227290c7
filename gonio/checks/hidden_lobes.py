"""The energy that a lobe in the mirror direction may have where no reading of a table shows it.

A table that leaves out the mirror direction excludes no lobe that is narrow enough, but it bounds those of a given
width: their tails are at most what was read. The lobes are those of Gaussian distributions of facets (Beckmann); all
other distributions in use, GGX and the power laws of polished surfaces, have heavier tails, and hide less.

References:
    Walter et al. 2007, eqs. 20 and 25, for f = D / (4 cosθi cosθo) of energy 1 about the mirror direction.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

ALPHAS = np.geomspace(2e-4, 0.3, 128)
"""Widths of the facets' distribution."""

NARROWEST = 1e-3
"""Radians: a lobe in the mirror direction is at least this wide, so that a reading so near cannot miss it."""

MOST = 100.0
"""Times the light that falls in: more tells no more than that there is no bound."""

NEAREST = 48
"""Nodes about the mirror direction that are looked at."""

ASPECTS, TURNS = (1.0, 2.0, 4.0, 8.0), 8
"""Of the distributions on surfaces that are not isotropic: ratios of their two widths, and orientations over 180°."""


SAME_LIGHT = math.radians(0.05)
"""Incidences so near to one another are one."""

FAINTEST = 1e-6
"""Of the mean radiance: fainter tails, of rounding and stray light, are not evidence that there is no lobe."""


class Features(NamedTuple):
    """What narrow lobes are looked for with, radians: how near a reading sees them, and what none is narrower than."""

    reach: float
    width: float = 0.0
    further: "Further | None" = None
    """Readings beside those of the table, which lobes do not exceed either."""

    @property
    def stated_reach(self) -> float:
        """The reach, or half of the stated width: a lobe of any shape is seen there."""
        return max(self.reach, self.width / 2 + 1e-9)


class NearMirror(NamedTuple):
    """Nodes of one incidence (n,): their half vectors' angles, their geometry, and their weight in the albedo, sr."""

    theta_h: np.ndarray
    phi_h: np.ndarray
    cosines: np.ndarray
    """cosθi · cosθo."""
    weight: np.ndarray
    number: np.ndarray
    """Of the node among all of the incidence."""

    @classmethod
    def of(
        cls, incidence: tuple[float, float], theta_o: np.ndarray, phi_o: np.ndarray, weight: np.ndarray
    ) -> "NearMirror":
        """The nodes, radians (N,), nearest to the mirror direction of an incidence (theta_i, phi_i)."""
        theta_i, phi_i = incidence
        turn = phi_o - phi_i
        x = math.sin(theta_i) + np.sin(theta_o) * np.cos(turn)
        y, z = np.sin(theta_o) * np.sin(turn), math.cos(theta_i) + np.cos(theta_o)
        theta_h, cos_o = np.arctan2(np.hypot(x, y), z), np.cos(theta_o)
        near = np.argsort(theta_h, kind="stable")[:NEAREST]
        near = near[cos_o[near] > 1e-6]
        phi_h = np.arctan2(y, x) + phi_i
        return cls(theta_h[near], phi_h[near], math.cos(theta_i) * cos_o[near], weight[near], near)

    def joined(self, other: "NearMirror") -> "NearMirror":
        """Both; what is further is numbered after these."""
        theta_h, phi_h, cosines, weight, number = (np.concatenate(pair) for pair in zip(self, other, strict=True))
        return NearMirror(theta_h, phi_h, cosines, weight, number)


class Further(NamedTuple):
    """Readings of the same surface beside those of a table: angles (m, 4), radians, f and its uncertainty (m, C).

    `limit` (m, C), 1/sr: what a lobe may be there at the most.
    """

    angles: np.ndarray
    f: np.ndarray
    u: np.ndarray
    limit: np.ndarray

    def near(self, incidence: tuple[float, float], isotropic: bool) -> tuple[NearMirror, np.ndarray]:
        """Those of one incidence (theta_i, phi_i), which stand for nothing of its albedo, and their limits."""
        theta_i, phi_i, theta_o, phi_o = self.angles.T
        alike = np.abs(theta_i - incidence[0]) < SAME_LIGHT
        if not isotropic and incidence[0] > SAME_LIGHT:
            alike &= np.abs(np.mod(phi_i - incidence[1] + np.pi, 2 * np.pi) - np.pi) < SAME_LIGHT
        turned = phi_o - phi_i + incidence[1] if isotropic else phi_o
        nodes = NearMirror.of(incidence, theta_o[alike], turned[alike], np.zeros(alike.sum()))
        return nodes, self.limit[alike][nodes.number]


def alpha_of(width: float) -> float:
    """Width α of the Gaussian distribution of facets whose lobe has this full width at half maximum, radians, at 0°."""
    return math.tan(min(width, math.pi) / 4) / math.sqrt(math.log(2))


def width_of(alpha: float) -> float:
    """Full width at half maximum, radians, of the lobe of a Gaussian distribution of facets, at normal incidence."""
    return 4 * math.atan(alpha * math.sqrt(math.log(2)))


def credible(limit: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """What lobes may be at the readings, (..., C), no less than a reading tells of a surface of an albedo (C,)."""
    return np.maximum(limit, FAINTEST * np.abs(albedo) / np.pi)


def hidden_energy(nodes: NearMirror, limit: np.ndarray, isotropic: bool) -> np.ndarray:
    """The most that an integral over the nodes misses of lobes that are at least as wide as each of `ALPHAS`, (K, C).

    Args:
        nodes: those about the mirror direction of an incidence.
        limit: (n, C), 1/sr: what a lobe may be at each node at the most; infinite where nothing was read.
        isotropic: whether the surface is; else distributions of facets are elongated too.
    """
    shapes = (
        [(1.0, 0.0)] if isotropic else [(a, k * np.pi / TURNS) for a in ASPECTS for k in range(TURNS if a > 1 else 1)]
    )
    missed = functools.reduce(np.maximum, (_missed(nodes, limit, *shape) for shape in shapes))
    return np.maximum.accumulate(missed[::-1], axis=0)[::-1]


def _missed(nodes: NearMirror, limit: np.ndarray, aspect: float, turn: float) -> np.ndarray:
    slope = np.tan(nodes.theta_h)
    along, across = slope * np.cos(nodes.phi_h - turn), slope * np.sin(nodes.phi_h - turn) / aspect
    alpha2 = ALPHAS[:, None] ** 2
    density = np.exp(-(along**2 + across**2) / alpha2) / (np.pi * aspect * alpha2 * np.cos(nodes.theta_h) ** 4)
    unit = density / (4 * nodes.cosines)  # (K, n): the lobe of energy 1
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        energy = np.min(np.nan_to_num(limit / unit[..., None], nan=np.inf, posinf=np.inf), axis=1)
        missed = np.where((counted := unit @ nodes.weight)[:, None] < 1, energy * (1 - counted)[:, None], 0.0)
    # Where the nearest node is within half of the lobe's width it shows the lobe, and the grid's own bound holds: a
    # node that counts, for a reading beside the table shows no more than its limit.
    nearest = slope[nodes.weight > 0].min(initial=np.inf)
    return np.where(ALPHAS[:, None] * math.sqrt(math.log(2)) < nearest, missed, 0.0)


def at_width(hidden: np.ndarray, width: float) -> np.ndarray:
    """Of energies (..., K, C) by `ALPHAS` those of lobes that are no narrower than a width, radians; (..., C).

    None is narrower than `NARROWEST`. Energies beyond `MOST` have no bound.
    """
    number = int(np.searchsorted(ALPHAS, alpha_of(max(width, NARROWEST)) * (1 + 1e-9))) - 1
    return np.where(hidden[..., number, :] > MOST, np.inf, hidden[..., number, :])
