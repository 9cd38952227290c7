"""Candidate models on a sample of the readings, evaluated without compiling a program for each.

A sum of lobes is put together from one compiled kernel for each *kind* of lobe (value and derivatives by its shapes);
that the lobe is isotropic, that a parameter is fixed or that channels share it is a choice of columns in NumPy. So one
lobe, two lobes, anisotropic or not, with one width or one for each channel, all come from the same program.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np

from gonio.fitting.problem.normal_equations import NormalEquations, summed
from gonio.fitting.problem.parameterisation import Domains, Parameters, domain_kind, parameters
from gonio.fitting.problem.readings import transform, transformed, uses_cosine
from gonio.fitting.selection.term_spec import Terms, TermSpec, expression_of, kernel_arguments
from gonio.models.expression.builder import Frame, assemble
from gonio.models.expression.parser import FACTOR, parse, with_defaults
from gonio.models.geometry.directions import NORMAL, Direction
from gonio.models.kept_jit import kept_jit

CELLS = 512  # the kernels' size: readings are padded to a multiple of it
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


@kept_jit
def _kernel(
    frame: Frame, names: tuple[str, ...], values: np.ndarray, wi: Direction, wo: Direction
) -> tuple[jax.Array, jax.Array]:
    def one(v: jax.Array, a: Direction, b: Direction) -> jax.Array:
        return assemble(frame, dict(zip(names, v, strict=True))).f(a, b)

    over = lambda f: jax.vmap(f, in_axes=(None, 0, 0))(values, wi, wo)  # noqa: E731
    return over(one), over(jax.jacfwd(one))


def _blocks(wi: Direction, wo: Direction) -> tuple[tuple[Direction, Direction], ...]:
    def padded(w: Direction) -> list[Direction]:
        each = [
            np.append(c, np.full(-c.shape[0] % CELLS, e)).reshape(-1, CELLS) for c, e in zip(w, NORMAL, strict=True)
        ]
        return [Direction(*(jnp.asarray(c) for c in block)) for block in zip(*each, strict=True)]

    return tuple(zip(padded(wi), padded(wo), strict=True))


@dataclasses.dataclass(frozen=True)
class SelectionData:
    """A sample of the readings: directions in blocks of CELLS, of which the first n are in use.

    `target` T(y c), `weight` (0: not used), both (n, C); the residual is weight·(T(f c) − target).
    """

    blocks: tuple[tuple[Direction, Direction], ...]
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
        return cls(_blocks(wi, wo), f, target, weight, cosine, loss, floor)

    @property
    def channels(self) -> int:
        """Number of channels."""
        return self.target.shape[1]

    @functools.cached_property
    def _cosines(self) -> tuple[np.ndarray, np.ndarray]:
        z_i, z_o = (np.concatenate([np.asarray(b[k].z) for b in self.blocks])[: self.f.shape[0]] for k in (0, 1))
        return z_i, z_o

    @functools.cached_property
    def front(self) -> np.ndarray:
        """Which directions (n,) are of light and detector in front of the sample."""
        return (self._cosines[0] > 0) & (self._cosines[1] > 0)

    @functools.cached_property
    def through(self) -> np.ndarray:
        """Which directions (n,) are of light and detector on different sides."""
        return self._cosines[0] * self._cosines[1] < 0

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
        wi, wo = (Direction(*(np.concatenate([b[k][j] for b in self.blocks])[keep] for j in range(3))) for k in (0, 1))
        return dataclasses.replace(part, blocks=_blocks(wi, wo))

    def with_linear_loss(self, weight: np.ndarray | None = None) -> "SelectionData":
        """The same readings compared in f itself; without weights (n, C), those of the loss taken as linear there."""
        if weight is None:
            weight = self.weight * transform(self.loss, self.f * self.cosine, self.floor, np)[1] * self.cosine
        one = np.ones_like(self.cosine)
        return dataclasses.replace(self, target=self.f, weight=weight, cosine=one, loss="linear", floor=1.0)

    def term(self, term: TermSpec, shapes: dict[str, float]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Value (n,) of a term at scale 1 and its derivatives by its shapes."""
        n = self.f.shape[0]
        if term.model in DIFFUSE:  # ρ/π needs no program
            name, there = DIFFUSE[term.model]
            unit = np.where(self.front if there else self.through, 1.0 / np.pi, 0.0)
            return shapes[name] * unit, {name: unit}
        names = kernel_arguments(term)
        both = "alpha" in shapes and "alpha_x" in names
        if both:
            shapes = {**shapes, "alpha_x": shapes["alpha"], "alpha_y": shapes["alpha"]}
        inside = (("base", (Frame(term.base, (), ()),)),) if term.base else ()
        frame = Frame(term.model, tuple(sorted(term.options)), inside)
        arguments = np.array([shapes.get(name, USUAL.get(name, np.nan)) for name in names])
        blocks = [_kernel(frame, names, arguments, wi, wo) for wi, wo in self.blocks]
        value, slopes = (np.concatenate([np.asarray(b[k]) for b in blocks])[:n] for k in (0, 1))
        slope = dict(zip(names, slopes.T, strict=True))
        if both:
            slope["alpha"] = slope["alpha_x"] + slope["alpha_y"]
        return value, slope


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

    def values(self, p: np.ndarray) -> Values:
        """f and ∂f/∂p at the free numbers p (P,)."""
        f = np.zeros(self.data.f.shape)
        jacobian = np.zeros((*f.shape, p.size))
        for k, term in enumerate(self.terms):
            free = [g for g in self.parameters.parameterisation.free if g.term == k]
            computed: dict[tuple[float, ...], tuple[np.ndarray, dict[str, np.ndarray]]] = {}
            for c in range(self.data.channels):
                columns = {g.path: g.first + (c if g.per_channel else 0) for g in free}
                shapes = {name: float(v) for name, v in self.parameters.fixed[k].items()}
                shapes |= {name: float(p[j]) for name, j in columns.items()}
                scale = shapes.pop(FACTOR, 1.0)
                key = tuple(shapes.values())
                if key not in computed:
                    computed[key] = self.data.term(term, shapes)
                value, slope = computed[key]
                f[:, c] += scale * value
                for name, j in columns.items():
                    jacobian[:, c, j] = value if name == FACTOR else scale * slope[name]
        return f, jacobian

    def residuals(self, p: np.ndarray) -> Values:
        """r and ∂r/∂p at the free numbers p (P,); zero where a reading is not used."""
        d, (f, jacobian) = self.data, self.values(p)
        value, slope = transform(d.loss, f * d.cosine, d.floor, np)
        return d.weight * (value - d.target), (d.weight * slope * d.cosine)[:, :, None] * jacobian

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None) -> NormalEquations:
        """At vectors p (S, P), of the active ones."""
        free = self.parameters.parameterisation
        squares = np.zeros((len(p), free.channels, 1 + len(free.free), 1 + len(free.free)))
        for k in range(len(p)) if active is None else np.flatnonzero(active):
            r, jacobian = self.residuals(p[k])
            rows = np.concatenate([r[:, :, None], np.take_along_axis(jacobian, free.columns[None], axis=2)], axis=2)
            squares[k] = np.einsum("ncg,nch->cgh", rows, rows, optimize=True)
        return summed(free, squares)
