"""Standard uncertainties where residuals are alike among neighbours or channels; and where they are few.

What a model leaves out is no independent noise: readings of one neighbourhood err together, so that there are fewer
independent ones than readings; likewise the channels of a direction under a lamp that flickers. The covariance is the
jackknife's over clusters, each left out in turn and followed by the first step of a refit, with Student's quantile
[Bell & McCaffrey 2002; MacKinnon, Nielsen & Webb 2023].
"""

import dataclasses

import numpy as np

from gonio.fitting.problem.arrow import Arrow
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.problem import FitProblem, weighted_residuals
from gonio.fitting.problem.readings import Readings, evenly_spaced, rows_of
from gonio.fitting.residuals.noise_tests import channel_effect, noise_tests
from gonio.fitting.residuals.pair_angles import neighbour_order
from gonio.fitting.residuals.rare_counts import of_rare_counts
from gonio.fitting.solver.robust_weights import scales
from gonio.fitting.uncertainty.bootstrap import blocks_of
from gonio.fitting.uncertainty.covariance import NORMAL_95
from gonio.fitting.uncertainty.optimum import Optimum

MOST_CELLS = 1 << 14  # of more, a random choice
MOST_READINGS = 1 << 18  # of these cells; of more, evenly spaced channels
MOST_CLUSTERS = 64  # of more, several are left out together
DAMPING = 1e-12
SEEN = 1e-9  # of what all clusters tell of a number, below which the others tell nothing of it
UNKNOWN = 1e6  # times the uncertainty: a number that one cluster alone tells of is not known to independent noise
ROUNDING = 1e-6  # residuals over readings, where tables stored in single precision are no better
FEWEST_INCIDENCES = 10
FEWEST = 100  # cells below which blocks say nothing
FEWER_CHANNELS = 1.1  # times the variance of independent channels, below which uncertainties change by less than 5 %


def with_clusters(e: Optimum, seed: int, noise_known: bool) -> tuple[Optimum, str | None]:
    """The optimum with uncertainties for residuals that neighbours share, and a note; the same where they do not.

    Args:
        e: the optimum, with uncertainties for independent noise; none of them becomes smaller.
        seed: of the readings that are looked at, where there are more than `MOST_CELLS`.
        noise_known: whether the covariance is that of known noise; else few readings are left out one by one.
    """
    rounding = 2.0 * e.cost < ROUNDING**2 * e.problem.target_norm_squared
    if e.exact or rounding or not e.p.size or not np.isfinite(e.cost):
        return e, None
    rng = np.random.default_rng([seed, 0x636C7573])
    n = e.model_f.shape[0]
    cells = np.sort(rng.choice(n, MOST_CELLS, replace=False)) if n > MOST_CELLS else np.arange(n)
    channels = evenly_spaced(e.model_f.shape[1], max(1, MOST_READINGS // cells.size))
    readings, f = e.readings.part(cells).of_channels(channels), rows_of(e.model_f, cells)[:, channels]
    weight = rows_of(e.problem.weight, cells)
    some = np.any(weight > 0, axis=1)
    few = np.count_nonzero(some) < FEWEST
    if few and not noise_known:
        return _with_cells(e, some)[0], None
    weight = weight[:, channels]
    residual, used = weighted_residuals(readings, e.problem.loss, e.problem.floor, weight, f), weight > 0
    scaled, wi, wo = residual / scales(residual, f, used), readings.wi, readings.wo
    orders = (neighbour_order(wi, wo), neighbour_order(wi, wo, by_incidence=True))
    tested = used & ~of_rare_counts(readings.f, f, weight, used) if noise_known else used
    effect = channel_effect(scaled, tested)
    tests = [noise_tests(rows_of(scaled, o), rows_of(tested, o), None, n, False, effect) for o in orders]
    if few or all(t.verdict != "structure" for t in tests):
        if effect < FEWER_CHANNELS or all(g.per_channel for g in e.parameters.free):
            return e, None
        wide, widest = _with_cells(e, some, cells)
        return wide, widest and (
            "the residuals of the channels are alike: the standard uncertainties are those of directions left out in "
            f"all channels, up to {widest} times what independent noise of each would give"
        )
    block, kind = _clusters(readings, scaled, some)
    clusters = int(block.max()) + 1
    number = min(clusters, MOST_CLUSTERS)
    step = _steps(e, e.problem.subset(cells), np.where(some, block % number, -1), number)
    # Of a part of the readings, the noise within a cluster counts more than it does of all.
    wide, widest = _widened(e, step, number - 1, n / cells.size - 1.0)
    return wide, (
        f"the residuals are alike among neighbours: the standard uncertainties are those of {clusters} {kind}, up to "
        f"{widest} times what independent noise would give"
    )


def _with_cells(e: Optimum, some: np.ndarray, cells: np.ndarray | None = None) -> tuple[Optimum, str | None]:
    """The optimum with the jackknife's uncertainties over pairs of directions, and the largest factor as a text.

    A fit bends to each of a few readings, whose residuals then tell less than their noise [MacKinnon & White 1985]. A
    pair is left out in all channels: what is wrong with a geometry is wrong in each of them. Of many pairs several are
    left out together; `cells` are those of which `some` tells, where it is a choice.
    """
    groups = e.parameters.free
    fitted = len(groups) if e.parameters.channels == 1 else sum(g.per_channel for g in groups)
    number = int(np.count_nonzero(some))
    if number <= fitted + 1:
        return e, None
    parts = number if number < FEWEST else MOST_CLUSTERS
    each = np.where(some, np.cumsum(some) - 1, -1)
    problem, share = e.problem, 1.0
    if cells is not None:
        # Neighbours in the order of the readings are left out with different parts.
        problem, share = e.problem.subset(cells), cells.size / e.model_f.shape[0]
        each = np.where(some, each % parts, -1)
    step = _steps(e, problem, each, parts) * np.sqrt(share)
    return _widened(e, step, (number - fitted) if parts == number else parts - 1, 0.0)


def _widened(e: Optimum, step: np.ndarray, freedom: int, within: float) -> tuple[Optimum, str]:
    """The optimum with a jackknife's uncertainties where they are larger, and the largest factor as a text.

    Args:
        e: the optimum.
        step: changes (G, P) of the numbers without each of the clusters, NaN for what nothing else tells of.
        freedom: degrees of freedom of Student's quantile.
        within: variances for independent noise, so many times, that the jackknife holds beside its own.
    """
    from gonio.models.special.scipy_functions import stdtrit

    number, lost = step.shape[0], ~np.isfinite(step).all(axis=0)
    step = np.where(lost, 0.0, step)
    sums = (number - 1) / number * np.sum((step - step.mean(axis=0)) ** 2, axis=0)
    known = e.covariance.variance
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = sums * (stdtrit(freedom, 0.975) / NORMAL_95) ** 2 - within * known
        factor = np.sqrt(np.maximum(np.nan_to_num(variance / known, nan=1.0), 1.0))
    factor = np.where(e.active_bound, 1.0, np.where(lost, UNKNOWN, np.minimum(factor, UNKNOWN)))
    spread = e.covariance.stretched(factor, e.domains, e.p)
    widest = f"{factor.max():.2g}" if factor.max() < 1e3 else "more than 1000"
    return dataclasses.replace(e, covariance=spread), widest


def _clusters(readings: Readings, scaled: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, str]:
    """(number of the cluster of each cell (n,), what the clusters are): incidences, or blocks where these are few.

    An incidence is what an instrument sets and reads a ring or a plane at: other incidences would be other clusters.
    """
    incidence = np.round(np.stack([np.asarray(c, float) for c in readings.wi], axis=1), 6)
    number = np.unique(incidence, axis=0, return_inverse=True)[1].ravel()
    if number.max() + 1 >= FEWEST_INCIDENCES:
        return number, "incidences"
    block, size = blocks_of(readings, scaled, used)
    return block, f"blocks of {size} neighbouring readings"


def _steps(e: Optimum, problem: FitProblem, cluster: np.ndarray, number: int) -> np.ndarray:
    """Changes (G, P) of the free numbers where each of G clusters is left out, by one step; NaN if lost."""
    order = e.problem.order
    still = e.active_bound[order]
    p = e.p[None]

    def matrix_of(equations: NormalEquations) -> Arrow:
        return Arrow(*(a[0] for a in equations.matrix))

    whole = matrix_of(problem.normal_equations(p))
    steps = np.zeros((number, e.p.size))
    in_order = np.argsort(cluster, kind="stable")
    edges = np.searchsorted(cluster[in_order], np.arange(number + 1))
    for g in range(number):
        cells = in_order[edges[g] : edges[g + 1]]
        if not cells.size:
            continue
        part = problem.subset(cells).normal_equations(p)
        others = Arrow(*(a - b for a, b in zip(whole, matrix_of(part), strict=True))).restricted(~still)
        lengths = np.sqrt(np.maximum(others.diagonal(), 0.0))
        inverse = np.where(lengths > 0, 1.0 / np.where(lengths > 0, lengths, 1.0), 0.0)
        unit = others.scaled(inverse).plus_diagonal(np.full(e.p.size, DAMPING))
        step = unit.solved(np.where(still, 0.0, part.gradient[0]) * inverse) * inverse
        steps[g, order] = np.where(~still & (others.diagonal() <= SEEN * whole.diagonal()), np.nan, step)
    return steps
