"""Which model: grown from Lambert, one step at a time, as long as the data ask for more.

BIC and held-out directions must both ask for a larger model, or the smaller stays. All models are judged by one noise
and one count of independent readings (`criteria`), on one sample of the readings, by sketches that share
their compiled programs (`gonio.fitting.selection.candidate_model`); only the chosen one is fitted to all readings.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator

import numpy as np

from gonio.fitting.problem.losses import floor_of, uses_cosine
from gonio.fitting.problem.readings import Readings, coarse_cells
from gonio.fitting.selection import criteria
from gonio.fitting.selection.candidate import Choice, Tried
from gonio.fitting.selection.candidate_model import (
    CELLS,
    DIELECTRIC,
    NO_FRESNEL,
    Part,
    Scenery,
    numbers_of,
    residuals,
    values,
)
from gonio.fitting.selection.warm_start import carried, fitted

SAMPLE = 4000
MOST_LOBES = 2
MOST_CHANNELS = 4  # of many wavelengths so many, evenly spaced, choose the structure of all
LEFT = 1.2  # χ² over its expectation, or readings worth one, from which on residuals are called structure
SMALL = 0.01  # χ² over its expectation below which only rounding is left
SAME_NOISE = 0.05  # mean difference of the logarithms of two noises that are not worth a second walk
ROUNDS = 12
NEVER = float("inf")


class _Search:
    """One walk up from Lambert, with fixed weights."""

    def __init__(self, s: Scenery, near: criteria.Neighbourhood, known: dict[tuple, np.ndarray], turned: bool, say):
        self.s, self.near, self.known, self.turned, self.say = s, near, known, turned, say
        self.tried: dict[tuple, Tried] = {}
        self.channels = s.target.shape[1]
        self.used = s.weight > 0
        self.count = int(np.count_nonzero(self.used))

    def fit(self, parts: tuple[Part, ...], out_of: Tried | None = None) -> Tried | None:
        """A sketch fitted, out of another or out of what is known of it; None where readings are too few."""
        if parts in self.tried:
            return self.tried[parts]
        of = numbers_of(parts, self.channels)
        if len(of) >= self.count:
            return None
        began = time.perf_counter()
        start = self.known.get(parts)
        if start is None:
            start = carried(out_of.parts, out_of.p, parts, self.channels) if out_of else np.full(len(of), np.nan)
        p, cost = fitted(parts, start, self.s)
        r, rows = residuals(parts, p, self.s)
        low, high = (np.array([getattr(u, b) for u in of]) for b in ("low", "high"))
        gradient = np.einsum("ncp,nc->p", rows, r)
        inside = ~(((p <= low) & (gradient >= 0)) | ((p >= high) & (gradient <= 0)))
        held = criteria.held_out(r, rows, inside, self.near.groups)
        f = np.where(self.used, values(parts, p, self.s)[0], 0.0)
        y = np.where(self.used, self.s.f, 0.0)
        rms = float(np.sqrt(np.sum((f - y) ** 2) / max(float(np.sum(y**2)), 1e-300)))
        chi2 = cost if np.isfinite(cost) and np.isfinite(held).all() else NEVER
        self.tried[parts] = t = Tried(
            parts, p, chi2, np.nan_to_num(held, nan=NEVER), r, rms, time.perf_counter() - began
        )
        return t

    def choice(self, chosen: Tried) -> Choice:
        every = [t for t in self.tried.values() if np.isfinite(t.chi2)]
        best = min(every, key=lambda t: t.chi2)
        unit = max(1.0, best.chi2 / max(self.count - best.size, 1))
        worth = criteria.worth_of_one(best.residual, self.used, self.near)
        return Choice(chosen, every, unit, worth, self.count, self.s)

    def better(self, now: Tried, others: list[Tried | None]) -> Tried | None:
        """The best of those that BIC and held-out directions both ask for."""
        judge = self.choice(now)
        asked = [t for t in others if t and np.isfinite(t.chi2) and judge.bic(t) < judge.bic(now)]
        asked = [t for t in asked if judge.gain(now, t).asked]
        return min(asked, key=judge.bic, default=None)

    def smallest(self) -> Tried:
        """The smallest of all that were tried against which no larger one is asked for.

        Steps down are each judged against the one before: together they could lose what each of them may.
        """
        judge = self.choice(next(iter(self.tried.values())))
        ranked = sorted(judge.tried, key=lambda t: (t.size, judge.bic(t)))
        return next(t for t in ranked if self.better(t, [u for u in ranked if u.size >= t.size and u is not t]) is None)

    def structured(self, now: Tried) -> bool:
        """Whether the residuals are more than noise: too large, or alike among neighbours (rounding does not count)."""
        if now.chi2 < SMALL * self.count:
            return False
        return now.chi2 > LEFT * self.count or criteria.worth_of_one(now.residual, self.used, self.near) > LEFT

    def walk(self) -> Choice:
        """From Lambert up, then down again where a number is not missed."""
        now = self.fit((Part("lambert"),))
        for _ in range(ROUNDS):
            steps = list(self.steps(now.parts))
            up = self.better(now, [self.fit(parts, now) for parts in steps])
            if up is None and self.structured(now):
                up = self.better(now, [self.fit(parts, now) for parts in self.families(now.parts)])
            if up is None:
                break
            self.say(f"{up.spelled}: {up.size} free numbers, relative rms {up.relative_rms:.3g}")
            now = up
        down = True
        while down:
            down = None
            for parts in self.simpler(now.parts):
                t = self.fit(parts, now)
                if t and np.isfinite(t.chi2) and self.better(t, [now]) is None:
                    down = now = t
                    break
        return self.choice(self.smallest())

    def steps(self, parts: tuple[Part, ...]) -> Iterator[tuple[Part, ...]]:
        """What one more step in any direction would make of a sketch, all out of GGX's one program."""
        lobes = [k for k, part in enumerate(parts) if part.lobe]
        family = parts[lobes[0]].model if lobes else "ggx"
        if len(lobes) < MOST_LOBES and family != "std":
            for f0 in dict.fromkeys([parts[lobes[0]].f0] if lobes else [NO_FRESNEL, DIELECTRIC]):
                yield (*parts, Part(family, f0))
        if not lobes:
            return
        for f0 in (NO_FRESNEL, DIELECTRIC, None):
            if f0 != parts[lobes[0]].f0:
                yield self.changed(parts, lobes, f0=f0)
        for k in lobes:
            if self.turned and not parts[k].brushed:
                yield self.changed(parts, [k], brushed=True)
        if self.channels > 1 and not parts[lobes[0]].spread:
            yield self.changed(parts, lobes, spread=True)

    def families(self, parts: tuple[Part, ...]) -> Iterator[tuple[Part, ...]]:
        """Other families of the field, where what GGX and Lambert leave is not noise: each is a program to compile."""
        lobes = [k for k, part in enumerate(parts) if part.lobe]
        if parts[0].model == "lambert":
            yield self.changed(parts, [0], model="eon")
        if lobes and parts[lobes[0]].model == "ggx":
            yield self.changed(parts, lobes, model="beckmann")
            # Student's slopes cost two hundred times a GGX lobe: a second lobe is the cheaper number to add.
            if len(lobes) == 1 and not parts[lobes[0]].spread:
                yield self.changed(parts, lobes, model="std")

    def simpler(self, parts: tuple[Part, ...]) -> Iterator[tuple[Part, ...]]:
        """The same less one thing: a term, a number that a later step made needless, or what channels have alike."""
        lobes = [k for k, part in enumerate(parts) if part.lobe]
        if len(parts) > 1:
            yield from (parts[:k] + parts[k + 1 :] for k in ([0] if not parts[0].lobe else []) + lobes[-1:])
        if lobes and parts[lobes[0]].f0 is None:
            yield from (self.changed(parts, lobes, f0=f0) for f0 in (NO_FRESNEL, DIELECTRIC))
        if lobes and parts[lobes[0]].spread:
            yield self.changed(parts, lobes, spread=False)
        if lobes and parts[lobes[0]].model == "std":
            yield from (self.changed(parts, lobes, model=model) for model in ("ggx", "beckmann"))
        if parts[0].model == "eon":
            yield self.changed(parts, [0], model="lambert")
        yield from (self.changed(parts, [k], brushed=False) for k in lobes if parts[k].brushed)
        if self.channels > 1:
            coloured = [k for k, part in enumerate(parts) if not part.grey]
            if len(coloured) > 1:
                yield self.changed(parts, coloured, grey=True)
            yield from (self.changed(parts, [k], grey=True) for k in coloured)

    @staticmethod
    def changed(parts: tuple[Part, ...], at: list[int], **fields) -> tuple[Part, ...]:
        return tuple(dataclasses.replace(part, **fields) if k in at else part for k, part in enumerate(parts))


def choose(
    readings: Readings,
    loss: str,
    sigma: np.ndarray | None,
    turned: bool,
    seed: int = 0,
    say: Callable[[str], None] = lambda line: None,
    cells: np.ndarray | None = None,
) -> Choice:
    """The model that readings ask for. `sigma` (n, C): the known standard uncertainties, or None; `turned`: whether the
    readings tell of the surface's own azimuth, so that brushed surfaces can show. `cells`: at most CELLS of the
    readings to look at; without, a sample of them by `seed`.
    """
    if cells is None:
        cells = coarse_cells(readings, SAMPLE, seed)[:CELLS]
    channels = np.unique(np.linspace(0, readings.f.shape[1] - 1, min(readings.f.shape[1], MOST_CHANNELS)).astype(int))
    part = readings.part(cells)
    f, valid = part.f[:, channels], part.valid[:, channels]
    weight = valid.astype(float)
    if sigma is not None:
        weight = weight / np.where(valid, sigma[cells][:, channels], 1.0)
    compared = f * np.asarray(part.wi.z)[:, None] if uses_cosine(loss) else f
    s = Scenery.of(part.wi, part.wo, f, weight, loss, floor_of(loss, compared[valid]))
    near = criteria.neighbourhood(part.wi, part.wo)
    known: dict[tuple, np.ndarray] = {}
    if sigma is None:
        # A first look, weighted evenly, to see the noise: two lobes are supple enough to follow most surfaces.
        first = _Search(s, near, known, turned, lambda line: None)
        bare = first.fit((Part("lambert"),))
        one = [first.fit((Part("lambert"), Part("ggx", f0)), bare) for f0 in (NO_FRESNEL, DIELECTRIC)]
        ends = [first.fit((*t.parts, Part("ggx", t.parts[1].f0)), t) for t in one if t]
        reference = min([t for t in (*ends, *one, *first.tried.values()) if t], key=lambda t: t.chi2)
        known = {t.parts: t.p for t in first.tried.values()}
        s = s.weighted(_by_noise(s, reference, near))
    found = _Search(s, near, known, turned, say).walk()
    if sigma is None:
        # The noise once more, from what the chosen model leaves: a reference that missed much took that for noise.
        again = _by_noise(s, found.chosen, near)
        used = again > 0
        if np.mean(np.abs(np.log(again[used] / s.weight[used]))) > SAME_NOISE:
            known = {t.parts: t.p for t in found.tried}
            found = _Search(s.weighted(again), near, known, turned, lambda line: None).walk()
    return found


def _by_noise(s: Scenery, t: Tried, near: criteria.Neighbourhood) -> np.ndarray:
    used = s.weight > 0
    bare = residuals(t.parts, t.p, s.weighted(used.astype(float)))[0]
    # By the model's own size: weights from noisy readings would favour those that came out low.
    return np.where(used, 1.0 / criteria.noise_deviation(bare, np.abs(s.target + bare), used, near), 0.0)
