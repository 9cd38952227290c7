"""The energy that a lobe in the mirror direction may have where no reading of a table shows it.

A table that leaves out the mirror direction excludes no lobe that is narrow enough, but it bounds those of a given
width: their tails are at most what was read. The lobes are those of Gaussian distributions of facets (Beckmann), and
mixtures of them; all other distributions in use, GGX and the power laws of polished surfaces, have heavier tails, and
hide less.

Light that an interface refracts has such a lobe too, about the direction that Snell's law gives it.

References:
    Walter et al. 2007, eqs. 20 and 25, for f = D / (4 cosθi cosθo) of energy 1 about the mirror direction; eq. 21 for
    the lobe of what is refracted.
"""

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


class NearMirror(NamedTuple):
    """Nodes of one incidence (n,): their half vectors' angles, their geometry, and their weight in the albedo, sr."""

    theta_h: np.ndarray
    phi_h: np.ndarray
    cosines: np.ndarray
    """cosθi · cosθo; of refracted light such that D / (4 cosines) is what facets pass on of a lobe of energy 1."""
    weight: np.ndarray
    number: np.ndarray
    """Of the node among all of the incidence."""

    @classmethod
    def of(
        cls,
        incidence: tuple[float, float],
        theta_o: np.ndarray,
        phi_o: np.ndarray,
        weight: np.ndarray,
        bend: float = 1.0,
    ) -> "NearMirror":
        """The nodes, radians (N,), nearest to the mirror direction of an incidence (theta_i, phi_i).

        `bend`: ratio of the indices on the sides of light and detector; where it is not 1 the nodes are of refracted
        light, mirrored into the front, and nearest to where Snell's law sends it. Nodes that no facet refracts to are
        none.
        """
        theta_i, phi_i = incidence
        turn, cos_o, cos_i = phi_o - phi_i, np.cos(theta_o), math.cos(theta_i)
        x = bend * math.sin(theta_i) + np.sin(theta_o) * np.cos(turn)
        y, z = np.sin(theta_o) * np.sin(turn), cos_i + cos_o
        cosines, reached = cos_i * cos_o, cos_o > 1e-6
        if bend != 1.0:
            side = 1.0 if bend > 1 else -1.0  # h = ∓(n_i wi + n_o wo), on the front's side
            x, y, z = side * x, side * y, side * (bend * cos_i - cos_o)
            square = np.maximum(x**2 + y**2 + z**2, 1e-300)
            facing_i = x * math.sin(theta_i) + z * cos_i
            facing_o = x * np.sin(theta_o) * np.cos(turn) + y * np.sin(theta_o) * np.sin(turn) - z * cos_o
            reached &= (facing_i > 0) & (facing_o < 0) & (z > 0)
            passed = _passed(facing_i / np.sqrt(square), bend)
            cosines = cosines * square**2 / (4 * np.maximum(np.abs(facing_i * facing_o) * passed, 1e-300))
            reached &= passed > 1e-6
        theta_h, phi_h = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x) + phi_i
        near = np.argsort(np.where(reached, theta_h, np.inf), kind="stable")[:NEAREST]
        near = near[reached[near]]
        return cls(theta_h[near], phi_h[near], cosines[near], weight[near], near)

    def joined(self, other: "NearMirror") -> "NearMirror":
        """Both; what is further is numbered after these."""
        theta_h, phi_h, cosines, weight, number = (np.concatenate(pair) for pair in zip(self, other, strict=True))
        return NearMirror(theta_h, phi_h, cosines, weight, number)


def _passed(cos_i: np.ndarray, bend: float) -> np.ndarray:
    """Share of unpolarised light that a facet refracts at an angle to its normal [Fresnel]; 0 in total reflection."""
    cos_t = np.sqrt(np.maximum(1 - bend**2 * (1 - cos_i**2), 0.0))
    cos_i = np.maximum(cos_i, 1e-300)
    s, p = (bend * cos_i - cos_t) / (bend * cos_i + cos_t), (cos_i - bend * cos_t) / (cos_i + bend * cos_t)
    return np.where(cos_t > 0, 1 - (s**2 + p**2) / 2, 0.0)


class Further(NamedTuple):
    """Readings of the same surface beside those of a table: angles (m, 4), radians, f and its uncertainty (m, C).

    `limit` (m, C), 1/sr: what a lobe may be there at the most.
    """

    angles: np.ndarray
    f: np.ndarray
    u: np.ndarray
    limit: np.ndarray

    def near(self, incidence: tuple[float, float], isotropic: bool, bend: float = 1.0) -> tuple[NearMirror, np.ndarray]:
        """Those of one incidence (theta_i, phi_i), which stand for nothing of its albedo, and their limits."""
        theta_i, phi_i, theta_o, phi_o = self.angles.T
        alike = np.abs(theta_i - incidence[0]) < SAME_LIGHT
        if not isotropic and incidence[0] > SAME_LIGHT:
            alike &= np.abs(np.mod(phi_i - incidence[1] + np.pi, 2 * np.pi) - np.pi) < SAME_LIGHT
        turned = phi_o - phi_i + incidence[1] if isotropic else phi_o
        nodes = NearMirror.of(incidence, theta_o[alike], turned[alike], np.zeros(alike.sum()), bend)
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


class Lobes(NamedTuple):
    """Those that are looked for: the widths α of their facets (K,), and the share of light that each sends on (K,).

    `largest`: factor of a lobe of energy 1 beyond which nothing is asked.
    """

    alpha: np.ndarray
    share: np.ndarray
    largest: float = 1e12


WEIGHTS = (0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98)
"""Of one of two limits."""
REFLECTED = Lobes(ALPHAS, np.ones(ALPHAS.size))
MOST_FACETS = 2.0
"""Of total reflection: what facets send on where more than that is lawless below that angle too, and judged there."""


def refracted(theta_i: float, bend: float) -> Lobes:
    """Refracted lobes as wide as those that facets of `ALPHAS` reflect; `bend` as of `NearMirror.of`.

    A facet's tilt turns refracted light by |1 − bend| times as much, not twice. Beyond the angle of total reflection
    only facets that lean towards the light let any through: of a Gaussian distribution those are few.
    """
    alpha = ALPHAS * (2 / abs(1 - bend))
    lean = theta_i - math.asin(1 / bend) if bend > 1 else 0.0
    slope = math.tan(min(max(lean, 0.0), math.pi / 2 - 1e-6))
    share = np.minimum(np.exp(-((slope / alpha) ** 2)) / max(math.cos(theta_i), 1e-6), 1.0)
    return Lobes(alpha, share, MOST_FACETS if lean > 0 else REFLECTED.largest)


def hidden_energy(nodes: NearMirror, limit: np.ndarray, isotropic: bool, lobes: Lobes = REFLECTED) -> np.ndarray:
    """The most that an integral over the nodes misses of lobes that are at least as wide as each of `ALPHAS`, (K, C).

    Of any number of lobes together: a narrow one may make the reading in the mirror direction, and a wider one those
    around it.

    Args:
        nodes: those about the mirror direction of an incidence.
        limit: (n, C), 1/sr: what lobes may be at each node at the most; infinite where nothing was read.
        isotropic: whether the surface is; else distributions of facets are elongated too.
        lobes: what lobes those are, where not reflected.
    """
    shapes = (
        [(1.0, 0.0)] if isotropic else [(a, k * np.pi / TURNS) for a in ASPECTS for k in range(TURNS if a > 1 else 1)]
    )
    each = [_lobes_at(nodes, lobes, *shape) for shape in shapes]
    unit, missed = (np.stack(parts) for parts in zip(*each, strict=True))
    energy = np.stack([_most_of_mixtures(unit, missed, of_channel) for of_channel in limit.T], axis=1)
    return np.minimum(energy, lobes.largest * np.max(missed, axis=0)[:, None])


def _lobes_at(nodes: NearMirror, lobes: Lobes, aspect: float, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Lobes of energy 1 at the nodes (K, n), 1/sr, and what an integral over the nodes misses of each (K,)."""
    slope = np.tan(nodes.theta_h)
    along, across = slope * np.cos(nodes.phi_h - turn), slope * np.sin(nodes.phi_h - turn) / aspect
    alpha2 = lobes.alpha[:, None] ** 2
    density = np.exp(-(along**2 + across**2) / alpha2) / (np.pi * aspect * alpha2 * np.cos(nodes.theta_h) ** 4)
    unit = density / (4 * nodes.cosines)
    # Where the nearest node is within half of the lobe's width it shows the lobe, and the grid's own bound holds: a
    # node that counts, for a reading beside the table shows no more than its limit.
    nearest = slope[nodes.weight > 0].min(initial=np.inf)
    hides = lobes.alpha * math.sqrt(math.log(2)) < nearest
    return unit, np.where(hides, np.maximum(lobes.share - unit @ nodes.weight, 0.0), 0.0)


def _most_of_mixtures(unit: np.ndarray, missed: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The most that is missed of mixtures of lobes that are at least as wide as each, (K,), of one channel.

    A bound by the dual of that linear programme: weights w of the limits, of sum 1, with which the lobes' energies are
    at most 1 / (w · unit/limit) together, whatever the mixture. Tried are pairs of the limits that are the tightest for
    some lobe. A power law, such as GGX's, is such a mixture.

    Args:
        unit: (S, K, n), 1/sr, lobes of energy 1 at the nodes, of S shapes and K widths.
        missed: (S, K), what is missed of each.
        limit: (n,), 1/sr.
    """
    read = np.isfinite(limit)
    used = unit[..., read] / np.maximum(limit[read], 1e-300)  # share of each limit that a lobe of energy 1 takes
    if not used.shape[-1]:
        return np.where(np.maximum.accumulate(np.max(missed, axis=0)[::-1])[::-1] > 0, np.inf, 0.0)
    tightest = np.unique(np.argmax(np.max(used, axis=0), axis=-1))
    best = np.full(missed.shape[1], np.inf)
    for k, first in enumerate(tightest):
        pairs = tightest[k:] if tightest.size > 1 else tightest
        for w in WEIGHTS:
            together = w * used[..., first, None] + (1 - w) * used[..., pairs]
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                most = np.where(missed[..., None] > 0, missed[..., None] / together, 0.0).max(axis=0)
            wider = np.maximum.accumulate(most[::-1], axis=0)[::-1]
            best = np.minimum(best, wider.min(axis=1))
    return best


def at_width(hidden: np.ndarray, width: float) -> np.ndarray:
    """Of energies (..., K, C) by `ALPHAS` those of lobes that are no narrower than a width, radians; (..., C).

    None is narrower than `NARROWEST`. Energies beyond `MOST` have no bound.
    """
    number = int(np.searchsorted(ALPHAS, alpha_of(max(width, NARROWEST)) * (1 + 1e-9))) - 1
    return np.where(hidden[..., number, :] > MOST, np.inf, hidden[..., number, :])
