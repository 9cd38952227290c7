"""How finely a fit averages its model over the discs of each reading: no more finely than its numbers can notice.

What is neglected at all readings, e of each in units of its noise, moves no combination of a fit's numbers by more than
√Σe² of its standard uncertainty [Cauchy–Schwarz on the projection by the normal equations]. Of all choices that keep
this sum, beside what even the finest rules leave, the one of fewest nodes is taken: each reading has the rule of least
nodes + λe².
"""

import dataclasses
import itertools
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.disc_averages import CUT, KINDS, OPPOSED, disc_rules, farthest_node, steps_of
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.pair_rules import LAYERED
from gonio.fitting.problem.parameterisation import Domains
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import transform, uses_cosine
from gonio.fitting.solver.lm_step import stationarity
from gonio.models.geometry.directions import Direction
from gonio.models.warps.disc_frames import pair_normal

ALLOWED = 0.3  # of a standard uncertainty: what all that is neglected may move a number by, at worst
UNNOTICED = 0.1  # of a standard uncertainty: a fit at the centres that averages move by no more stays as it is
LITTLE = 0.3  # of that: what the readings that each step leaves may neglect together
AGREED = 0.03  # of what two rules differ by: the least error of the finer one, however near the next one is
FINER = 0.1  # of the last known error: that of the rule above, which has none to be compared with
PEAK_MISSED = 2.0  # f at the mirror configuration over that at the nearest node, from which on a rule may miss a lobe
NEAR_MIRROR = 2.0  # sums of the half-angles
FEW, EVERY = 64, 16  # of so many readings and more with equal steps, every so manyth is looked at first
LAYERS = len(LAYERED)  # steps up to which rules are alike in all directions
UNIFORM = 3  # step of the rule that stands for all where numbers need only come near
MOST_NUMBERS = 256  # free numbers up to which their moves are looked at; of more, each reading counts by itself
CELLS = 1 << 17  # looked at together


class DiscChoice(NamedTuple):
    """Rule of each reading (n,), and how far, in standard uncertainties, what is neglected may move a number."""

    rules: np.ndarray
    neglected: float


@dataclasses.dataclass(frozen=True)
class _Moves:
    """How far changes of the model at the readings move the numbers of a fit at the centres, to first order.

    `compared` (n, C): T(f c) at the numbers p (P,); `inverse` (P, P): of the normal matrix.
    """

    problem: FitProblem
    p: np.ndarray
    compared: np.ndarray
    inverse: np.ndarray

    @classmethod
    def of(cls, problem: FitProblem, p: np.ndarray, values: np.ndarray) -> "_Moves":
        """Of a fit near p (P,), where the model has these values (n, C)."""
        normal = problem.normal_equations(p[None]).matrix.whole()[0]
        return cls(problem, p, problem.compared(values), _inverse(normal))

    def largest(self, cells: np.ndarray, change: np.ndarray) -> float:
        """The largest move of a number, in its standard uncertainties.

        Args:
            cells: where the model changes.
            change: (k, C) of their weighted residuals, in units of the noise.
        """
        weight = self.problem.weight[cells]
        target = self.compared[cells] - np.divide(change, weight, out=np.zeros_like(change), where=weight > 0)
        gradient = self.problem.compared_with(target, cells).normal_equations(self.p[None]).gradient[0]
        u = np.sqrt(np.maximum(np.diagonal(self.inverse), 1e-300))
        return float(np.max(np.abs(self.inverse @ gradient) / u))


@dataclasses.dataclass(frozen=True)
class DiscAverages:
    """Averages over the discs of light and detector in a fit of P numbers to n readings.

    Attributes:
        made: whether the fit made them.
        half_angles: of the discs, radians.
        rules: of each reading (n,), see `disc_averages`, as made or as needed.
        neglected: how many standard uncertainties what is neglected may move a number by.
        shift: the numbers (P,) at the discs' centres, less those of averages.
    """

    made: bool
    half_angles: tuple[float, float]
    rules: np.ndarray
    neglected: float
    shift: np.ndarray


def notices_discs(problem: FitProblem, p: np.ndarray, noise: float) -> bool:
    """Whether averages move any number of a fit that ended at p (P,), by the coarsest rule and as far as it sees.

    `noise`: standard deviation of the weighted residuals. A lobe that this rule may miss counts as noticed, and so does
    everything where numbers are too many for a matrix of them all.
    """
    n = problem.weight.shape[0]
    if p.size > MOST_NUMBERS:
        return True
    for first in range(0, n, CELLS):
        cells = np.arange(first, min(first + CELLS, n))
        part = problem.averaged(None, cells)
        if _Probes.of(part, p, part.model_values(p)).missed(1, np.arange(cells.size)).any():
            return True
    equations = problem.averaged(KINDS + _kinds(problem)).normal_equations(p[None])
    u = np.empty_like(p)
    u[problem.order] = noise * np.sqrt(np.diagonal(_inverse(equations.matrix.whole()[0])))
    return bool(np.any(np.abs(_step(problem, p, equations)) > UNNOTICED * u))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a normal matrix, each number in its own unit; without what no reading tells."""
    lengths = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(lengths, lengths), hermitian=True) / np.outer(lengths, lengths)


def step_towards(problem: FitProblem, p: np.ndarray) -> np.ndarray:
    """The Gauss–Newton step (P,) from p: how far averages move the numbers of a fit at the centres, to first order."""
    return _step(problem, p, problem.normal_equations(p[None]))


def moved_by(problem: FitProblem, p: np.ndarray, f: np.ndarray, change: np.ndarray) -> np.ndarray:
    """How far the numbers (P,) of a fit move, to first order, where its model's values f (n, C) change by so much.

    NaN where the model has no slopes.
    """
    compared = problem.compared(f + change)
    gradient = problem.retargeted(2 * problem.compared(f) - compared).normal_equations(p[None]).gradient[0]
    moved, matrix = np.full_like(p, np.nan), problem.normal_equations(p[None]).matrix.whole()[0]
    if np.isfinite(matrix).all():
        moved[problem.order] = _inverse(matrix) @ gradient
    return moved


def _step(problem: FitProblem, p: np.ndarray, equations: NormalEquations) -> np.ndarray:
    order = problem.order
    d = Domains(*(a[order] for a in problem.domains))
    measure = stationarity(d, p[None, order], equations)
    kept = ~(measure.active_bound | measure.zero_sensitivity)[0]
    step = np.empty_like(p)
    step[order] = equations.matrix.restricted(kept).solved(np.where(kept, -equations.gradient, 0.0))[0]
    return step


def choose_rules(problem: FitProblem, p: np.ndarray, noise: float) -> DiscChoice:
    """The rules that a fit near p (P,) needs, whose weighted residuals have this standard deviation."""
    n = problem.weight.shape[0]
    errors, kinds = [], []
    for first in range(0, n, CELLS):
        part = problem.averaged(None, np.arange(first, min(first + CELLS, n)))
        # Parts that all neglect alike neglect together: by the root of their share, their sum stays within it.
        error, kind = _errors(part, p, noise, ALLOWED * np.sqrt(part.weight.shape[0] / n))
        errors.append(error)
        kinds.append(kind)
    error, kind = np.concatenate(errors, axis=1), np.concatenate(kinds)
    steps = _cheapest(error, problem, kind)
    neglected = np.take_along_axis(error, steps[None], axis=0)[0]
    rules = np.where(steps > 0, KINDS * steps + np.where((kind == OPPOSED) & (steps <= LAYERS), 0, kind), 0)
    return DiscChoice(rules, float(np.sqrt(np.sum(neglected**2))))


def uniform_rules(problem: FitProblem) -> np.ndarray:
    """The same rule (n,) for all readings, fine enough to bring numbers near to their own."""
    return KINDS * UNIFORM + _kinds(problem)


def _weight(problem: FitProblem, f: np.ndarray) -> np.ndarray:
    """Slope (n, C) of each weighted residual by the model's value, at values f (n, C)."""
    c = problem.readings.cos_i[:, None] if uses_cosine(problem.loss) else 1.0
    return problem.weight * transform(problem.loss, f * c, problem.floor, np)[1] * c


def _kinds(problem: FitProblem) -> np.ndarray:
    """Kind (n,) of the readings' rules: `CUT` where the horizon cuts a disc, else 0."""
    cosines = (np.abs(np.asarray(w.z)) for w in (problem.readings.wi, problem.readings.wo))
    discs = zip(cosines, problem.readings.half_angles, strict=True)
    return np.where(np.any([c < np.sin(s) for c, s in discs if s > 0], axis=0), CUT, 0)


def _opposed(problem: FitProblem, p: np.ndarray) -> np.ndarray:
    """Which readings (n,) change more as wi − wo does than as the half vector does: second differences within discs."""
    (wi, side_i), (wo, side_o) = (_in_front(w) for w in (problem.readings.wi, problem.readings.wo))
    normal = np.stack(pair_normal(Direction(*wi), Direction(*wo), np))
    shift_i, shift_o = 0.5 * np.tan(problem.readings.half_angles)
    lights, detectors = [], []
    for along, a, b in itertools.product((True, False), (1.0, -1.0), (1.0, -1.0)):
        of_i, of_o = (np.cross(normal, w, axis=0) if along else normal for w in (wi, wo))
        lights.append(_unit(wi + a * shift_i * of_i))
        detectors.append(_unit(wo + b * shift_o * of_o))
    rays = [np.stack(r, axis=1) for r in (lights, detectors)]
    for r, side in zip(rays, (side_i, side_o), strict=True):
        r[2] *= side
    f = problem.values_at(p, *(Direction(*r.reshape(3, -1)) for r in rays)).reshape(2, 2, 2, wi.shape[1], -1)
    centre = 2 * problem.model_values(p)
    of_sums, of_differences = f[:, 0, 0] + f[:, 1, 1] - centre, f[:, 0, 1] + f[:, 1, 0] - centre
    return np.sum(np.abs(of_differences), axis=(0, 2)) > np.sum(np.abs(of_sums), axis=(0, 2))


def _in_front(w: Direction) -> tuple[np.ndarray, np.ndarray]:
    """Directions (3, n), mirrored to the front where they are behind, and which side (n,) they were on."""
    components = np.stack([np.asarray(c) for c in w])
    side = np.where(components[2] < 0, -1.0, 1.0)
    components[2] *= side
    return components, side


def _cheapest(error: np.ndarray, problem: FitProblem, kinds: np.ndarray) -> np.ndarray:
    """The step (n,) of each reading, of errors (steps, n): fewest nodes in all that keep `ALLOWED`.

    What is left of a reading at its best step counts apart: where one has no rule that is fine enough, finer ones at
    all others would not make up for it.
    """
    steps = np.zeros(error.shape[1], int)
    known = np.flatnonzero(np.isfinite(error[1]))
    if not known.size or np.sum(error[0] ** 2) <= ALLOWED**2:
        return steps
    sizes = disc_rules(problem.readings.half_angles).sizes
    # Readings that stopped at the same step together: those with many steps are few.
    length, groups = np.isfinite(error[:, known]).sum(axis=0), []
    for last, kind in itertools.product(np.unique(length).tolist(), range(KINDS)):
        cells = known[(length == last) & (kinds[known] == kind)]
        if cells.size:
            squares = error[:last, cells] ** 2
            groups.append((cells, sizes[kind : KINDS * last : KINDS, None], squares - squares.min(axis=0)))
    log2 = _multiplier(groups, ALLOWED**2)
    for cells, nodes, squares in groups:
        steps[cells] = np.argmin(nodes + 2.0**log2 * squares, axis=0)
    return steps


def _multiplier(groups: list[tuple[np.ndarray, np.ndarray, np.ndarray]], budget: float) -> float:
    """log₂ λ with which the squares that remain keep a budget, and hardly more nodes are taken than that needs.

    Args:
        groups: (readings (n,), nodes of each step (steps, 1), squares (steps, n)).
        budget: of the sum of squares.
    """

    def remaining(log2: float, every: int) -> float:
        total = 0.0
        for cells, nodes, squares in groups:
            some = squares[:, :: every if cells.size > FEW * every else 1]
            chosen = np.argmin(nodes + 2.0**log2 * some, axis=0)
            total += float(np.sum(some[chosen, np.arange(chosen.size)])) * cells.size / some.shape[1]
        return total

    low, high = -20.0, 60.0
    for _ in range(10):  # of some
        middle = 0.5 * (low + high)
        low, high = (low, middle) if remaining(middle, EVERY) <= budget else (middle, high)
    while high < 60.0 and remaining(high, 1) > budget:
        high += 0.1
    return high


def _errors(problem: FitProblem, p: np.ndarray, noise: float, allowed: float) -> tuple[np.ndarray, np.ndarray]:
    """Error (steps, n) of each rule in units of the noise, as it differs from the next; and the rules' kinds (n,).

    Errors are inf beyond what is needed.

    Steps end where together they move no number by more than `allowed`, in standard uncertainties. Cells whose errors e
    are the smallest, up to √Σe² = `LITTLE` of that, go no further at each step.
    """
    n, steps = problem.weight.shape[0], steps_of(problem.readings.half_angles)
    values = problem.model_values(p)
    weight = _weight(problem, values) / noise
    kinds, probes, moves = _kinds(problem), _Probes.of(problem, p, values), None
    if 0 < p.size <= MOST_NUMBERS:
        moves = _Moves.of(problem, p, values)
    most = np.where(kinds == CUT, steps[1], steps[0])
    error = np.full((max(steps), n), np.inf)
    cells, before = np.arange(n), np.zeros(n)
    for step in range(1, max(steps)):
        if step == LAYERS + 1 and min(problem.readings.half_angles) > 0:
            whole = cells[kinds[cells] != CUT]
            kinds[whole[_opposed(problem.averaged(None, whole), p)]] = OPPOSED
        finer = problem.averaged(KINDS * step + kinds, cells).model_values(p)
        e = np.sqrt(np.sum((weight[cells] * (finer - values[cells])) ** 2, axis=1))
        # Two rules that are both too coarse may agree by accident: three do not.
        floor = (AGREED if step > 2 else AGREED**2) * before[cells]
        before[cells] = e
        hidden = probes.missed(step, cells)
        moved = np.inf
        if moves is not None and not hidden.any():
            moved = moves.largest(cells, weight[cells] * (finer - values[cells]))
        e = np.maximum(np.maximum(e, floor), np.sqrt(np.sum((weight[cells] * hidden) ** 2, axis=1)))
        e = np.nan_to_num(e, nan=0.0, posinf=1e9)
        if moved <= allowed:  # whatever single readings neglect, together they move no number
            e *= moved / max(float(np.sqrt(np.sum(e**2))), 1e-300)
        error[step - 1, cells], error[step, cells], values[cells] = e, FINER * e, finer
        if moved <= allowed:
            break
        ascending = np.sort(e)
        small = int(np.searchsorted(np.cumsum(ascending**2), (LITTLE * allowed) ** 2))
        if small == cells.size:
            break
        cells = cells[e >= ascending[small]]
        cells = cells[most[cells] > step + 1]
        if not cells.size:
            break
    return error, kinds


class _Probes(NamedTuple):
    """Pairs of directions within the discs that are nearest to mirror reflection, where f is far above the centres'."""

    cells: np.ndarray  # (m,)
    f: np.ndarray  # (m, C)
    beside: np.ndarray  # (steps, m, C)

    @classmethod
    def of(cls, problem: FitProblem, p: np.ndarray, values: np.ndarray) -> "_Probes":
        """The probes of a model whose values at the centres are these (n, C)."""
        wi, wo = (np.stack([np.asarray(c) for c in w]) for w in (problem.readings.wi, problem.readings.wo))
        s_i, s_o = problem.readings.half_angles
        # Of what goes through, to straight through.
        through = np.where(wi[2] * wo[2] < 0, -1.0, 1.0)
        apart = (wi[0] + wo[0]) ** 2 + (wi[1] + wo[1]) ** 2 + (through * wi[2] - wo[2]) ** 2
        # A lobe that hides in a disc is narrower than it: farther off there is none.
        cells = np.flatnonzero(apart < (2 * np.sin(min(0.5 * NEAR_MIRROR * (s_i + s_o), 0.5 * np.pi))) ** 2)
        wi, wo, through = wi[:, cells], wo[:, cells], through[cells]
        turned = np.stack([-np.ones_like(through), -np.ones_like(through), through])
        reach = np.maximum(2 * np.arcsin(np.minimum(0.5 * np.sqrt(apart[cells]), 1.0)), max(s_i + s_o, 1e-30))
        wi, wo = _unit(wi + s_i / reach * (turned * wo - wi)), _unit(wo + s_o / reach * (turned * wi - wo))
        f = problem.values_at(p, Direction(*wi), Direction(*wo))
        high = (np.abs(f) > PEAK_MISSED * np.abs(values[cells])).any(axis=1)
        return cls(cells[high], f[high], _beside(problem, p, wi[:, high], wo[:, high]))

    def missed(self, step: int, cells: np.ndarray) -> np.ndarray:
        """f (len(cells), C) of lobes that a rule's nodes may all miss; 0 where they cannot."""
        hidden = np.zeros((cells.size, self.f.shape[1]))
        peaked = np.flatnonzero(np.isin(self.cells, cells))
        f = self.f[peaked]
        missed = np.abs(f) > PEAK_MISSED * self.beside[step - 1, peaked]
        hidden[np.searchsorted(cells, self.cells[peaked])] = np.where(missed, f, 0.0)
        return hidden


def _beside(problem: FitProblem, p: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """|f| (steps, m, C) as far from the mirror configuration as each step's nodes may be; the lower of two ways."""
    half_angles = problem.readings.half_angles
    distance = np.array([farthest_node(half_angles, step) for step in range(1, max(steps_of(half_angles)))])
    if not wi.shape[1]:
        return np.zeros((distance.size, 0, problem.weight.shape[1]))
    sine = np.maximum(np.hypot(wo[0], wo[1]), 1e-12)
    across = np.stack([-wo[1], wo[0], np.zeros_like(sine)]) / sine
    # Inwards: towards the normal, so that nothing falls below the horizon.
    up = np.sign(wo[2]) * np.cross(wo, across, axis=0)
    # (axes, steps, two ways, m)
    rays = _unit(wo[:, None, None] + distance[:, None, None] * np.stack([across, up], axis=1)[:, None])
    lights = np.broadcast_to(wi[:, None, None], rays.shape)
    f = problem.values_at(p, Direction(*lights.reshape(3, -1)), Direction(*rays.reshape(3, -1)))
    return np.abs(f).reshape(*rays.shape[1:], -1).min(axis=1)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=0)
