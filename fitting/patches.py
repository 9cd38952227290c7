"""Fits of files whose values are means over patches of directions: the model is averaged over the patches, too.

    value of a pair of patches = ∫∫ f cosθi cosθo dωi dωo / (∫ cosθi dωi · ∫ cosθo dωo)

The readings are brought to the middles of their patches by what the fitted model's means differ from its values there,
and fitted again, until the numbers stay. At that point the residuals are those of the means; the numbers' uncertainties
are those of the fit at the middles, times (1 − G)⁻¹, where G is how the numbers of a fit follow those that brought its
readings to the middles.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from gonio.data.interpolation.sheets import sheet_of
from gonio.data.table import Table
from gonio.fitting.fit_model import FitTask, fit_model
from gonio.fitting.solver.disc_choice import moved_by, step_towards
from gonio.fitting.uncertainty.optimum import Optimum
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Term
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.low_discrepancy import low_discrepancy

EVALUATIONS = 1 << 21
"""Of the model in all patches together, once for each set of numbers."""
PARTS = 4
"""Of the places, whose means are compared for the error of that over all."""
FEWEST, MOST = 4, 16
"""Places in a pair of patches in each part."""
REFITS = 4
ROUNDS = 16
SETTLED = 0.1
"""Standard uncertainties that a number may still move by."""
FARTHEST = 0.4
"""Relative change of a number in one step."""
FINEST = 1e-5
"""Of a number, what it may move by in any case: means are not made more exactly."""
SHARES = (1.0, 0.5, 0.25, 0.1)
"""Of a step, the first of which that leaves less is taken."""
STEP = 1e-3
"""Relative change of a number by which slopes are computed."""
NEVER = "a file's values are means over patches of directions, and the model was compared at their middles"


class PatchFit(NamedTuple):
    """The optima of a task, the task on the readings as they were fitted, and sentences about it."""

    optima: list[Optimum]
    task: FitTask
    notes: list[str]


@dataclasses.dataclass(frozen=True)
class Patches:
    """Places in the patches of the n cells that are fitted: (wi, wo) of (places · n,), in `PARTS` parts."""

    pairs: list[tuple[Direction, Direction]]

    @classmethod
    def of(cls, table: Table, task: FitTask) -> "Patches | None":
        """Those of a file of patches; None for all other tables."""
        sheet = sheet_of(table)
        if sheet is None:
            return None
        settings, size = task.settings, table.layout.size
        limit = size if settings.samples is None else settings.samples
        cells = table.some_valid_cells(limit, settings.theta_max, settings.seed)
        turned = np.random.default_rng(settings.seed).random((size, 4))
        places = int(np.clip(EVALUATIONS // (PARTS * size), FEWEST, MOST))
        pairs = []
        for part in np.split(low_discrepancy(PARTS * places, 4), PARTS):
            angles = [np.stack(sheet.directions((turned + u) % 1.0))[:, cells] for u in part]
            theta_i, phi_i, theta_o, phi_o = np.concatenate(angles, axis=1)
            pairs.append((from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)))
        return cls(pairs)


@dataclasses.dataclass(frozen=True)
class PatchMeans:
    """A model's means over patches, for the free numbers of an optimum, of these terms; `f` (n, C): the readings."""

    e: Optimum
    terms: tuple[Term, ...]
    patches: Patches
    f: np.ndarray

    def values(self, p: np.ndarray, wi: Direction, wo: Direction) -> np.ndarray:
        """The model's f (m, C), for numbers p (P,)."""
        f = np.asarray(evaluate(build(self.e.parameters.filled(self.terms, [p])), wi, wo))
        return np.broadcast_to(f.reshape(len(f), -1), (len(f), self.e.problem.weight.shape[1]))

    def parts(self, p: np.ndarray) -> np.ndarray:
        """Means over parts of the places in the patches (`PARTS`, n, C)."""
        shape = self.e.problem.weight.shape
        return np.stack([self.values(p, *pair).reshape(-1, *shape).mean(axis=0) for pair in self.patches.pairs])

    def shift(self, p: np.ndarray) -> np.ndarray:
        """Means over the patches less the values at their middles (n, C)."""
        return self.parts(p).mean(axis=0) - self.values(p, self.e.readings.wi, self.e.readings.wo)

    def follows(self, p: np.ndarray) -> np.ndarray:
        """How the numbers (P, P) of a fit at the middles move back with those, p, of the means."""
        follows, f, shift = np.zeros((p.size, p.size)), self.e.problem.model_values(p), self.shift(p)
        for k in range(p.size):
            step = STEP * max(abs(p[k]), STEP)
            step = -step if p[k] + step > self.e.domains.high[k] else step
            changed = p.copy()
            changed[k] += step
            follows[:, k] = moved_by(self.e.problem, p, f, self.shift(changed) - shift) / step
        return follows

    def nearest(self) -> np.ndarray:
        """Numbers (P,) by which the means are nearest to the readings, by Gauss–Newton steps."""
        e = self.e
        p, u, known = e.p.copy(), np.maximum(e.covariance.standard, FINEST * np.abs(e.p)), _known(e)
        some, cost = np.ix_(known, known), self.cost(p)
        for _ in range(ROUNDS):
            step = step_towards(e.problem.retargeted(e.problem.compared(self.f - self.shift(p))), p)
            turned = np.eye(int(known.sum())) + self.follows(p)[some]
            if not (np.isfinite(turned).all() and np.isfinite(step[known]).all()):  # the model has no slopes there
                break
            step[known] = np.linalg.lstsq(turned, step[known])[0]
            step[~known] = 0.0
            before, most = p, FARTHEST * np.maximum(np.abs(p), FARTHEST)
            for share in SHARES:
                p = np.clip(before + share * np.clip(step, -most, most), e.domains.low, e.domains.high)
                if (less := self.cost(p)) <= cost:
                    break
            cost = less
            if np.all(np.abs(p - before)[known] < SETTLED / 2 * u[known]):
                break
        return p

    def cost(self, p: np.ndarray) -> float:
        """Σ r² of the means, for numbers p (P,)."""
        problem, f = self.e.problem, self.parts(p).mean(axis=0)
        with np.errstate(invalid="ignore"):
            residuals = problem.weight * (problem.compared(f) - problem.compared(self.f))
        return float(np.sum(np.where(problem.weight > 0, residuals, 0.0) ** 2))

    def widening(self) -> np.ndarray:
        """By how much (P,) the uncertainties of the means, and of a fit of them, exceed those at the middles.

        NaN where the model has no slopes.
        """
        e, known = self.e, _known(self.e)
        factor = np.ones(e.p.size)
        if not known.any():
            return factor
        some = np.ix_(known, known)
        spread = np.nan_to_num(e.covariance.matrix()[some])
        follows = self.follows(e.p)[some]
        if not np.isfinite(follows).all():
            return np.full(e.p.size, np.nan)
        turned = np.linalg.pinv(np.eye(int(known.sum())) + follows)
        parts = self.parts(e.p)
        off = [moved_by(e.problem, e.p, e.model_f, part - parts.mean(axis=0))[known] for part in parts]
        errors = np.square(turned @ np.transpose(off)).sum(axis=1) / (PARTS * (PARTS - 1))
        whole = np.diagonal(turned @ spread @ turned.T) + errors
        factor[known] = np.sqrt(np.maximum(whole / np.diagonal(spread), 1.0))
        return factor


def fit_at_middles(task: FitTask, table: Table) -> PatchFit:
    """The fit at the directions of the readings; of a file of patches it says so."""
    return PatchFit(fit_model(task), task, [] if sheet_of(table) is None else [NEVER])


def fit_patches(task: FitTask, patches: Patches) -> PatchFit:
    """The fit of means over patches; where it does not settle, that at their middles, widened by how far it moves."""
    optima = at_middles = fit_model(task)
    if task.settings.aperture == "ignore" or not any(e.p.size for e in optima):
        return PatchFit(optima, task, [NEVER])
    expected, f = optima, task.readings.f
    for _ in range(REFITS):
        each = _means(task, optima, patches)
        near = [m.nearest() for m in each]
        shift = np.concatenate([m.shift(p) for m, p in zip(each, near, strict=True)], axis=1)
        centred = dataclasses.replace(task, readings=dataclasses.replace(task.readings, f=f - shift))
        optima = fit_model(centred)
        expected = [dataclasses.replace(e, p=p) for e, p in zip(optima, near, strict=True)]
        if max(float(np.max(off, initial=0.0)) for off in _moves(expected, optima)) < SETTLED:
            factors = [m.widening() for m in _means(task, optima, patches)]
            if not all(np.isfinite(each).all() for each in factors):
                break
            spread = [_stretched(e, each) for e, each in zip(optima, factors, strict=True)]
            return PatchFit(spread, centred, [_sentence(at_middles, spread)])
    off = _moves(at_middles, expected)
    note = (
        f"{NEVER}: a lobe is too narrow to be averaged over them, and by estimate a number is "
        f"{max(float(np.max(a, initial=0.0)) for a in off):.2g} standard uncertainties off, by which it is widened"
    )
    return PatchFit([_stretched(e, np.sqrt(1.0 + a**2)) for e, a in zip(at_middles, off, strict=True)], task, [note])


def _means(task: FitTask, optima: list[Optimum], patches: Patches) -> list[PatchMeans]:
    """The means of a task's optima: one of all channels, or one of each."""
    apart = len(optima) > 1
    tasks = [task.channel(c) for c in range(len(optima))] if apart else [task]
    return [PatchMeans(e, t.terms, patches, t.readings.f) for e, t in zip(optima, tasks, strict=True)]


def _moves(before: list[Optimum], after: list[Optimum]) -> list[np.ndarray]:
    """How far each number (P,) moved in its standard uncertainties; 0 of those that are not determined."""
    moves = []
    for a, b in zip(before, after, strict=True):
        u, known = np.maximum(b.covariance.standard, FINEST * np.abs(b.p)), _known(b)
        moves.append(np.divide(np.abs(a.p - b.p), u, out=np.zeros(u.size), where=known))
    return moves


def _known(e: Optimum) -> np.ndarray:
    """Which numbers (P,) have a standard uncertainty."""
    u = e.covariance.standard
    return np.isfinite(u) & (u > 0) & ~e.covariance.undetermined & ~e.active_bound


def _stretched(e: Optimum, factor: np.ndarray) -> Optimum:
    """With the standard uncertainties times factors (P,)."""
    spread = e.covariance.stretched(factor, e.domains, e.p)
    return dataclasses.replace(e, covariance=spread, reach=e.reach * factor)


def _sentence(middles: list[Optimum], means: list[Optimum]) -> str:
    """What was done, and by how much it matters."""
    shifts = [
        (abs(a.p[k] - b.p[k]) / u, b.parameters.labels[k][0], a.p[k] - b.p[k])
        for a, b in zip(middles, means, strict=True)
        for k, u in enumerate(b.covariance.standard)
        if np.isfinite(u) and u > 0
    ]
    done = "the model is averaged over the patches of directions over which the file's values are means"
    if not shifts:
        return done
    size, name, shift = max(shifts)
    away = "large" if shift > 0 else "small"
    return f"{done}; at their middles {name} is {abs(shift):.2g} ({size:.2g} standard uncertainties) too {away}"
