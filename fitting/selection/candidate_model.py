"""Candidate models on a sample of the readings, evaluated without compiling a program for each.

A sum of lobes is put together from one compiled kernel for each *kind* of lobe (see `lobe_kernels`); that the lobe is
isotropic, that a parameter is fixed or that channels share it is a choice of columns in NumPy. So one lobe, two lobes,
anisotropic or not, with one width or one for each channel, all come from the same program.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np

from gonio.fitting.problem.normal_equations import NormalEquations, summed, summed_pairs
from gonio.fitting.problem.parameterisation import Domains, Parameters
from gonio.fitting.problem.readings import transform, transformed, uses_cosine
from gonio.fitting.selection.candidate_columns import (
    DIFFUSE,
    candidate_domains,
    candidate_parameters,
    lobe_of,
    term_columns,
)
from gonio.fitting.selection.candidate_rows import CandidateRows, rows_of_candidate
from gonio.fitting.selection.candidate_sums import CandidateSums, Compared, sums_of
from gonio.fitting.selection.lobe_kernels import lobe_values, padded
from gonio.fitting.selection.term_spec import Terms, TermSpec
from gonio.models.geometry.directions import Direction

BLOCK = 64
"""Vectors of numbers whose lobes are held at a time."""

Values = tuple[np.ndarray, np.ndarray]
"""Values (n, C) and their derivatives by the free numbers (n, C, P)."""


@dataclasses.dataclass(frozen=True)
class SelectionData:
    """A sample of the readings: directions, of which the first n are in use.

    `target` T(y c), `weight` (0: not used), both (n, C); the residual is weight·(T(f c) − target).
    """

    wi: Direction
    wo: Direction
    f: np.ndarray
    target: np.ndarray
    weight: np.ndarray
    cosine: np.ndarray  # c, (n, 1)
    loss: str
    floor: float

    @classmethod
    def of(
        cls, wi: Direction, wo: Direction, f: np.ndarray, weight: np.ndarray, loss: str, floor: float
    ) -> "SelectionData":
        """From readings f (n, C), 1/sr, and their weights."""
        n = f.shape[0]
        cosine = np.abs(np.asarray(wi.z, float))[:, None] if uses_cosine(loss) else np.ones((n, 1))
        target = transformed(loss, f * cosine, floor)
        return cls(padded(wi), padded(wo), f, target, weight, cosine, loss, floor)

    @property
    def channels(self) -> int:
        """Number of channels."""
        return self.target.shape[1]

    @functools.cached_property
    def front(self) -> np.ndarray:
        """Which directions (n,) are of light and detector in front of the sample."""
        n = self.f.shape[0]
        return (self.wi.z[:n] > 0) & (self.wo.z[:n] > 0)

    @functools.cached_property
    def through(self) -> np.ndarray:
        """Which directions (n,) are of light and detector on different sides."""
        n = self.f.shape[0]
        return self.wi.z[:n] * self.wo.z[:n] < 0

    @functools.cached_property
    def compared(self) -> Compared:
        """The same for sums by a compiled loop: what is beyond the readings weighs nothing."""
        n, size = self.f.shape[0], self.wi.z.size

        def padded_rows(a: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(np.pad(np.atleast_2d(a.T).astype(float), [(0, 0), (0, size - n)]))

        target, weight = padded_rows(self.target), padded_rows(self.weight)
        cosine, front, through = (padded_rows(a)[0] for a in (self.cosine, self.front, self.through))
        return Compared(self.wi, self.wo, target, weight, cosine, front, through, self.loss, self.floor)

    @functools.cached_property
    def linearised(self) -> "SelectionData":
        """The same readings compared in f itself, with the weights of the loss taken as linear there."""
        return self.with_linear_loss()

    @property
    def used(self) -> np.ndarray:
        """Which readings (n, C) count."""
        return self.weight > 0

    def weighted(self, weight: np.ndarray) -> "SelectionData":
        """The same readings with other weights (n, C)."""
        return dataclasses.replace(self, weight=weight)

    def thinned(self, most: int) -> "SelectionData":
        """At most so many of the readings, evenly; the same ones each time."""
        n = self.f.shape[0]
        if n <= 2 * most:
            return self
        keep = np.linspace(0, n - 1, most).astype(int)
        part = dataclasses.replace(
            self, f=self.f[keep], target=self.target[keep], weight=self.weight[keep], cosine=self.cosine[keep]
        )
        wi, wo = (padded(Direction(*(c[keep] for c in w))) for w in (self.wi, self.wo))
        return dataclasses.replace(part, wi=wi, wo=wo)

    def with_linear_loss(self, weight: np.ndarray | None = None) -> "SelectionData":
        """The same readings compared in f itself; without weights (n, C), those of the loss taken as linear there."""
        if weight is None:
            weight = self.weight * transform(self.loss, self.f * self.cosine, self.floor, np)[1] * self.cosine
        one = np.ones_like(self.cosine)
        return dataclasses.replace(self, target=self.f, weight=weight, cosine=one, loss="linear", floor=1.0)

    def lobes(self, term: TermSpec, names: tuple[str, ...], shapes: np.ndarray) -> np.ndarray:
        """The term at scale 1 and its derivatives by its shapes (K,), (..., K + 1, n), at sets of shapes (..., K)."""
        if term.model in DIFFUSE:  # ρ/π needs no program
            there = self.front if DIFFUSE[term.model][1] else self.through
            unit = np.where(there, 1.0 / np.pi, 0.0)
            return np.stack([shapes * unit, np.broadcast_to(unit, (*shapes.shape[:-1], unit.size))], axis=-2)
        sets = shapes.reshape(math.prod(shapes.shape[:-1]), len(names))
        values = lobe_values(lobe_of(term), names, sets, self.wi, self.wo)[:, : self.f.shape[0]]
        return values.swapaxes(1, 2).reshape(*shapes.shape[:-1], 1 + len(names), -1)


@dataclasses.dataclass(frozen=True)
class CandidateProblem:
    """The least-squares problem of a candidate, for the solver of all fits."""

    terms: Terms
    data: SelectionData

    @property
    def parameters(self) -> Parameters:
        """The free parameters and the fixed values."""
        return candidate_parameters(self.terms, self.data.channels)

    @property
    def domains(self) -> Domains:
        """Closed domains of the free numbers."""
        return candidate_domains(self.terms, self.data.channels)

    @property
    def linear(self) -> np.ndarray:
        """Which free numbers (P,) f is proportional to."""
        return self.parameters.parameterisation.linear

    @property
    def order(self) -> np.ndarray:
        """Index, among the free numbers, of each number of the normal equations (P,)."""
        return self.parameters.parameterisation.order

    @property
    def target_norm_squared(self) -> float:
        """‖data‖² of the weighted targets."""
        return float(np.sum((self.data.weight * self.data.target) ** 2))

    def _values(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """f (S, C, n) of vectors p (S, P), and its derivatives by the free parameters in each channel (S, C, G, n)."""
        shape = len(p), self.data.channels, self.data.f.shape[0]
        f, slopes = np.zeros(shape), np.empty((*shape[:2], len(self.parameters.parameterisation.free), shape[2]))
        for term, of in zip(self.terms, term_columns(self.terms, self.data.channels), strict=True):
            lobe, scale = self.data.lobes(term, of.names, of.shapes(p)), np.asarray(of.scales(p))[..., None]
            f += scale * lobe[:, :, 0]
            for g, columns in of.slopes:
                if not columns:
                    slopes[:, :, g] = lobe[:, :, 0]
                    continue
                np.multiply(scale, lobe[:, :, 1 + columns[0]], out=slopes[:, :, g])
                for j in columns[1:]:
                    slopes[:, :, g] += scale * lobe[:, :, 1 + j]
        return f, slopes

    def _rows(self, p: np.ndarray) -> np.ndarray:
        """Residuals of vectors p (S, P), then their derivatives by the free parameters (S, C, 1 + G, n); 0 where a
        reading is not used."""
        d, (f, slopes) = self.data, self._values(p)
        weight, factor = d.weight.T, d.cosine[:, 0]
        value, slope = transform(d.loss, f * factor, d.floor, np)
        rows = np.empty((*f.shape[:2], 1 + slopes.shape[2], f.shape[2]))
        np.multiply(weight, value - d.target.T, out=rows[:, :, 0])
        np.multiply((weight * slope * factor)[:, :, None], slopes, out=rows[:, :, 1:])
        return rows

    def _by_number(self, slopes: np.ndarray) -> np.ndarray:
        """Derivatives by the free numbers (n, C, P) of those by the free parameters of each channel (C, G, n)."""
        columns = self.parameters.parameterisation.columns
        jacobian = np.zeros((slopes.shape[2], slopes.shape[0], self.linear.size))
        for c, of_channel in enumerate(columns):
            jacobian[:, c, of_channel] = slopes[c].T
        return jacobian

    def values(self, p: np.ndarray) -> Values:
        """f and ∂f/∂p at the free numbers p (P,)."""
        f, slopes = self._values(p[None])
        return f[0].T, self._by_number(slopes[0])

    def residuals(self, p: np.ndarray) -> Values:
        """r and ∂r/∂p at the free numbers p (P,); zero where a reading is not used."""
        rows = self._rows(p[None])[0]
        return rows[:, 0].T, self._by_number(rows[:, 1:])

    @property
    def rows(self) -> CandidateRows | None:
        """What its sums are made of; None where it is not of this form."""
        return rows_of_candidate(self.terms, self.data.channels)

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None) -> NormalEquations:
        """At vectors p (S, P), of the active ones."""
        free, size = self.parameters.parameterisation, 1 + len(self.parameters.parameterisation.free)
        use = np.flatnonzero(np.broadcast_to(True if active is None else active, (len(p),)))
        blocks = [self._pairs(p[use[first : first + BLOCK]]) for first in range(0, len(use), BLOCK)]
        if blocks and all(block is not None for block in blocks):
            pairs = np.zeros((len(p), free.channels, size * (size + 1) // 2))
            pairs[use] = np.concatenate([block for block in blocks if block is not None])
            return summed_pairs(free, pairs)
        squares = np.zeros((len(p), free.channels, size, size))
        rows = self._rows(p[use])
        squares[use] = rows @ rows.swapaxes(2, 3)
        return summed(free, squares)

    def _pairs(self, p: np.ndarray) -> np.ndarray | None:
        """Products of the rows of residual and derivatives at vectors p (S, P), each once, by a compiled loop."""
        sums = sums_of(self.data.compared, [self.rows] * len(p), p.shape[1])
        pairs = None if sums is None else sums.pairs(p[:, self.order], np.arange(len(p)))
        if sums is None or pairs is None:
            return None
        (i, j), size = np.triu_indices(1 + sums.slopes), 1 + len(self.parameters.parameterisation.free)
        return pairs[..., (i < size) & (j < size)]


def sums_together(problems: Sequence[CandidateProblem], size: int) -> CandidateSums | None:
    """The sums of candidates on the same readings, of at most so many numbers each; None where there are no loops."""
    return sums_of(problems[0].data.compared, [problem.rows for problem in problems], size)
