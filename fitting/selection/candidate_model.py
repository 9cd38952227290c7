"""Candidate models on a sample of the readings, evaluated without compiling a program for each.

A sum of lobes is put together from one compiled kernel for each *kind* of lobe (see `lobe_kernels`); that the lobe is
isotropic, that a parameter is fixed or that channels share it is a choice of columns in NumPy. So one lobe, two lobes,
anisotropic or not, with one width or one for each channel, all come from the same program.
"""

import dataclasses
import functools
import math

import numpy as np

from gonio.fitting.problem.normal_equations import NormalEquations, summed
from gonio.fitting.problem.parameterisation import Domains, Parameters, domain_kind, parameters
from gonio.fitting.problem.readings import transform, transformed, uses_cosine
from gonio.fitting.selection.lobe_kernels import lobe_values, padded
from gonio.fitting.selection.term_spec import Terms, TermSpec, expression_of, kernel_arguments
from gonio.models.expression.builder import Frame
from gonio.models.expression.parser import FACTOR, parse, with_defaults
from gonio.models.geometry.directions import Direction

MIN_WIDTH = 1e-3
USUAL = {"f0": 1.0, "k": 0.0}
"""Shapes that a term has where its expression has none: Schlick's F₀ = 1 is F = 1."""

DIFFUSE = {"lambert": ("rho", True), "lambert_transmission": ("tau", False)}
"""Even diffusers: the name of their share, and whether they reflect, or transmit."""

Values = tuple[np.ndarray, np.ndarray]
"""Values (n, C) and their derivatives by the free numbers (n, C, P)."""


@functools.lru_cache(maxsize=512)
def candidate_parameters(terms: Terms, channels: int) -> Parameters:
    """The free parameters of a candidate over so many channels, and its fixed values."""
    return parameters(with_defaults(parse(expression_of(terms))), channels)


@functools.lru_cache(maxsize=512)
def candidate_domains(terms: Terms, channels: int) -> Domains:
    """Their closed domains: no lobe is narrower than `MIN_WIDTH`, and scales step in their logarithm."""
    free = candidate_parameters(terms, channels).parameterisation
    kind, low, high = free.domains
    kind = np.where(free.each(lambda g: g.path == FACTOR), domain_kind(0.0, True), kind)
    return Domains(kind, np.where(free.each(lambda g: g.info.role == "width"), MIN_WIDTH, low), high)


def lobe_of(term: TermSpec) -> Frame:
    """A term without its shapes."""
    inside = (("base", (Frame(term.base, (), ()),)),) if term.base else ()
    return Frame(term.model, tuple(sorted(term.options)), inside)


@dataclasses.dataclass(frozen=True)
class _TermColumns:
    """Where the shapes and the scale of one term come from, and what the derivatives by its free parameters are.

    Attributes:
        names: the shapes (K,) that its lobe takes.
        known: their fixed values (K,).
        number: the free number (1 or C, K) of each shape in each channel where shapes differ; −1 where it is fixed.
        scale: its fixed value.
        scale_number: the free number (C,) that it is in each channel; None where it is fixed.
        slopes: of each free parameter its index, and the shapes that it is; none of the scale.
    """

    names: tuple[str, ...]
    known: np.ndarray
    number: np.ndarray
    scale: float
    scale_number: np.ndarray | None
    slopes: tuple[tuple[int, tuple[int, ...]], ...]

    def shapes(self, p: np.ndarray) -> np.ndarray:
        """Shapes (S, 1 or C, K) of vectors p (S, P)."""
        return np.where(self.number >= 0, p[:, self.number], self.known)

    def scales(self, p: np.ndarray) -> np.ndarray | float:
        """Scales (S, C) of vectors p (S, P), or the fixed one."""
        return self.scale if self.scale_number is None else p[:, self.scale_number]


@functools.lru_cache(maxsize=512)
def _columns(terms: Terms, channels: int) -> tuple[_TermColumns, ...]:
    """Those of each term."""
    every, fixed, _ = candidate_parameters(terms, channels)
    made = []
    for k, term in enumerate(terms):
        free = {g.path: (index, g) for index, g in enumerate(every.free) if g.term == k}
        shapes = [path for path in (*fixed[k], *free) if path != FACTOR]
        names = (DIFFUSE[term.model][0],) if term.model in DIFFUSE else kernel_arguments(term)
        alike = {"alpha_x": "alpha", "alpha_y": "alpha"} if "alpha" in shapes and "alpha_x" in names else {}
        paths = [alike.get(name, name) for name in names]
        differ = any(g.per_channel for path, (_, g) in free.items() if path != FACTOR)
        number = np.full((channels if differ else 1, len(names)), -1)
        for j, path in enumerate(paths):
            if path in free:
                number[:, j] = every.columns[: len(number), free[path][0]]
        known = [float(fixed[k].get(path, USUAL.get(path, np.nan))) for path in paths]
        scale_number = every.columns[:, free[FACTOR][0]] if FACTOR in free else None
        slopes = tuple(
            (index, () if path == FACTOR else tuple(j for j, of in enumerate(paths) if of == path))
            for path, (index, _) in free.items()
        )
        scale = float(fixed[k].get(FACTOR, 1.0))
        made.append(_TermColumns(names, np.array(known), number, scale, scale_number, slopes))
    return tuple(made)


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
        for term, of in zip(self.terms, _columns(self.terms, self.data.channels), strict=True):
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

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None) -> NormalEquations:
        """At vectors p (S, P), of the active ones."""
        free, size = self.parameters.parameterisation, 1 + len(self.parameters.parameterisation.free)
        use = np.flatnonzero(np.broadcast_to(True if active is None else active, (len(p),)))
        squares = np.zeros((len(p), free.channels, size, size))
        rows = self._rows(p[use])
        squares[use] = rows @ rows.swapaxes(2, 3)
        return summed(free, squares)
