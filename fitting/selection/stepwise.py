"""Forward stepwise model selection from Lambert, with backward elimination.

One lobe or free number is added at a time (`moves`) while BIC and cross-validated χ² both improve. All candidates of a
step are descended on few readings, and the best of them are compared with one noise and one effective number of
readings (`criteria`), on one sample of the readings, by programs that they share (`candidate_model`); only the selected
one is fitted to all readings. One that reflects more than it receives gives way to one as good that does not.
"""

import dataclasses
import functools
import time
from collections.abc import Callable, Iterable

import numpy as np

from gonio.fitting.problem.readings import Readings, coarse_cells, evenly_spaced, floor_of, uses_cosine
from gonio.fitting.residuals.energy import CREATES, largest_albedo
from gonio.fitting.selection import criteria
from gonio.fitting.selection.candidate import ROUNDING, Candidate, SelectionResult
from gonio.fitting.selection.candidate_model import CandidateProblem, SelectionData
from gonio.fitting.selection.moves import TRANSMITTING, Moves, moves_for
from gonio.fitting.selection.term_spec import Terms
from gonio.fitting.selection.warm_start import Fitted, carried, fit_candidates
from gonio.models.compiled.program_memory import free_programs
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction

SAMPLE = 1024
MAX_CHANNELS = 4  # of many wavelengths so many, evenly spaced, select the structure of all
SCREENED = 512  # readings by which the candidates of a step are compared before the best of them are fitted
FINALISTS = 3
ROUGHLY, ENOUGH = 2.0, 0.05  # ½χ² that a further step may be worth, on few readings and on all of the sample
STRUCTURED = 1.2  # χ² over its expectation from which on residuals are structure
CLUSTERED = 2.0  # design effect from which on they are: what neighbours share is then some 0.4 of the noise
LEAST_SIGMA = 1e-6  # of the rms of the known uncertainties
LEAST_DISPERSION = 1e-3  # of a noise from neighbours: below it a fit is one through the readings
SAME_NOISE = 0.05  # mean difference of the logarithms of two noises that do not call for a second walk
PATIENCE = 2  # growths of models that held-out directions do not prefer
MAX_STEPS, MORE_STEPS = 9, 3  # up from Lambert, and once more from the selected model

Log = Callable[[str], None]


def no_log(line: str) -> None:
    """Reports nothing."""


@dataclasses.dataclass
class _Search:
    """One walk up from Lambert and down again, with fixed weights.

    `known`: free numbers of candidates that were fitted with other weights; `anisotropic`: whether the readings can
    show that the surface is anisotropic.
    """

    data: SelectionData
    near: criteria.Neighbourhood
    known: dict[Terms, np.ndarray]
    anisotropic: bool
    known_noise: bool = False
    log: Log = no_log
    moves: Moves = dataclasses.field(default_factory=Moves)
    candidates: dict[Terms, Candidate] = dataclasses.field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of readings."""
        return int(np.count_nonzero(self.data.used))

    def reweighted(self, weight: np.ndarray, log: Log = no_log) -> "_Search":
        """A new walk with other weights (n, C), from the numbers of this one."""
        known = {c.terms: c.p for c in self.candidates.values()}
        data = self.data.weighted(weight)
        return _Search(data, self.near, known, self.anisotropic, self.known_noise, log, self.moves)

    def fit(self, terms: Terms, origin: Candidate | None = None) -> Candidate | None:
        """A candidate fitted from another or from what is known of it; None where readings are too few."""
        fitted = self.fit_all([terms], origin)
        return fitted[0] if fitted else None

    def fit_all(self, candidates: Iterable[Terms], origin: Candidate | None) -> list[Candidate]:
        """Those of the candidates that the readings can bear, fitted side by side."""
        every, starts = dict.fromkeys(candidates), dict[Terms, np.ndarray]()
        for terms in every:
            if terms not in self.candidates and (start := self._start(terms, origin)) is not None:
                starts[terms] = start
        problems, began = [CandidateProblem(terms, self.data) for terms in starts], time.perf_counter()
        ends = fit_candidates(problems, list(starts.values()), ENOUGH)
        seconds = (time.perf_counter() - began) / max(len(starts), 1)
        for problem, end in zip(problems, ends, strict=True):
            self.candidates[problem.terms] = self._candidate(problem, end, seconds)
        return [self.candidates[terms] for terms in every if terms in self.candidates]

    def _start(self, terms: Terms, origin: Candidate | None) -> np.ndarray | None:
        """Numbers from which a candidate is fitted, NaN where nothing is known; None where readings are too few."""
        start = self.known.get(terms)
        if start is None and origin is not None:
            start = carried(origin.terms, origin.p, terms, self.data.channels)
        if start is None:
            start = np.full(CandidateProblem(terms, self.data).linear.size, np.nan)
        return None if start.size >= self.count else start

    def _candidate(self, problem: CandidateProblem, end: Fitted, seconds: float) -> Candidate:
        """A fitted candidate with its residuals, and how well it predicts what is left out."""
        p, chi2 = end
        residual, jacobian = problem.residuals(p)
        gradient = np.einsum("ncp,nc->p", jacobian, residual)
        _, low, high = problem.domains
        inside = ~(((p <= low) & (gradient >= 0)) | ((p >= high) & (gradient <= 0)))
        holdout = criteria.holdout_chi2(residual, jacobian[:, :, inside], self.near.groups)
        f, y = (np.where(self.data.used, a, 0.0) for a in (problem.values(p)[0], self.data.f))
        rms = float(np.sqrt(np.sum((f - y) ** 2) / max(float(np.sum(y**2)), 1e-300)))
        chi2 = chi2 if np.isfinite(chi2) and np.isfinite(holdout).all() else np.inf
        return Candidate(problem.terms, p, chi2, np.nan_to_num(holdout, nan=np.inf), residual, rms, seconds)

    def fit_likeliest(self, candidates: Iterable[Terms], origin: Candidate) -> list[Candidate]:
        """The candidates that a short descent on few readings finds the best, fitted; those known already as well."""
        every, coarse = list(dict.fromkeys(candidates)), self.data.thinned(SCREENED)
        fitted = [self.candidates[terms] for terms in every if terms in self.candidates]
        starts = {terms: self._start(terms, origin) for terms in every if terms not in self.candidates}
        starts = {terms: start for terms, start in starts.items() if start is not None}
        problems = [CandidateProblem(terms, coarse) for terms in starts]
        ends = dict(zip(starts, fit_candidates(problems, list(starts.values()), ROUGHLY, 1), strict=True))
        score = {terms: chi2 + p.size if np.isfinite(chi2) else np.inf for terms, (p, chi2) in ends.items()}
        best = sorted(ends, key=lambda terms: score[terms])[:FINALISTS]
        for terms in best:
            self.known.setdefault(terms, ends[terms].p)
        return fitted + self.fit_all(best, None)

    def design_effect(self, c: Candidate) -> float:
        """Design effect of the residuals of a candidate."""
        return criteria.design_effect(c.residual, self.data.used, self.near)

    def result(self, chosen: Candidate) -> SelectionResult:
        """The candidates so far; the one of lowest χ² tells the noise."""
        finite = [c for c in self.candidates.values() if np.isfinite(c.chi2)]
        best = min(finite, key=lambda c: c.chi2 / max(self.count - c.size, 1))
        # Noise that neighbours tell may be too large where they are far apart; a known one is what it is.
        least = 1.0 if self.known_noise else LEAST_DISPERSION
        dispersion = max(least, best.chi2 / max(self.count - best.size, 1))
        return SelectionResult(chosen, finite, dispersion, self.design_effect(best), self.count, self.data)

    def has_structure(self, c: Candidate) -> bool:
        """Whether residuals are more than noise: too large, or alike among neighbours (rounding does not count)."""
        if c.chi2 < ROUNDING * self.count:
            return False
        return c.chi2 > STRUCTURED * self.count or self.design_effect(c) > CLUSTERED

    def walk(self, start: Terms | None = None, most: int = MAX_STEPS) -> SelectionResult:
        """Up from the least model or `start`, then down where a number is not missed: the smallest that suffices."""
        current = self.fit(self.moves.start if start is None else start)
        if current is None:
            raise GonioError(f"{self.count} valid readings are too few to select a model; name one")
        origin, patience, grown = current, PATIENCE, set()
        for _ in range(most):
            grown.add(origin.terms)
            larger = self.fit_likeliest(self.moves.steps(origin.terms, self.anisotropic, self.data.channels), origin)
            better = self.result(current).better(current, larger)
            if self.has_structure(better or current):
                larger += self.fit_likeliest(self.moves.families(origin.terms), origin)
                better = self.result(current).better(current, larger)
            if better is not None:
                current = origin = better
                self.log(f"{current.expression}: {current.size} free numbers, relative rms {current.relative_rms:.3g}")
                continue
            # Two changes may do together what neither does: from what BIC alone prefers it is tried further.
            result = self.result(current)
            rest = [c for c in result.candidates if c.terms not in grown and result.bic(c) < result.bic(current)]
            if not rest or not patience or not self.has_structure(current):
                break
            origin, patience = min(rest, key=result.bic), patience - 1
        while smaller := self.simplified(current):
            current = smaller
        # Steps down are each compared with the one before: together they could lose what each of them may.
        result = self.result(current)
        ranked = result.ranked()
        preferred = (c for c in ranked if not result.better(c, [o for o in ranked if o.size >= c.size and o is not c]))
        chosen = next(preferred, current)
        # Whatever the criterion prefers: no model stays that a smaller one beats on held-out directions.
        error = {c.terms: float(result.held_out(c).sum()) for c in ranked}
        unbeaten = [c for c in ranked if all(error[c.terms] < error[o.terms] for o in ranked if o.size < c.size)]
        if chosen not in unbeaten:
            chosen = max((c for c in unbeaten if c.size < chosen.size), key=lambda c: c.size)
        while larger := result.better(chosen, [c for c in unbeaten if c.size > chosen.size]):
            chosen = larger
        return self.result(chosen)

    def simplified(self, current: Candidate) -> Candidate | None:
        """The first simpler candidate to which the current one is not preferred."""
        for terms in self.moves.simpler(current.terms, self.data.channels):
            c = self.fit(terms, current)
            if c and np.isfinite(c.chi2) and self.result(c).better(c, [current]) is None:
                return c
        return None


def stepwise_selection(
    readings: Readings,
    loss: str,
    sigma: np.ndarray | None,
    anisotropic: bool,
    seed: int = 0,
    log: Log = no_log,
    cells: np.ndarray | None = None,
) -> SelectionResult:
    """The model that readings ask for.

    Args:
        readings: f of shape (n, C).
        loss: as in a fit.
        sigma: known standard uncertainties (n, C), or None: the noise is then estimated from neighbours.
        anisotropic: whether the readings can show that the surface is anisotropic.
        seed: of the sample of readings.
        log: called with a line for each step up.
        cells: the readings to select by; without, a sample of them.

    Raises:
        GonioError: too few readings, or no light in any.
    """
    free_programs()
    if cells is None:
        cells = coarse_cells(readings, SAMPLE, seed)
    count = readings.f.shape[1]
    channels = evenly_spaced(count, MAX_CHANNELS)
    subset = readings.part(cells)
    f, valid = subset.f[:, channels], subset.valid[:, channels]
    if not f[valid].any():
        raise GonioError(f"all {int(valid.sum())} readings are 0: they tell no model from another; name one")
    weight = valid.astype(float)
    if sigma is not None:
        known = np.where(valid, sigma[cells][:, channels], 1.0)
        # Counts that are never expected have an uncertainty of nothing: no candidate but the truth would have a χ².
        weight = weight / np.maximum(known, LEAST_SIGMA * float(np.sqrt(np.mean(known[valid] ** 2))))
    compared = f * subset.cos_i[:, None] if uses_cosine(loss) else f
    data = SelectionData.of(subset.wi, subset.wo, f, weight, loss, floor_of(loss, compared[valid]))
    near = criteria.neighbourhood(subset.wi, subset.wo)
    search = _Search(data, near, {}, anisotropic, sigma is not None, log, moves_for(readings))
    if sigma is not None:
        return _conserving(search.walk())
    search = search.reweighted(_noise_weight(search, _reference(search)), log)
    result = search.walk()
    # The noise once more, from what the selected model leaves: a reference that missed much took that for noise.
    weight = _noise_weight(search, result.chosen)
    used = weight > 0
    change = np.mean(np.abs(np.log(weight[used] / search.data.weight[used])))
    return _conserving(
        search.reweighted(weight).walk(result.chosen.terms, MORE_STEPS) if change > SAME_NOISE else result
    )


def _conserving(result: SelectionResult) -> SelectionResult:
    """The same, or where the chosen model reflects more than it receives, the best as good a one that does not."""
    if not _creates_energy(result.chosen, result.data.channels):
        return result
    as_good = [c for c in result.candidates if c is not result.chosen and result.better(c, [result.chosen]) is None]
    conserving = (c for c in sorted(as_good, key=result.bic) if not _creates_energy(c, result.data.channels))
    other = next(conserving, None)
    return result if other is None else dataclasses.replace(result, chosen=other, refused=result.chosen)


def _creates_energy(c: Candidate, channels: int) -> bool:
    def values(wi: Direction, wo: Direction) -> np.ndarray:
        none = np.zeros((wi.z.size, channels))
        return CandidateProblem(c.terms, SelectionData.of(wi, wo, none, none, "linear", 1.0)).values(c.p)[0]

    def both(light: int, wi: Direction, wo: Direction) -> np.ndarray:
        wi = wi._replace(z=light * wi.z)
        return values(wi, wo) + values(wi, wo._replace(z=-wo.z))

    if not any(t.model in TRANSMITTING for t in c.terms):
        return largest_albedo(values, channels).value > 1.0 + CREATES
    lit = (functools.partial(both, light) for light in (1, -1))
    return max(largest_albedo(of_side, channels).value for of_side in lit) > 1.0 + CREATES


def _reference(search: _Search) -> Candidate:
    """A fit with even weights that leaves the noise, of models that follow most surfaces."""
    smallest = search.fit(search.moves.start)
    one, two = search.moves.references()
    candidates = [smallest, *search.fit_all(one, smallest)]
    for terms in two:
        origins = [c for c in candidates[1:] if c is not None and set(c.terms) <= set(terms)]
        candidates.append(search.fit(terms, origins[0] if origins else smallest))
    known = [c for c in candidates if c is not None]
    if not known:
        raise GonioError(f"{search.count} valid readings are too few to select a model; name one")
    return min(known, key=lambda c: c.chi2)


def _noise_weight(search: _Search, c: Candidate) -> np.ndarray:
    """Weights (n, C) by the noise that the residuals of a candidate show."""
    data, used = search.data, search.data.used
    residual = CandidateProblem(c.terms, data.weighted(used.astype(float))).residuals(c.p)[0]
    # By the model's own size: weights from noisy readings would favour those that came out low.
    deviation = criteria.noise_deviation(residual, np.abs(data.target + residual), used, search.near)
    return np.where(used, 1.0 / deviation, 0.0)
