"""Sketches of models on few readings: what a selection tries, without compiling a program for each.

A sum of lobes is put together from one compiled kernel for each *kind* of lobe (value and derivatives by its numbers);
that the lobe is isotropic, that a number is held or that channels share it is a choice of columns in NumPy. So one
lobe, two lobes, brushed or not, with one width or one for each channel, all come from the same program.
"""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from gonio.fitting.problem.domains import Domains, domain_kind
from gonio.fitting.problem.losses import transform, uses_cosine
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.models.catalog import MODELS
from gonio.models.expression.builder import Frame, assemble
from gonio.models.expression.paths import FACTOR
from gonio.models.geometry.directions import Direction
from gonio.models.parameters import parameters_of

CELLS = 4096  # the kernels' size: readings are padded to a multiple of it
NO_FRESNEL, DIELECTRIC = 1.0, 0.04  # Schlick's F₀ = 1 is F = 1
_ARGUMENTS = {"eon": ("rho", "r"), "std": ("alpha_x", "alpha_y", "f0", "gamma")}
_MICROFACET = ("alpha_x", "alpha_y", "f0")
NARROWEST = 1e-3


@dataclasses.dataclass(frozen=True)
class Part:
    """One term of a sketch. `f0` is held at a number or free (None); `spread`: a width for each channel;
    `grey`: its albedo or scale is one number for all channels.
    """

    model: str
    f0: float | None = NO_FRESNEL
    brushed: bool = False
    spread: bool = False
    grey: bool = False

    @property
    def lobe(self) -> bool:
        """Whether it is a lobe with a scale, not a diffuser with an albedo."""
        return self.model not in ("lambert", "eon")

    def spelled(self) -> str:
        """The term as a user would ask for it."""
        said = []
        if not self.lobe:
            return f"{self.model}(rho=shared)" if self.grey else self.model
        if self.brushed or self.spread:
            width = "each" if self.spread else "?"
            said += [f"{n}={width}" for n in (("alpha_x", "alpha_y") if self.brushed else ("alpha",))]
        if self.model == "std":
            said.append("gamma=?")
        if self.f0 is None:
            said.append("f0=?")
        elif self.f0 != NO_FRESNEL:
            said.append(f"f0={self.f0:g}")
        call = self.model + (f"({', '.join(said)})" if said else "")
        return f"shared * {call}" if self.grey else call


@dataclasses.dataclass(frozen=True)
class Number:
    """One free number of a sketch: its part, name, channel (None: all), and bounds; `log`: stepped in its logarithm."""

    part: int
    name: str
    channel: int | None
    low: float
    high: float
    log: bool

    @property
    def linear(self) -> bool:
        """Whether f is proportional to it."""
        return self.name in (FACTOR, "rho")


@functools.lru_cache(maxsize=512)
def numbers_of(parts: tuple[Part, ...], channels: int) -> tuple[Number, ...]:
    """The free numbers of a sketch over so many channels, in the order of its vector."""
    found = []
    for k, part in enumerate(parts):
        known = parameters_of(MODELS[part.model])
        each = [None] if part.grey or channels == 1 else list(range(channels))
        if part.lobe:
            found += [Number(k, FACTOR, c, 0.0, 1e6, True) for c in each]
            widths = ("alpha_x", "alpha_y") if part.brushed else ("alpha",)
            every = list(range(channels)) if part.spread and channels > 1 else [None]
            found += [Number(k, n, c, NARROWEST, known[n].high, True) for n in widths for c in every]
            if part.f0 is None:
                found.append(Number(k, "f0", None, 0.0, 1.0, False))
            if part.model == "std":
                found.append(Number(k, "gamma", None, known["gamma"].low, known["gamma"].high, True))
        else:
            found += [Number(k, "rho", c, 0.0, 1.0, False) for c in each]
            if part.model == "eon":
                found.append(Number(k, "r", None, 0.0, 1.0, False))
    return tuple(found)


@functools.partial(jax.jit, static_argnames=("model", "names"))
def _kernel(model: str, names: tuple[str, ...], values, wi: Direction, wo: Direction):
    def one(v, a, b):
        return assemble(Frame(model, (), ()), dict(zip(names, v, strict=True))).f(a, b)

    over = lambda f: jax.vmap(f, in_axes=(None, 0, 0))(values, wi, wo)  # noqa: E731
    return over(one), over(jax.jacfwd(one))


@dataclasses.dataclass(frozen=True)
class Scenery:
    """Readings that sketches are drawn on: directions as JAX arrays of a multiple of CELLS, the first n in use.

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
    def of(cls, wi: Direction, wo: Direction, f: np.ndarray, weight: np.ndarray, loss: str, floor: float) -> "Scenery":
        """From readings f (n, C), 1/sr, and their weights."""
        n = f.shape[0]

        def laid(w: Direction) -> Direction:
            up, more = (0.0, 0.0, 1.0), -n % CELLS
            filled = (np.concatenate([np.asarray(c, float), np.full(more, e)]) for c, e in zip(w, up, strict=True))
            return Direction(*(jnp.asarray(c) for c in filled))

        cosine = np.asarray(wi.z, float)[:, None] if uses_cosine(loss) else np.ones((n, 1))
        target = transform(loss, f * cosine, floor, np)[0]
        return cls(laid(wi), laid(wo), f, target, weight, cosine, loss, floor)

    def weighted(self, weight: np.ndarray) -> "Scenery":
        """The same readings with other weights (n, C)."""
        return dataclasses.replace(self, weight=weight)


def arguments(part: Part) -> tuple[str, ...]:
    """The numbers that a part's kernel takes."""
    return _ARGUMENTS.get(part.model, _MICROFACET)


def values(parts: tuple[Part, ...], p: np.ndarray, s: Scenery) -> tuple[np.ndarray, np.ndarray]:
    """(f (n, C), ∂f/∂p (n, C, P)) of a sketch at its numbers p (P,)."""
    n, channels = s.target.shape
    of = numbers_of(parts, channels)
    f, rows = np.zeros((n, channels)), np.zeros((n, channels, len(of)))
    for k, part in enumerate(parts):
        mine = [(j, u) for j, u in enumerate(of) if u.part == k]
        if part.model == "lambert":  # ρ/π needs no program
            for j, u in mine:
                at = slice(None) if u.channel is None else slice(u.channel, u.channel + 1)
                f[:, at] += p[j] / np.pi
                rows[:, at, j] = 1.0 / np.pi
            continue
        names = arguments(part)
        seen: dict[tuple, tuple] = {}
        for c in range(channels):
            at = {u.name: j for j, u in mine if u.channel in (None, c)}
            now = {name: p[j] for name, j in at.items()}
            if "alpha" in now:
                now["alpha_x"] = now["alpha_y"] = now["alpha"]
            if part.lobe:
                now.setdefault("f0", part.f0)
            given = tuple(float(now[name]) for name in names)
            if given not in seen:
                out = _kernel(part.model, names, np.array(given), s.wi, s.wo)
                seen[given] = tuple(np.asarray(a)[:n] for a in out)
            value, slopes = seen[given]
            strength = now.get(FACTOR, 1.0)
            f[:, c] += strength * value
            for name, j in at.items():
                if name == FACTOR:
                    rows[:, c, j] = value
                elif name == "alpha":
                    rows[:, c, j] = strength * (slopes[:, names.index("alpha_x")] + slopes[:, names.index("alpha_y")])
                else:
                    rows[:, c, j] = strength * slopes[:, names.index(name)]
    return f, rows


def residuals(parts: tuple[Part, ...], p: np.ndarray, s: Scenery) -> tuple[np.ndarray, np.ndarray]:
    """(r (n, C), ∂r/∂p (n, C, P)), zero where a reading is not used."""
    f, rows = values(parts, p, s)
    value, slope = transform(s.loss, f * s.cosine, s.floor, np)
    return s.weight * (value - s.target), (s.weight * slope * s.cosine)[:, :, None] * rows


@dataclasses.dataclass(frozen=True)
class CandidateProblem:
    """The least-squares problem of a sketch, for the solver of all fits."""

    parts: tuple[Part, ...]
    scenery: Scenery

    @functools.cached_property
    def numbers(self) -> tuple[Number, ...]:
        """The free numbers, in their order."""
        return numbers_of(self.parts, self.scenery.target.shape[1])

    @functools.cached_property
    def domains(self) -> Domains:
        """Closed domains of the numbers."""
        low, high = (np.array([getattr(u, b) for u in self.numbers], float) for b in ("low", "high"))
        return Domains(np.array([domain_kind(u.low, u.log) for u in self.numbers], int), low, high)

    @functools.cached_property
    def linear(self) -> np.ndarray:
        """Which numbers (P,) f is proportional to."""
        return np.array([u.linear for u in self.numbers], bool)

    @functools.cached_property
    def target_norm_squared(self) -> float:
        """‖data‖² of the weighted targets."""
        return float(np.sum((self.scenery.weight * self.scenery.target) ** 2))

    @functools.cached_property
    def slope(self) -> np.ndarray:
        """Slope of the residuals by f at the readings, (n, C)."""
        s = self.scenery
        return s.weight * transform(s.loss, s.f * s.cosine, s.floor, np)[1] * s.cosine

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None) -> NormalEquations:
        """At vectors p (S, P), of the active ones."""
        return self._summed(p, active, lambda q: residuals(self.parts, q, self.scenery))

    def linearised_equations(self, p: np.ndarray) -> NormalEquations:
        """Those of f itself at p (S, P), the loss being linear about the readings."""
        slope, y = self.slope, self.scenery.f

        def linearised(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            f, rows = values(self.parts, q, self.scenery)
            return slope * (f - y), slope[:, :, None] * rows

        return self._summed(p, None, linearised)

    def _summed(
        self,
        p: np.ndarray,
        active: np.ndarray | None,
        at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    ) -> NormalEquations:
        number, size = p.shape
        total = NormalEquations(np.zeros(number), np.zeros((number, size)), np.zeros((number, size, size)))
        for k in range(number) if active is None else np.flatnonzero(active):
            r, rows = at(p[k])
            j = rows.reshape(r.size, size)
            total.cost[k], total.gradient[k], total.matrix[k] = 0.5 * np.sum(r * r), j.T @ r.ravel(), j.T @ j
        return total
