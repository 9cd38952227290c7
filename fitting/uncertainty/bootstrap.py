"""Uncertainties that assume no form of the noise: refits to readings drawn again in blocks of neighbouring directions.

Residuals that neighbours share (a model that leaves something out, a misaligned arm) are no independent noise: a block
keeps them together. `residuals`: the directions stay, and the residuals of each block keep or change their sign [Wu
1986; Cameron, Gelbach & Miller 2008]; `pairs`: blocks are drawn with repetition, readings and directions together.
"""

import dataclasses
from typing import Any

import numpy as np

from gonio.fitting.problem.readings import Readings
from gonio.fitting.problem.residuals import compared, retargeted, reweighed, weighted_residuals
from gonio.fitting.residuals.pair_angles import neighbour_order
from gonio.fitting.solver.multistart import descend, ordered_lobes
from gonio.fitting.solver.robust_weights import scales
from gonio.fitting.uncertainty.covariance import NORMAL_95
from gonio.models.errors import GonioError, nearest

KINDS = ("residuals", "pairs")
ALONE = 0.1  # correlation below which readings are not neighbours
FEWEST_BLOCKS = 20
PERCENTILES_FROM = 200  # refits; with fewer, intervals are normal ones
MOST = 100_000


@dataclasses.dataclass(frozen=True)
class Bootstrap:
    """Numbers of refits (N, P), and how the readings were drawn: blocks of so many cells, so many that failed."""

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


def require(number: int, kind: str) -> None:
    """GonioError for a number of refits that cannot be, or a kind that is not known."""
    if kind not in KINDS:
        raise GonioError(f"Unknown bootstrap '{kind}'; {nearest(kind, KINDS)}")
    if number != 0 and not 2 <= number <= MOST:
        raise GonioError(f"A bootstrap of {number} refits came; expected from 2 to {MOST}, such as 200, or 0 for none.")


def bootstrap(e, readings: Readings, number: int, kind: str, seed: int) -> Bootstrap:
    """`number` refits of an ending `e`, each from its own numbers, by the compiled program of the fit itself."""
    residual = weighted_residuals(readings, e.problem.loss, float(e.problem.data.floor), e.weight, e.model_f)
    used = e.weight > 0
    block, size = blocks_of(readings, residual / scales(residual, e.model_f, used), used.any(axis=1))
    blocks = int(block.max()) + 1
    rng = np.random.default_rng([seed, 0x626F6F74])
    model = compared(readings, e.problem.loss, float(e.problem.data.floor), e.model_f)
    off = compared(readings, e.problem.loss, float(e.problem.data.floor), readings.f) - model
    # Residuals of a fit are smaller than noise: it has used up as many as it has numbers.
    grown = np.sqrt(readings.count / max(readings.count - e.p.size, 1))
    found, failed = [], 0
    for _ in range(number):
        if kind == "pairs":
            drawn = np.bincount(rng.integers(blocks, size=blocks), minlength=blocks)
            again = reweighed(e.problem, e.weight * np.sqrt(drawn[block])[:, None])
        else:
            signs = rng.choice((-1.0, 1.0), blocks)
            again = retargeted(e.problem, model + grown * signs[block][:, None] * off)
        end = descend(again, e.domains, e.p)
        if np.isfinite(end.cost) and (end.exact or end.stationarity <= 1e-4):
            found.append(ordered_lobes(e.structure, e.fixed, end.p))
        else:
            failed += 1
    numbers = np.array(found) if found else np.empty((0, e.p.size))
    return Bootstrap(kind, numbers, size, blocks, failed, 1.0 if e.aside is None else e.aside.widening)


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
        best = max(best, (effect, block, size), key=lambda found: found[0])
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


def told(endings, drawn: list[Bootstrap], labels: list[str]) -> dict[str, Any]:
    """What a result keeps of a bootstrap of its endings, whose free numbers have these labels in turn."""
    numbers, at = [], 0
    for e, b in zip(endings, drawn, strict=True):
        u, ends = b.standard, b.intervals(e.p, np.asarray(e.domains.low), np.asarray(e.domains.high))
        for k in range(e.p.size):
            interval = [float(v) for v in ends[k]]
            numbers.append({"name": labels[at], "standard_uncertainty": float(u[k]), "interval95": interval})
            at += 1
    every = [b.numbers for b in drawn]
    same = min(len(v) for v in every)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.corrcoef(np.concatenate([v[:same] for v in every], axis=1).T) if same > 2 else None
    return {
        "kind": drawn[0].kind,
        "refits": sum(len(b.numbers) + b.failed for b in drawn),
        "failed": sum(b.failed for b in drawn),
        "blocks": [b.blocks for b in drawn],
        "block_cells": [b.block_cells for b in drawn],
        "numbers": numbers,
        "correlation": None if correlation is None else np.atleast_2d(correlation),
    }
