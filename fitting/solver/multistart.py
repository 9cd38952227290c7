"""Multi-start descents: starts from the expression, from the data and at random, on levels of growing size.

All starts are descended on few cells, the best ends on more, the last on all. Shapes are guessed; what the model is
proportional to (albedos, scales) then follows from the data by non-negative least squares, so that no descent begins
with a lobe of the wrong strength.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

from gonio.fitting.problem.arrow import WHOLE, Arrow, joined
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Domains, Parameterisation, evenly
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import LANES, coarse_cells
from gonio.fitting.solver.levenberg_marquardt import Descent, Stopping, minimise
from gonio.fitting.solver.lm_step import eps

COARSE = 512
EACH, FEW = 48, 4  # samples for each free number, where these are many, of so many channels
ROUGH = 1e4  # of the aim, where more readings follow
MIDDLE = 1 << 16
WORTHWHILE = 3  # times as many readings as a level has samples, for that level to spare anything
MOST_ENDS = 3  # descents that go on
CLOSE = 1.05  # of the best cost on the middle level: what may still be the best on all readings
ROUNDINGS = 16.0  # of what is compared, by which two costs of one minimum may differ
SAME_COST = 1e-6  # relative difference of two costs that are one minimum
WIDTHS = (0.02, 0.06, 0.15, 0.35, 0.7)
APART = {"alpha_x": 0.8, "alpha_y": 1.25}  # widths along x and y begin apart: equal ones look alike from either side
NARROWEST = 0.01  # of the random widths: a narrower lobe is reached from there, a hidden one from nowhere
MOST_GUESSES = 12
DATA_STARTS = 3
ROUNDS = 3  # in which the best numbers of each channel are put together


@dataclasses.dataclass(frozen=True)
class Search:
    """The best descent on all readings; the ends of all starts on the coarse `cells`, and how many of them agree."""

    best: Descent
    ends: list[Descent]
    agreed: int
    cells: np.ndarray


def search(problem: FitProblem, given: np.ndarray, starts: int, seed: int) -> Search | None:
    """The best descent from the starts of the data and random ones; None where no start has a finite cost.

    Args:
        problem: all readings.
        given: start of each free number (P,), NaN where none is given.
        starts: number of random starts.
        seed: of the random starts and of the subsamples.
    """
    n = problem.weight.shape[0]
    enough = max(COARSE, EACH * np.unique(problem.parameters.columns[:FEW]).size)
    cells = coarse_cells(problem.readings, enough, seed) if n > WORTHWHILE * enough else np.arange(n)
    coarse = problem.subset(cells)
    # Of many channels some end in a minimum of their own: such a descent would go on long, and cannot win.
    many, rough = problem.parameters.sizes.total > WHOLE, 1.0 if coarse is problem else ROUGH
    ends = minimise(coarse, starting_points(coarse, given, starts, seed), Stopping(rough=rough, rivals=many))
    best = _best(ends)
    if best is None:
        return None
    if many:
        ends += _recombined(coarse, ends, best, rough)
        best = _best(ends) or best
    agreed = sum(end.cost <= best.cost + _margin(best.cost, coarse.target_norm_squared) for end in ends)
    if coarse is problem:
        return Search(best, ends, agreed, cells)
    rest = distinct(ends, coarse.target_norm_squared)
    if n > WORTHWHILE * MIDDLE:
        some = np.sort(np.random.default_rng(seed).choice(n, MIDDLE, replace=False, shuffle=False))
        rest = minimise(problem.subset(some), [e.p for e in rest], Stopping(near=True, rough=ROUGH, rivals=True))
        least = min(e.cost for e in rest)
        rest = [e for e in distinct(rest, problem.target_norm_squared) if e.cost <= CLOSE * least] or rest
    best = _best(minimise(problem, [e.p for e in rest], Stopping(near=True, rivals=True))) or best
    return Search(best, ends, agreed, cells)


def _recombined(problem: FitProblem, ends: list[Descent], best: Descent, rough: float) -> list[Descent]:
    """Descents from the best numbers of each channel, whichever descent found them, with the best shared numbers.

    A joint descent from shapes at random has some channels in the wrong valley where there are many of them.
    """
    s, better = problem.parameters, []
    if all(g.linear for g in s.free if g.per_channel):
        return better
    each = np.sort(s.order[s.sizes.shared :].reshape(s.channels, -1))
    for _ in range(ROUNDS):
        p = np.tile(best.p, (min(len(ends), LANES), 1))
        p[:, each] = np.stack([end.p for end in ends[: len(p)]])[:, each]
        costs = problem.channel_costs(np.concatenate([best.p[None], p])[:LANES])
        chosen = np.argmin(np.where(np.isfinite(costs), costs, np.inf), axis=0)
        if not chosen.any():
            break
        start = best.p.copy()
        for c in np.flatnonzero(chosen):
            start[each[c]] = p[chosen[c] - 1, each[c]]
        end = minimise(problem, [start], Stopping(rough=rough))[0]
        if not end.cost < best.cost - _margin(best.cost, problem.target_norm_squared):
            break
        best, better = end, [*better, end]
    return better


def distinct(ends: list[Descent], target_norm_squared: float) -> list[Descent]:
    """The best descents of different cost, at most `MOST_ENDS`, none more than half above the best."""
    kept: list[Descent] = []
    for end in sorted((e for e in ends if np.isfinite(e.cost)), key=lambda e: e.cost):
        if kept and end.cost > 1.5 * kept[0].cost + 1e-20 * target_norm_squared:
            break
        if all(end.cost > other.cost + _margin(other.cost, target_norm_squared) for other in kept):
            kept.append(end)
    return kept[:MOST_ENDS]


def _margin(cost: float, target_norm_squared: float) -> float:
    rounding = ROUNDINGS * eps() * float(np.sqrt(max(cost, 0.0) * target_norm_squared))
    return SAME_COST * cost + 1e-20 * target_norm_squared + rounding


def _best(ends: list[Descent]) -> Descent | None:
    return min((e for e in ends if np.isfinite(e.cost)), key=lambda e: e.cost, default=None)


def starting_points(problem: FitProblem, given: np.ndarray, random: int, seed: int) -> list[np.ndarray]:
    """At most `DATA_STARTS` starts (P,) that suit the data best, and so many `random` ones; `given` NaN where open."""
    s = problem.parameters
    guesses = width_guesses(s, given)
    same = all(g.linear for g in s.free)  # linear in all its free numbers: every start is the same
    shapes = guesses + ([] if same else random_shapes(problem, given, random, seed))
    solved = solve_linear(problem, shapes)
    best = [p for p, _ in sorted(solved[: len(guesses)], key=lambda start: start[1])][:DATA_STARTS]
    return best[:1] if same else best + [p for p, _ in solved[len(guesses) :]]


def width_guesses(s: Parameterisation, given: np.ndarray) -> list[np.ndarray]:
    """Vectors (P,) of free numbers with shapes on a small grid of widths; linear numbers are still NaN."""
    widths = [g for g in s.free if g.info.role == "width" and np.isnan(given[g.first])]
    terms = sorted({g.term for g in widths})
    choices = list(itertools.product(WIDTHS, repeat=len(terms)))
    if len(terms) > 1:
        # Lobes of one kind are interchangeable: only rising widths, and never two equal ones.
        choices = [c for c in choices if all(a < b for a, b in itertools.pairwise(c))] or choices
    usual = s.each(lambda g: np.nan if g.linear else g.info.start)
    low, high = (s.each(lambda g, b=b: getattr(g.info, b)) for b in ("low", "high"))
    guesses = []
    for choice in choices[:: max(1, -(-len(choices) // MOST_GUESSES))]:
        p = given.copy()
        for g in widths:
            p[s.of(g)] = choice[terms.index(g.term)] * APART.get(g.path.rpartition(".")[2], 1.0)
        p = np.where(np.isnan(p), usual, p)
        guesses.append(np.where(np.isnan(p), p, np.clip(p, low, high)))
    return guesses


def random_shapes(problem: FitProblem, given: np.ndarray, number: int, seed: int) -> list[np.ndarray]:
    """Vectors (P,) with every shape at random in its domain, evenly in the coordinate of its map."""
    s, d, rng = problem.parameters, problem.domains, np.random.default_rng(seed)
    low = s.each(lambda g: max(g.info.low, NARROWEST) if g.info.role == "width" else g.info.low)
    return [np.where(s.linear, given, evenly(d._replace(low=low), rng.random(s.size))) for _ in range(number)]


def solve_linear(problem: FitProblem, shapes: Sequence[np.ndarray]) -> list[tuple[np.ndarray, float]]:
    """(p with its open linear numbers solved, weighted sum of squares) at each shape; ∞ where it is not finite.

    Non-negative least squares in the measure of the loss, made linear at the readings.
    """
    s, plain = problem.parameters, problem.linearised()
    of_channel = np.sqrt(np.sum((plain.weight * problem.readings.f) ** 2, axis=0))
    every = float(np.sqrt(np.sum(of_channel**2)))
    # Size of the weighted readings that each free number acts on.
    reach = np.array([of_channel[c] if g.per_channel else every for g in s.free for c in range(s.count(g))])
    solved = []
    for first in range(0, len(shapes), LANES):
        p = np.stack(shapes[first : first + LANES])
        unknown = s.linear & np.isnan(p[0])
        p = np.where(np.isnan(p), 1.0, p)
        solved += solve_amounts(plain.normal_equations(p, plain=True), s.order, p, unknown, reach, plain.domains)
    return solved


def solve_amounts(
    equations: NormalEquations, order: np.ndarray, p: np.ndarray, unknown: np.ndarray, reach: np.ndarray, d: Domains
) -> list[tuple[np.ndarray, float]]:
    """(p with some numbers from non-negative least squares, weighted sum of squares) of each p (S, P).

    Args:
        equations: of a model that is linear in these numbers, at p.
        order: of the numbers in the equations (P,).
        p: numbers of S models.
        unknown: which numbers to solve for (P,).
        reach: size of the weighted readings that each number acts on, (P,).
        d: domains of the numbers.
    """
    finite = np.isfinite(equations.cost) & np.isfinite(equations.gradient).all(1)
    with np.errstate(invalid="ignore"):
        finite &= np.isfinite(sum(a.sum((-2, -1)).reshape(len(p), -1).sum(1) for a in equations.matrix))
    matrix = Arrow(*(np.where(finite.reshape(-1, *[1] * (a.ndim - 1)), a, 0.0) for a in equations.matrix))
    gradient, now, kept = np.where(finite[:, None], equations.gradient, 0.0), p[:, order], unknown[order]
    amount = _non_negative(matrix, np.asarray(matrix.mv(np.where(kept, now, 0.0))) - gradient, kept)
    change = np.where(kept, amount - now, 0.0)
    gain = np.sum(change * (gradient + 0.5 * matrix.mv(change)), axis=1)
    # Not at the bound itself: there a start would see no slope.
    size = np.sqrt(matrix.diagonal())
    amount = np.maximum(amount, 1e-3 * reach[order] / np.where(size > 0, size, np.inf))
    p = p.copy()
    p[:, order] = np.where(kept, np.clip(amount, d.low[order], d.high[order]), now)
    cost = np.where(finite, equations.cost + gain, np.inf)
    return list(zip(p, (2.0 * cost).tolist(), strict=True))


def _non_negative(matrix: Arrow, vector: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Least squares with x ≥ 0 of normal equations, in the numbers that are `kept` (P,).

    The most negative number is dropped in turn, of the shared ones and of those of each channel.
    """
    length2, s = matrix.diagonal(), matrix.sizes
    kept, x = kept & (length2 > 0), np.zeros_like(vector)
    for _ in range(s.shared + s.per_channel):
        # A little more than nothing, for lobes that are the same.
        system = matrix.restricted(kept).plus_diagonal(np.where(kept, 1e-12 * length2, 0.0))
        x = system.solved(np.where(kept, vector, 0.0))
        if not (x < 0).any():
            break
        lowest = joined(*(a <= a.min(axis=-1, keepdims=True, initial=0.0) for a in matrix.parts(x)))
        kept &= ~(lowest & (x < 0))
    return np.maximum(np.nan_to_num(x), 0.0)
