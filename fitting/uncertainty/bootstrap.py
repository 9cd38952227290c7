"""Bootstrap over blocks of neighbouring directions: uncertainties that assume no form of the noise.

Residuals that neighbours share (a model that leaves something out, a misaligned arm) are no independent noise: a block
keeps them together. `wild`: the directions stay, and the residuals of each block keep or change their sign [Wu 1986;
Cameron, Gelbach & Miller 2008]; `block_pairs`: blocks are resampled, readings and directions together.
"""

import dataclasses
from typing import Any

import numpy as np

from gonio.fitting.problem.readings import Readings
from gonio.fitting.residuals.pair_angles import neighbour_order
from gonio.fitting.solver.levenberg_marquardt import NEAR, minimise
from gonio.fitting.solver.robust_weights import scales
from gonio.fitting.uncertainty.optimum import NORMAL_95, Optimum

KINDS = ("wild", "block_pairs")
ALONE = 0.1  # correlation below which readings are not neighbours
FEWEST_BLOCKS = 20
PERCENTILES_FROM = 200  # refits; with fewer, intervals are normal ones
STATIONARY = 1e-4  # projected gradient of a refit that counts


@dataclasses.dataclass(frozen=True)
class Bootstrap:
    """Numbers of refits (N, P), and how the readings were resampled: blocks of so many cells, so many that failed."""

    kind: str
    numbers: np.ndarray
    block_cells: int
    blocks: int
    failed: int
    widening: float

    @property
    def standard(self) -> np.ndarray:
        """Standard uncertainties (P,)."""
        if len(self.numbers) < 2:
            return np.full(self.numbers.shape[1], np.nan)
        return self.numbers.std(axis=0, ddof=1) * self.widening

    def intervals(self, p: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """95 % intervals (P, 2) about the numbers p: percentiles of the refits, or normal ones where these are few."""
        if len(self.numbers) >= PERCENTILES_FROM:
            ends = np.percentile(self.numbers, [2.5, 97.5], axis=0)
            ends = p + self.widening * (ends - p)
        else:
            ends = np.stack([p - NORMAL_95 * self.standard, p + NORMAL_95 * self.standard])
        return np.clip(ends, low, high).T


def bootstrap(e: Optimum, number: int, kind: str, seed: int) -> Bootstrap:
    """`number` refits of an optimum, each from its own numbers, by the compiled program of the fit itself.

    Args:
        e: the optimum.
        number: refits.
        kind: of `KINDS`.
        seed: of the random signs or blocks.
    """
    problem, readings = e.problem, e.readings
    residual, used = problem.residuals(e.model_f), problem.weight > 0
    block, size = blocks_of(readings, residual / scales(residual, e.model_f, used), np.any(used, axis=1))
    blocks = int(block.max()) + 1
    rng = np.random.default_rng([seed, 0x626F6F74])
    model = problem.compared(e.model_f)
    deviation = problem.compared(readings.f) - model
    # Residuals of a fit are smaller than noise: it has used up as many as it has numbers.
    enlarged = np.sqrt(readings.count / max(readings.count - e.p.size, 1))
    refits, failed = [], 0
    for _ in range(number):
        if kind == "block_pairs":
            times = np.bincount(rng.integers(blocks, size=blocks), minlength=blocks)
            resampled = problem.reweighted(problem.weight * np.sqrt(times[block])[:, None])
        else:
            signs = rng.choice((-1.0, 1.0), blocks)
            resampled = problem.retargeted(model + enlarged * signs[block][:, None] * deviation)
        end = minimise(resampled, [e.p], NEAR)[0]
        if np.isfinite(end.cost) and (end.exact or end.stationarity <= STATIONARY):
            refits.append(e.parameters.with_ordered_lobes(problem.fixed, end.p))
        else:
            failed += 1
    numbers = np.array(refits) if refits else np.empty((0, e.p.size))
    return Bootstrap(kind, numbers, size, blocks, failed, 1.0 if e.downweighted is None else e.downweighted.widening)


def blocks_of(readings: Readings, scaled: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, int]:
    """(number of the block of each cell (n,), cells of a block).

    Blocks are stretches of one of two orders: pairs of directions that are neighbours, or incidence by incidence;
    that one whose blocks hold more in common, by the variance of their sums.
    """
    best = (-np.inf, np.zeros(used.size, int), 1)
    for order in (neighbour_order(readings.wi, readings.wo), neighbour_order(readings.wi, readings.wo, True)):
        order = order[used[order]]
        size = block_cells(scaled[order])
        block = np.zeros(used.size, int)
        block[order] = np.arange(order.size) // size
        t = np.clip(scaled[order], -3.0, 3.0)
        together = np.stack([np.bincount(block[order], c) for c in t.T])
        effect = float(np.sum(together**2) / max(float(np.sum(t * t)), 1e-300))
        best = max(best, (effect, block, size), key=lambda order: order[0])
    return best[1], best[2]


def block_cells(scaled: np.ndarray) -> int:
    """Cells of a block: twice the distance along the curve (n, C) at which residuals no longer agree, at least 2."""
    n = scaled.shape[0]
    t = np.clip(scaled, -3.0, 3.0)
    power = float(np.mean(t * t))
    lag, most = 1, max(1, n // (2 * FEWEST_BLOCKS))
    while lag < most and power > 0 and float(np.mean(t[lag:] * t[:-lag])) > ALONE * power:
        lag = lag + max(1, lag // 4)
    return min(max(2, 2 * lag), max(1, n // FEWEST_BLOCKS))


def bootstrap_summary(optima: list[Optimum], samples: list[Bootstrap], labels: list[str]) -> dict[str, Any]:
    """What a result keeps of the bootstraps of its optima, whose free numbers have these labels in turn."""
    numbers: list[dict[str, Any]] = []
    for e, b in zip(optima, samples, strict=True):
        ends = b.intervals(e.p, np.asarray(e.domains.low), np.asarray(e.domains.high))
        for u, interval in zip(b.standard, ends, strict=True):
            name = labels[len(numbers)]
            numbers.append({"name": name, "standard_uncertainty": float(u), "interval95": [float(v) for v in interval]})
    every = [b.numbers for b in samples]
    same = min(len(v) for v in every)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.corrcoef(np.concatenate([v[:same] for v in every], axis=1).T) if same > 2 else None
    return {
        "kind": samples[0].kind,
        "refits": sum(len(b.numbers) + b.failed for b in samples),
        "failed": sum(b.failed for b in samples),
        "blocks": [b.blocks for b in samples],
        "block_cells": [b.block_cells for b in samples],
        "numbers": numbers,
        "correlation": None if correlation is None else np.atleast_2d(correlation),
    }
