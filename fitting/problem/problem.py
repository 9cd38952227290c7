"""A least-squares problem of a fit: the readings, the loss and the weights of one model, with all that follows."""

import collections
import dataclasses
import functools
from collections.abc import Iterator

import numpy as np

from gonio.fitting.problem.domains import Domains
from gonio.fitting.problem.losses import transform, uses_cosine
from gonio.fitting.problem.normal_equations import NormalEquations, Request, page_program, summed
from gonio.fitting.problem.parameterisation import FixedValues, Parameterisation
from gonio.fitting.problem.readings import CHUNK, LANES, PAGE, Readings, Samples, block_shape, in_blocks, pages
from gonio.models.geometry.directions import NORMAL, Direction

UNDER_WAY = 8  # pages whose results are waited for at a time


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Normal equations (leading axis S), score covariance Jᵀ diag(r²) J (S, P, P) or None, model values (n, C)."""

    equations: NormalEquations
    scores: np.ndarray | None
    f: np.ndarray


@dataclasses.dataclass(frozen=True)
class FitProblem:
    """All that the cost ½Σ(w(T(f c) − T(y c)))² depends on besides the free numbers.

    Attributes:
        parameters: the model, its free numbers taken out (P of them).
        fixed: the other numbers of each term, by path.
        loss: name of T and c, see `losses`.
        domains: closed domains of the free numbers.
        readings: directions (n,) and values y (n, C), 1/sr.
        weight: w of each residual (n, C), 0 where there is no reading.
        samples: the same in blocks, as compiled programs take them.
        target_norm_squared: Σ(w T(y c))².
    """

    parameters: Parameterisation
    fixed: FixedValues
    loss: str
    domains: Domains
    readings: Readings
    weight: np.ndarray
    samples: Samples
    target_norm_squared: float

    @classmethod
    def create(
        cls,
        parameters: Parameterisation,
        fixed: FixedValues,
        loss: str,
        readings: Readings,
        weight: np.ndarray,
        floor: float,
    ) -> "FitProblem":
        """The problem of some readings with weights (n, C) and a loss with this floor."""
        n, channels = readings.f.shape
        shape = block_shape(n, channels)
        wi, wo = (
            Direction(*(in_blocks(np.asarray(c), shape, e) for c, e in zip(w, NORMAL, strict=True)))
            for w in (readings.wi, readings.wo)
        )
        target, weights = (in_blocks(a, (*shape, channels)) for a in (readings.f, weight))
        cosine = np.asarray(readings.wi.z)[:, None] if uses_cosine(loss) else None
        flat, norm_squared = target.reshape(-1, channels), 0.0
        for first in range(0, n, CHUNK):
            some = slice(first, min(first + CHUNK, n))
            compared = flat[some] if cosine is None else flat[some] * cosine[some]
            flat[some] = transform(loss, compared, floor, np)[0]
            norm_squared += float(np.sum((weights.reshape(-1, channels)[some] * flat[some]) ** 2))
        samples = Samples(wi, wo, target, weights, np.asarray(-(-n // shape[1])), np.asarray(float(floor)))
        return cls(parameters, fixed, loss, parameters.domains(), readings, weight, samples, norm_squared)

    @property
    def floor(self) -> float:
        """Floor of the loss, in the units of what it compares."""
        return float(self.samples.floor)

    @property
    def linear(self) -> np.ndarray:
        """Which free numbers (P,) f is proportional to."""
        return self.parameters.linear

    @functools.cached_property
    def _pages(self) -> list[Samples]:
        return pages(self.samples)

    def subset(self, cells: np.ndarray) -> "FitProblem":
        """The same problem on some of the cells."""
        if cells.size == self.weight.shape[0]:
            return self
        readings, weight = self.readings.part(cells), self.weight[cells]
        return FitProblem.create(self.parameters, self.fixed, self.loss, readings, weight, self.floor)

    def reweighted(self, weight: np.ndarray) -> "FitProblem":
        """The same problem with other weights (n, C); no array changes its shape, and nothing compiles again."""
        laid = in_blocks(weight, self.samples.weight.shape)
        norm_squared = float(np.sum((laid * self.samples.target) ** 2))
        samples = self.samples._replace(weight=laid)
        return dataclasses.replace(self, weight=weight, samples=samples, target_norm_squared=norm_squared)

    def retargeted(self, target: np.ndarray) -> "FitProblem":
        """The same problem with other targets T(y c), (n, C)."""
        laid = in_blocks(target, self.samples.target.shape)
        norm_squared = float(np.sum((laid * self.samples.weight) ** 2))
        return dataclasses.replace(self, samples=self.samples._replace(target=laid), target_norm_squared=norm_squared)

    def linearised(self) -> "FitProblem":
        """The problem of f itself, its residuals to first order in f − y: for `normal_equations(plain=True)`."""
        cosine = np.asarray(self.readings.wi.z)[:, None] if uses_cosine(self.loss) else 1.0
        with np.errstate(all="ignore"):
            slope = transform(self.loss, self.readings.f * cosine, self.floor, np)[1]
            return self.retargeted(self.readings.f).reweighted(self.weight * slope * cosine)

    def compared(self, f: np.ndarray) -> np.ndarray:
        """T(f c), (n, C), of values f (n, C) at the readings' directions."""
        return compared(self.readings, self.loss, self.floor, f)

    def residuals(self, f: np.ndarray) -> np.ndarray:
        """w (T(f c) − T(y c)), (n, C), for the model's values f; 0 where there is no reading."""
        return weighted_residuals(self.readings, self.loss, self.floor, self.weight, f)

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None, plain: bool = False) -> NormalEquations:
        """The normal equations at up to `LANES` vectors p (S, P); of the active ones, zero for the others.

        `plain`: residuals w(f − target), whatever the loss.
        """
        squares = [page[0] for page in self._run(p, active, plain=plain)]
        return summed(self.parameters, _total(squares, len(p))[:, 0])

    def evaluate(self, p: np.ndarray, scores: bool = True) -> Evaluation:
        """Normal equations at one p (P,), score covariance [White 1980] and the model's values."""
        f, squares = np.zeros(self.samples.weight.shape), []
        for k, (of_page, f_of_page) in enumerate(self._run(np.asarray(p, float)[None], scores=scores)):
            squares.append(of_page)
            rows = f[k * PAGE : (k + 1) * PAGE]
            rows[:] = np.swapaxes(np.asarray(f_of_page)[: rows.shape[0]], 1, 2)
        total = _total(squares, 1)
        equations, outer = (summed(self.parameters, total[:, k]) for k in range(2))
        f = f.reshape(-1, self.parameters.channels)[: self.weight.shape[0]]
        one = NormalEquations(equations.cost[0], equations.gradient[0], equations.matrix[0])
        return Evaluation(one, outer.matrix[0] if scores else None, f)

    def model_values(self, p: np.ndarray) -> np.ndarray:
        """The model's f (n, C) at the readings' directions, for free numbers p (P,)."""
        return self.evaluate(p, scores=False).f

    def _run(
        self, p: np.ndarray, active: np.ndarray | None = None, scores: bool = False, plain: bool = False
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """What the program gives for each page in turn; a few pages are under way, on several processors."""
        program, number = page_program(self.parameters, self.loss), len(p)
        lanes, order = np.zeros((LANES, self.parameters.size)), np.zeros(LANES, np.int32)
        lanes[:number] = p
        use = np.flatnonzero(np.broadcast_to(True if active is None else active, (number,)))
        order[: use.size] = use
        request = Request(np.asarray(use.size, np.int32), np.asarray(scores), np.asarray(plain))
        waiting = collections.deque()
        for page in self._pages:
            waiting.append(program(lanes, order, request, self.fixed, page))
            if len(waiting) == UNDER_WAY:
                yield waiting.popleft()
        yield from waiting


def _total(squares: list[np.ndarray], number: int) -> np.ndarray:
    return np.sum([np.asarray(s) for s in squares], axis=0, dtype=float)[:number]


def compared(readings: Readings, loss: str, floor: float | np.ndarray, f: np.ndarray) -> np.ndarray:
    """T(f c) of a loss at the readings' directions, for values f (n, C); the floor may be one for each channel."""
    c = np.asarray(readings.wi.z)[:, None] if uses_cosine(loss) else 1.0
    return transform(loss, f * c, floor, np)[0]


def weighted_residuals(
    readings: Readings, loss: str, floor: float | np.ndarray, weight: np.ndarray, f: np.ndarray
) -> np.ndarray:
    """w (T(f c) − T(y c)), (n, C), for the model's values f; 0 where there is no reading."""
    difference = compared(readings, loss, floor, f) - compared(readings, loss, floor, readings.f)
    return np.where(weight > 0, weight * difference, 0.0)
