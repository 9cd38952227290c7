"""Readings of disc apertures: f averaged over both discs, with an estimate of the quadrature's error.

    reading = ∫∫ f cosθi cosθo dωi dωo / (∫ cosθi dωi · ∫ cosθo dωo),   directions below the horizon left out

Each step of a ladder takes more nodes; a cell climbs until two steps agree. Source and detector use the same rule in
frames that depend only on their own direction, so that with equal discs the reading of a reciprocal f is reciprocal.
"""

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax.numpy as jnp
import numpy as np

from gonio.instrument.aperture_rays import Disc, disc_rule, disc_sums
from gonio.models.brdf import AbstractBRDF
from gonio.models.folded import seen_from
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.solid_angle import projected_cap

LANES = 2048
"""Lanes of the kernel: all calls have this shape, so that one compiled program serves every step."""
LADDERS = (
    (0.4, ((2, 2), (3, 3), (5, 5), (8, 8), (12, 12), (18, 18), (27, 27), (40, 40), (60, 60), (90, 90), (135, 135))),
    (0.15, ((2, 2), (3, 3), (4, 6), (6, 10), (9, 16), (13, 24), (20, 36), (29, 54), (43, 80), (64, 120), (96, 180))),
    (-1.0, ((2, 2), (3, 3), (4, 8), (6, 14), (8, 24), (11, 40), (16, 64), (20, 86), (30, 120), (45, 180))),
)
"""Nodes in ψ and along the chords, step by step, for cells whose lower cosine is above the first number: a lobe seen
at grazing is narrower in azimuth, by the cosine, than in polar angle."""
PAIRS_MAX = 3_000_000
"""Pairs of rays of one cell at which the climb ends: 40² × 40²."""
AGREED = 0.03
"""Of what two rules differ by, the least error of the finer one: the next may agree with it by accident, both being too
coarse."""
PEAK_MISSED = 2.0
"""A cell climbs on while f at the mirror configuration within its discs is this many times what its rays have met."""


Tolerance = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(values (n, channels), numbers of their cells (n,)) → allowed errors (n, channels)."""


def average(
    brdf: AbstractBRDF,
    wi: Direction,
    wo: Direction,
    source_half_angle: float,
    detector_half_angle: float,
    tolerance: Tolerance,
) -> tuple[np.ndarray, np.ndarray]:
    """(readings in 1/sr, estimates of their error): (n, channels) each, for NumPy directions of shape (n,), n > 0.

    Half-angles in [0, π/4], radians; 0 is a point. The estimate is how much the last two steps differ, which is the
    error of the coarser one; it stays above the tolerance where the ladder ends first. 0 where a whole disc is below
    the horizon.
    """
    source, detector = (np.stack([np.asarray(c, np.float64) for c in w]) for w in (wi, wo))
    half_angles = (source_half_angle, detector_half_angle)
    lower = np.minimum(source[2], detector[2])
    kinds = np.sum([lower <= bound for bound, _ in LADDERS[:-1]], axis=0)
    kinds[_crosses(source[2], half_angles[0]) | _crosses(detector[2], half_angles[1])] = len(LADDERS)
    pieces = []
    for kind in np.unique(kinds):
        cells = np.flatnonzero(kinds == kind)
        climb = _Climb(brdf, source[:, cells], detector[:, cells], half_angles, crossing=bool(kind == len(LADDERS)))
        ladder = LADDERS[min(kind, len(LADDERS) - 1)][1]
        pieces.append((cells, *climb.run(ladder, lambda values, k, cells=cells: tolerance(values, cells[k]))))
    cells, values, error = (np.concatenate(a) for a in zip(*pieces, strict=True))
    order = np.argsort(cells)
    return values[order], error[order]


def average_on_sides(
    brdf: AbstractBRDF, wi: Direction, wo: Direction, half_angles: tuple[float, float], tolerance: Tolerance
) -> tuple[np.ndarray, np.ndarray]:
    """As `average`, for light and detector on either side of the sample; `half_angles` of source and detector."""
    signs = np.where(np.stack([wi.z, wo.z]) < 0, -1, 1)
    kinds, kind = np.unique(signs, axis=1, return_inverse=True)
    every, parts = [], []
    for number, (light, detector) in enumerate(kinds.T.tolist()):
        cells = np.flatnonzero(np.ravel(kind) == number)
        pair = [Direction(w.x[cells], w.y[cells], s * w.z[cells]) for w, s in ((wi, light), (wo, detector))]

        def allowed(f: np.ndarray, k: np.ndarray, cells: np.ndarray = cells) -> np.ndarray:
            return tolerance(f, cells[k])

        every.append(cells)
        parts.append(average(seen_from(brdf, light, detector), pair[0], pair[1], *half_angles, allowed))
    order = np.argsort(np.concatenate(every))
    values, error = (np.concatenate(a)[order] for a in zip(*parts, strict=True))
    return values, error


def irradiance(cos_theta: np.ndarray, half_angle: float) -> np.ndarray:
    """Irradiance from a disc source at these cosines (n,), relative to normal incidence: cosθ, if it is wholly up."""
    cosine = np.maximum(np.asarray(cos_theta, np.float64), 0.0)
    index = np.flatnonzero(_crosses(cos_theta, half_angle))
    if not index.size or half_angle == 0:
        return cosine
    theta = np.arccos(np.clip(np.asarray(cos_theta)[index], -1.0, 1.0))
    lit = np.asarray(projected_cap(jnp.asarray(half_angle), jnp.asarray(theta)))
    cosine[index] = lit / (math.pi * math.sin(half_angle) ** 2)
    return cosine


def _crosses(cosine: np.ndarray, half_angle: float) -> np.ndarray:
    """Whether the horizon cuts a disc."""
    return cosine < math.sin(half_angle)


@dataclasses.dataclass(frozen=True)
class _Climb:
    """Cells whose averages are taken by ever finer rules; directions of shape (3, n)."""

    brdf: AbstractBRDF
    source: np.ndarray
    detector: np.ndarray
    half_angles: tuple[float, float]
    crossing: bool

    def run(self, ladder: Sequence[tuple[int, int]], tolerance: Tolerance) -> tuple[np.ndarray, np.ndarray]:
        """(values, estimates of their error): each cell climbs until two steps agree within the tolerance."""
        discs = sum(s > 0 for s in self.half_angles)
        rules = [rule for rule in ladder if math.prod(rule) ** discs <= PAIRS_MAX]
        climbing = np.arange(self.source.shape[1])
        values, _ = self._step(rules[0], climbing)
        error, before = np.full(values.shape, np.inf), np.abs(values - self._step((1, 1), climbing)[0])
        for rule in rules[1:]:
            if not climbing.size:
                break
            finer, missed = self._step(rule, climbing)
            difference = np.maximum(np.abs(finer - values[climbing]), AGREED * before[climbing])
            before[climbing] = np.abs(finer - values[climbing])
            # A peak that no ray has met is an error as large as itself, until one meets it.
            difference = np.where(missed > PEAK_MISSED, np.maximum(difference, np.abs(finer)), difference)
            values[climbing], error[climbing] = finer, difference
            rough = ~(difference <= tolerance(finer, climbing)) & np.isfinite(finer)
            climbing = climbing[rough.any(axis=1)]
        return values, error

    def _step(self, rule: tuple[int, int], cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One rule on some cells: (values, f at the mirror configuration over the largest f met)."""
        rules = [disc_rule(*(rule if s > 0 else (1, 1))) for s in self.half_angles]
        # Arrays all, or each number would be compiled in.
        radii: list[Any] = [np.asarray(s, jnp.result_type(float)) for s in self.half_angles]
        # By the rule alone, never by how many cells there are: a cell's value is summed in one order in any batch.
        nodes = math.prod(rule) if self.half_angles[0] > 0 else 1
        split = 1 if nodes < 64 else 16 if nodes < 400 else 512
        per_call = LANES // split
        first = np.tile(np.arange(split), per_call)
        axes = (self.source[:, cells], self.detector[:, cells])

        def call(start: int) -> list[np.ndarray]:
            lanes = [_lanes(w[:, start : start + per_call], split, per_call) for w in axes]
            source, detector = (Disc(*disc) for disc in zip(lanes, radii, rules, strict=True))
            total, *rest = disc_sums(self.brdf, source, detector, first, np.asarray(split), self.crossing)
            return [np.asarray(a).reshape(per_call, split, -1) for a in (np.asarray(total).T, *rest)]

        # The kernel is a loop of small steps, which the compiler leaves to one core. Compiled once, before the others.
        starts = range(0, cells.size, per_call)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            sums = [call(0), *pool.map(call, starts[1:])]
        values, missed = [], []
        for total, weight_i, weight_o, met, probe in sums:
            weight = weight_i.sum(axis=1) * weight_o[:, 0]
            lit = weight > 0
            values.append(np.where(lit, total.sum(axis=1) / np.where(lit, weight, 1.0), 0.0))
            missed.append(np.where(lit, probe[:, 0] / np.maximum(met.max(axis=1), 1e-300), 0.0))
        return np.concatenate(values)[: cells.size], np.concatenate(missed)[: cells.size]


def _lanes(w: np.ndarray, split: int, per_call: int) -> Direction:
    w = np.pad(w, ((0, 0), (0, per_call - w.shape[1])), mode="edge")
    return Direction(*(np.repeat(c, split).astype(jnp.result_type(float)) for c in w))
