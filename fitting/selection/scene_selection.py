"""Model selection for a scene: the error of its radiance by the nearest readings, and the cheapest model allowed."""

import dataclasses
from typing import Any

import numpy as np

from gonio.data.scene import Scene, ScenePairs
from gonio.fitting.problem.readings import Readings
from gonio.fitting.selection.candidate import Candidate, SelectionResult
from gonio.fitting.selection.candidate_model import CandidateProblem
from gonio.fitting.selection.criteria import neighbourhood, noise_deviation
from gonio.fitting.selection.warm_start import fit_candidate
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction

PAIRS = 4000
SIDES = 4.0  # between points on different sides of the sample: farther than any on the same ones
FAR = 5.0  # degrees between a scene's directions and the nearest readings, from which on a note says so
# Nanoseconds of one evaluation in double precision, all in one run, for a sense of what a renderer pays
# (tests/benchmarks/models/evaluate_models.py says what they are here and now).
COST = {
    "lambert": 1.0, "ggx": 1.0, "lommel_seeliger": 1.0, "fujii": 2.0, "burley_diffuse": 3.0, "retro": 4.0,
    "harvey_shack": 5.0, "hapke": 8.0, "ward": 9.0, "abc_microfacet": 16.0, "phong": 19.0, "blinn_phong": 21.0,
    "beckmann": 24.0, "white_standard": 25.0, "minnaert": 29.0, "charlie": 31.0, "eon": 43.0, "rpv": 46.0, "std": 460.0,
}  # fmt: skip
EXACT_FRESNEL = {"eta=?": 5.0, "eta=1.5": 5.0, "eta=each, k=each": 9.0}  # beyond that


@dataclasses.dataclass(frozen=True)
class SceneView:
    """A scene by the readings nearest to its pairs of directions."""

    scene: Scene
    pairs: ScenePairs
    cells: np.ndarray  # (m,) readings that are used
    nearest: np.ndarray  # (N,) which of them stands for a pair
    distance: float  # degrees, the median between a pair and its reading

    @property
    def weight(self) -> np.ndarray:
        """Weight (m,) of the squared error of f of each reading, for a light of small extent."""
        amount2 = self.pairs.share[self.pairs.view] * self.pairs.amount**2
        return np.bincount(self.nearest, amount2, minlength=self.cells.size)

    def error(self, model_f: np.ndarray, f: np.ndarray, noise: np.ndarray | None = None) -> float:
        """Relative rms error of the radiance, from f at the cells (m, C); known noise of the readings is taken off."""
        squared = self.pairs.rms((model_f - f)[self.nearest]) ** 2
        return self._relative(squared if noise is None else squared - self._noise_squared(noise), f)

    def noise_share(self, f: np.ndarray, noise: np.ndarray) -> float:
        """The share of the radiance's rms that the noise of the readings makes by itself."""
        return self._relative(self._noise_squared(noise), f)

    def _relative(self, squared: float, f: np.ndarray) -> float:
        rms = self.pairs.rms(f[self.nearest])
        return float(np.sqrt(max(squared, 0.0))) / rms if rms > 0 else float("nan")

    def _noise_squared(self, noise: np.ndarray) -> float:
        # A reading that stands for several pairs of one radiance errs alike in all of them.
        key = self.pairs.view.astype(np.int64) * self.cells.size + self.nearest
        unique, back = np.unique(key, return_inverse=True)
        view, reading = np.divmod(unique, self.cells.size)
        amount2 = self.pairs.share[view] * np.bincount(back, self.pairs.amount) ** 2
        return float(np.mean(np.sum(amount2[:, None] * noise[reading] ** 2, axis=0)))

    def note(self, brdf: AbstractBRDF, readings: Readings, selection: "SceneSelection | None") -> str:
        """The error of a model for the scene, beside its tolerance and the noise of the view's readings."""
        f = np.asarray(evaluate(brdf, readings.wi, readings.wo)).reshape(readings.f.shape[0], -1)
        f = np.broadcast_to(f, readings.f.shape)
        near = neighbourhood(readings.wi, readings.wo)
        deviation = noise_deviation(f - readings.f, np.abs(f), readings.valid, near)
        whole, error = self.error(f, readings.f), self.error(f, readings.f, deviation)
        noise = self.noise_share(readings.f, deviation)
        beside = f", beside {percent(noise)} of noise in the readings" if noise > error / 10 else ""
        if error < whole / 2:
            # Neighbours disagree by noise, or by a lobe narrower than their distance: then nothing is taken off.
            error, beside = whole, ", most of which may be noise of the readings"
        far = f", by readings {self.distance:.2g}° away from what it sees" if self.distance > FAR else ""
        reason = f": {selection.reason()}" if selection else ""
        return (
            f"for the scene '{self.scene.name}' the error of the radiance is {percent(error)}{beside}"
            f"{far} (tolerance {percent(self.scene.tolerance, 3)}){reason}"
        )


def view_of(scene: Scene, readings: Readings, anisotropic: bool, index: float = 1.0) -> SceneView:
    """The readings nearest to the directions of a scene, on the same sides of the sample.

    `anisotropic`: the surface's own azimuth matters; `index`: the refractive one behind the sample over that in front.
    """
    from scipy.spatial import KDTree

    pairs = scene.pairs(PAIRS, index)
    usable = np.flatnonzero(readings.valid.all(axis=1))
    if not usable.size:
        raise GonioError("no cell has a valid reading in every channel, which a scene needs; choose one with --channel")
    subset = readings.part(usable)
    points, wanted = (_points(p.wi, p.wo, anisotropic) for p in (subset, pairs))
    distance, nearest = KDTree(points, leafsize=16).query(wanted)
    cells, nearest = np.unique(nearest, return_inverse=True)
    return SceneView(scene, pairs, usable[cells], nearest.ravel(), float(np.degrees(np.median(distance))))


def _points(wi: Direction, wo: Direction, anisotropic: bool) -> np.ndarray:
    """Coordinates of pairs (n, 8) where near means alike; without anisotropy only the azimuth between them counts."""
    i, o = (np.stack([np.asarray(c, float) for c in w]) for w in (wi, wo))
    behind = [np.where(w[2] < 0, SIDES, 0.0) for w in (i, o)]
    if anisotropic:
        return np.concatenate([i, o, behind]).T
    sin_i, sin_o = np.hypot(i[0], i[1]), np.hypot(o[0], o[1])
    oblique = sin_i > 1e-9
    along = np.where(oblique, i[:2] / np.where(oblique, sin_i, 1.0), o[:2] / np.where(sin_o > 0, sin_o, 1.0))
    x, y = np.sum(along * o[:2], axis=0), along[0] * o[1] - along[1] * o[0]
    return np.stack([sin_i, np.zeros_like(sin_i), i[2], x, np.abs(y), o[2], *behind], axis=1)


@dataclasses.dataclass(frozen=True)
class SceneCandidate:
    """A candidate fitted for a scene, its error there, and the nanoseconds of an evaluation."""

    candidate: Candidate
    error: float
    cost: float


@dataclasses.dataclass(frozen=True)
class SceneSelection:
    """The candidates with their errors for a scene, cheapest first, and the one that was chosen."""

    candidates: list[SceneCandidate]
    chosen: SceneCandidate
    best: SceneCandidate  # what the data ask for, whatever the scene
    result: SelectionResult
    scene: Scene

    @property
    def meets(self) -> bool:
        """Whether the chosen candidate is within the tolerance."""
        return self.chosen.error <= self.scene.tolerance

    def rows(self) -> list[dict[str, Any]]:
        """The candidates as plain data, cheapest first."""
        known = {row["model"]: row for row in self.result.rows()}
        return [
            {**known[c.candidate.expression], "scene_error": c.error, "cost_ns": c.cost, "verdict": self._verdict(c)}
            for c in self.candidates
        ]

    def _verdict(self, c: SceneCandidate) -> str:
        if c is self.chosen:
            return "chosen: the cheapest within the tolerance" if self.meets else "chosen: what the data ask for"
        if c.error > self.scene.tolerance:
            return "beyond the tolerance"
        return "within the tolerance, dearer" if c.candidate.size <= self.result.chosen.size else "not asked for"

    def reason(self) -> str:
        """Why the chosen candidate was chosen, in words."""
        if not self.meets:
            least = min(c.error for c in self.candidates)
            return f"which no model tried meets (least error {least:.2g}); this is what the data ask for"
        if self.chosen.candidate.expression == self.best.candidate.expression:
            return "the cheapest model tried that meets it, and what the data themselves ask for"
        beyond = f" (error {self.best.error:.2g})" if self.best.error > self.scene.tolerance else ""
        return (
            "the cheapest model tried that meets it; the data themselves ask for "
            f"{self.best.candidate.expression}{beyond}"
        )


def select_for_scene(result: SelectionResult, view: SceneView) -> SceneSelection:
    """The cheapest candidate within a scene's tolerance that is no larger than what the data ask for, if any.

    All candidates are fitted once more for the scene. Where the residuals of the best fit exceed the noise the excess
    is error, not noise.
    """
    used, slope = result.data.used, result.data.with_linear_loss().weight
    noise = np.where(used, 1.0 / np.where(used, slope, 1.0), 0.0)
    data = result.data.with_linear_loss(used * np.sqrt(view.weight / np.mean(view.weight))[:, None])
    candidates = []
    for c in result.candidates:
        problem = CandidateProblem(c.terms, data)
        p = fit_candidate(problem, c.p).p
        error, cost = (
            view.error(problem.values(p)[0], data.f, noise),
            sum(COST[t.model] + EXACT_FRESNEL.get(t.fresnel.arguments, 0.0) for t in c.terms),
        )
        candidates.append(SceneCandidate(dataclasses.replace(c, p=p), error, cost))
    candidates.sort(key=lambda c: (c.cost, c.candidate.size, c.error))
    best = next(c for c in candidates if c.candidate.terms == result.chosen.terms)
    allowed = (c for c in candidates if c.error <= view.scene.tolerance and c.candidate.size <= best.candidate.size)
    return SceneSelection(candidates, next(allowed, best), best, result, view.scene)
