"""Sketches of models on few readings: what a selection tries, without compiling a program for each.

A sum of lobes is put together from one compiled kernel for each *kind* of lobe (value and derivatives by its numbers);
that the lobe is isotropic, that a number is held or that channels share it is a choice of columns in NumPy. So one
lobe, two lobes, brushed or not, with one width or one for each channel, all come from the same program.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np

from gonio.fitting.problem.losses import transform, uses_cosine
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
STEPS = 80
SETTLED = 1e-9  # relative change of the cost below which a descent ends


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


@functools.lru_cache(maxsize=512)
def numbers_of(parts: tuple[Part, ...], channels: int) -> tuple[Number, ...]:
    """The free numbers of a sketch over so many channels, in the order of its vector."""
    found = []
    for k, part in enumerate(parts):
        known = parameters_of(MODELS[part.model])
        each = [None] if part.grey or channels == 1 else list(range(channels))
        if part.lobe:
            found += [Number(k, FACTOR, c, 0.0, 1e6, False) for c in each]
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


def values(parts: tuple[Part, ...], x: np.ndarray, s: Scenery) -> tuple[np.ndarray, np.ndarray]:
    """(f (n, C), ∂f/∂x (n, C, P)) of a sketch at its vector x (see `to_x`)."""
    n, channels = s.target.shape
    of = numbers_of(parts, channels)
    p = to_p(of, x)
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
    # By x, not by p: dp/dx is p where the step is in the logarithm.
    return f, rows * np.where([u.log for u in of], p, 1.0)


def to_p(of: tuple[Number, ...], x: np.ndarray) -> np.ndarray:
    """The numbers themselves, shape (P,)."""
    return np.where([u.log for u in of], np.exp(np.where([u.log for u in of], x, 0.0)), x)


def to_x(of: tuple[Number, ...], p: np.ndarray) -> np.ndarray:
    """The vector that descents step in: logarithms of widths, the other numbers as they are."""
    p = np.clip(p, [u.low for u in of], [u.high for u in of])
    log = np.array([u.log for u in of])
    return np.where(log, np.log(np.where(log, p, 1.0)), p)


def residuals(parts: tuple[Part, ...], x: np.ndarray, s: Scenery) -> tuple[np.ndarray, np.ndarray]:
    """(r (n, C), ∂r/∂x (n, C, P)), zero where a reading is not used."""
    f, rows = values(parts, x, s)
    value, slope = transform(s.loss, f * s.cosine, s.floor, np)
    return s.weight * (value - s.target), (s.weight * slope * s.cosine)[:, :, None] * rows


def descend(parts: tuple[Part, ...], x: np.ndarray, s: Scenery) -> tuple[np.ndarray, float]:
    """(x, Σr²) at the end of a projected Levenberg–Marquardt descent within the bounds [Kanzow et al. 2004]."""
    of = numbers_of(parts, s.target.shape[1])
    low, high = (to_x(of, np.array([getattr(u, b) for u in of])) for b in ("low", "high"))
    x, damping = np.clip(x, low, high), 1e-3
    cost, matrix, gradient = _sums(parts, x, s)
    for _ in range(STEPS):
        held = ((x <= low) & (gradient >= 0)) | ((x >= high) & (gradient <= 0)) | (np.diagonal(matrix) <= 0)
        at = np.flatnonzero(~held)
        if not at.size:
            break
        inner = matrix[np.ix_(at, at)]
        step = np.zeros_like(x)
        try:
            step[at] = -np.linalg.solve(inner + damping * np.diag(np.diagonal(inner)), gradient[at])
        except np.linalg.LinAlgError:
            damping *= 10.0
            continue
        trial = np.clip(x + np.clip(step, -2.0, np.where([u.log for u in of], 2.0, np.inf)), low, high)
        after = _sums(parts, trial, s)
        if after[0] < cost:
            settled = cost - after[0] <= SETTLED * cost
            x, damping = trial, max(damping / 5.0, 1e-12)
            cost, matrix, gradient = after
            if settled:
                break
        else:
            damping *= 5.0
            if damping > 1e8:
                break
    return x, cost


def _sums(parts, x, s):
    r, rows = residuals(parts, x, s)
    flat = rows.reshape(r.size, rows.shape[2])
    return float(np.sum(r * r)), flat.T @ flat, flat.T @ r.ravel()
