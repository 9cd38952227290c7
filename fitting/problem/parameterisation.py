"""The free parameters of an expression: which numbers a fit moves, their names, and their domains.

A fit steps in unconstrained coordinates x: u = u_low + (u_high − u_low) sin²x, and the parameter is u, eᵘ or eᵘ − 1 by
the domain. A bound is an ordinary point of x [James & Roos 1975, MINUIT], reached at finite x. There the slope
vanishes, so Gauss–Newton alone would crawl; the map's curvature is known in closed form and goes into the Hessian.
"""

import dataclasses
import functools
from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from gonio.fitting.problem.arrow import Sizes, module_of
from gonio.fitting.problem.readings import AnyArray
from gonio.models.expression.builder import Frame, frame, in_double, number_label
from gonio.models.expression.parser import FACTOR, ParameterRef, Term, Value, changed, numbers
from gonio.models.parameters import ParameterInfo

LINEAR, LOG, LOG1P = 0, 1, 2
FAR = 1e3  # coordinates from which on whole periods are taken off
_ROUGH = float(np.float32(np.pi))
PERIOD = (_ROUGH, np.pi - _ROUGH + np.sin(np.pi))  # π to 30 digits; times up to 2²⁹ the first is exact


class Domains(NamedTuple):
    """Closed domains of P parameters: kind of map, and bounds of the parameters; arrays of shape (P,)."""

    kind: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Mapped(NamedTuple):
    """Parameters p, dp/dx and d²p/dx² at unconstrained coordinates x, each of shape (..., P)."""

    p: Any
    slope: Any
    curvature: Any


def domain_kind(low: float, log: bool) -> int:
    """The map that suits a domain: logarithmic where the parameter is a scale, and from 0 where 0 is allowed."""
    return LINEAR if not log else LOG if low > 0 else LOG1P


def mapped(kind: np.ndarray, p: Any, xp: ModuleType = np) -> Any:
    """p in the coordinate in which its domain is even: itself, its logarithm, or that of 1 + p."""
    tiny = np.finfo(float).tiny
    log1p = xp.log1p(xp.where(kind == LOG1P, p, 0.0))  # linear ones may be −1 and below
    return xp.where(kind == LOG, xp.log(xp.maximum(p, tiny)), xp.where(kind == LOG1P, log1p, p))


def unmapped(kind: np.ndarray, u: Any, xp: ModuleType = np) -> Any:
    """The parameter at an even coordinate u: the inverse of `mapped`."""
    exponent = xp.where(kind == LINEAR, 0.0, u)
    return xp.where(kind == LINEAR, u, xp.where(kind == LOG, xp.exp(exponent), xp.expm1(exponent)))


@functools.lru_cache(maxsize=256)
def _known_span(kind: bytes, low: bytes, high: bytes) -> tuple[np.ndarray, np.ndarray]:
    kinds = np.frombuffer(kind, np.int64)
    u_low, u_high = (mapped(kinds, np.frombuffer(b, float)) for b in (low, high))
    return u_low, u_high - u_low


def span(d: Domains, xp: ModuleType) -> tuple[np.ndarray, np.ndarray]:
    """(low end, width) of the domains in the coordinates in which they are even."""
    if xp is np and d.low.ndim == 1 and d.low.dtype == d.high.dtype == float and d.kind.dtype == np.int64:
        return _known_span(*(a.tobytes() for a in d))
    u_low = mapped(d.kind, d.low, xp)
    return u_low, mapped(d.kind, d.high, xp) - u_low


def evenly(d: Domains, share: np.ndarray) -> np.ndarray:
    """The parameters (P,) at shares, 0 to 1, of the way through their domains."""
    u_low, width = span(d, np)
    return unmapped(d.kind, u_low + width * share)


def near_origin(x: Any, xp: ModuleType = jnp) -> Any:
    """Unconstrained coordinates (..., P) of the same parameters, less whole periods where they are far away.

    Where the map's slope nearly vanishes a step goes millions of periods away: there x is known to less than itself,
    and sines are slow.
    """
    number = xp.round(x / np.pi)
    rest = (x - PERIOD[0] * number) - PERIOD[1] * number
    return xp.where(xp.abs(x) > FAR, xp.clip(rest, -2.0, 2.0), x)


def to_parameters(d: Domains, x: Any, xp: ModuleType = jnp, known: tuple[Any, Any] | None = None) -> Mapped:
    """The parameters at unconstrained coordinates x (..., P); `known`: the `span` of the domains."""
    u_low, width = span(d, xp) if known is None else known
    x = near_origin(x, xp)
    sine, cosine = xp.sin(x), xp.cos(x)
    u = u_low + width * sine * sine
    by_u = xp.exp(xp.where(d.kind == LINEAR, 0.0, u))
    first, second = 2.0 * width * sine * cosine, 2.0 * width * (cosine * cosine - sine * sine)
    curvature = by_u * (second + xp.where(d.kind == LINEAR, 0.0, first * first))
    return Mapped(xp.clip(unmapped(d.kind, u, xp), d.low, d.high), by_u * first, curvature)


def to_unconstrained(d: Domains, p: np.ndarray) -> np.ndarray:
    """x of parameters p (..., P), kept a little off the bounds, where a start would see no slope.

    A domain of a single value holds its number.
    """
    u_low, u_high = (mapped(np.asarray(d.kind), np.asarray(b)) for b in (d.low, d.high))
    width = np.where(u_high > u_low, u_high - u_low, 1.0)
    share = (mapped(np.asarray(d.kind), np.asarray(p, float)) - u_low) / width
    # A scale's domain is wide (10⁶): the margin is small enough not to move a start of 1e-3 of a usual value.
    return np.arcsin(np.sqrt(np.clip(share, 1e-12, 1.0 - 1e-6)))


def at_bounds(d: Domains, p: AnyArray) -> tuple[Any, Any]:
    """Which parameters lie on their lower, and which on their upper bound (to 1e-9 of the domain's size there)."""
    span = module_of(d.low).minimum(d.high - d.low, 1.0)
    return p - d.low <= 1e-9 * span, d.high - p <= 1e-9 * span


def snapped(d: Domains, p: np.ndarray) -> np.ndarray:
    """The parameters, those within rounding of a bound on it."""
    low, high = at_bounds(d, p)
    return np.where(low, d.low, np.where(high, d.high, p))


class PlacesOfPairs(NamedTuple):
    """Where, among the products of pairs of a channel's rows, the parts of an `Arrow` and of its gradient stand.

    `gradient`: of the shared numbers; `each`: of those of a channel.
    """

    gradient: np.ndarray
    each: np.ndarray
    corner: np.ndarray
    border: np.ndarray
    blocks: np.ndarray


FixedValues = tuple[dict[str, np.ndarray], ...]  # of each term, by path


@dataclasses.dataclass(frozen=True)
class FreeParameter:
    """A free parameter of one term: a single number shared by the channels, or one number for each of them."""

    term: int
    path: str
    per_channel: bool
    linear: bool
    info: ParameterInfo
    first: int  # index of its first number in the vector of free numbers


@dataclasses.dataclass(frozen=True)
class Parameterisation:
    """A model with its free numbers taken out; hashable, so that one compiled program serves all tables.

    Attributes:
        frames: the terms without their numbers.
        free: the free parameters.
        channels, size: number of channels, and of free numbers P.
        labels: (name such as 'ggx.alpha', channel or None) of each free number.
        linear: which free numbers (P,) f is proportional to.
        domains: closed domains of the free numbers.
        columns: index (C, G), in the vector of free numbers, that each free parameter has in each channel.
    """

    frames: tuple[Frame, ...]
    free: tuple[FreeParameter, ...]
    channels: int
    size: int
    labels: list[tuple[str, int | None]] = dataclasses.field(compare=False)
    linear: np.ndarray = dataclasses.field(compare=False)
    domains: Domains = dataclasses.field(compare=False)
    columns: np.ndarray = dataclasses.field(compare=False)

    @functools.cached_property
    def order(self) -> np.ndarray:
        """Index of each number in the order of an `Arrow`: those that channels share, then channel by channel."""
        each = np.array([g.per_channel for g in self.free], bool)
        return np.concatenate([self.columns[0, ~each], self.columns[:, each].ravel()])

    @functools.cached_property
    def kinds(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of shared free parameters, and of those of each channel, in a row of residual and derivatives."""
        each = np.array([g.per_channel for g in self.free], bool)
        return 1 + np.flatnonzero(~each), 1 + np.flatnonzero(each)

    @functools.cached_property
    def places_of_pairs(self) -> PlacesOfPairs:
        """Where products of pairs of rows stand that are each there once, upper half by rows."""
        size, (shared, each) = 1 + len(self.free), self.kinds
        place, (i, j) = np.zeros((size, size), int), np.triu_indices(size)
        place[i, j] = place[j, i] = np.arange(i.size)
        blocks = (place[np.ix_(a, b)].ravel() for a, b in ((shared, shared), (shared, each), (each, each)))
        return PlacesOfPairs(place[0, shared], place[0, each], *blocks)

    @functools.cached_property
    def sizes(self) -> Sizes:
        """How many numbers are shared, and how many each channel has for itself."""
        each = sum(g.per_channel for g in self.free)
        return Sizes(len(self.free) - each, self.channels, each)

    def count(self, g: FreeParameter) -> int:
        """How many free numbers a free parameter has."""
        return self.channels if g.per_channel else 1

    def of(self, g: FreeParameter) -> slice:
        """Where the numbers of a free parameter stand in the vector of free numbers."""
        return slice(g.first, g.first + self.count(g))

    def each(self, value: Callable[[FreeParameter], Any]) -> np.ndarray:
        """A value of each free number (P,), from its free parameter."""
        return np.array([value(g) for g in self.free for _ in range(self.count(g))])

    def with_ordered_lobes(self, fixed: FixedValues, p: np.ndarray) -> np.ndarray:
        """The same model with lobes of one kind in the order of their widths, narrow first: two fits then compare."""
        kinds: dict[tuple, list[int]] = {}
        for t, of in enumerate(self.frames):
            values = tuple((n, tuple(np.ravel(v))) for n, v in fixed[t].items())
            shapes = tuple((g.path, g.per_channel) for g in self.free if g.term == t)
            kinds.setdefault((of, values, shapes), []).append(t)

        def width(t: int) -> float:
            return next(
                (float(p[g.first]) for g in self.free if g.term == t and g.info.role == "width" and "." not in g.path),
                0.0,
            )

        ordered = p.copy()
        for alike in kinds.values():
            for place, source in zip(alike, sorted(alike, key=width), strict=True):
                pairs = ([g for g in self.free if g.term == t] for t in (place, source))
                for g, h in zip(*pairs, strict=True):
                    ordered[self.of(g)] = p[self.of(h)]
        return ordered

    def filled(self, terms: tuple[Term, ...], vectors: list[np.ndarray]) -> tuple[Term, ...]:
        """The terms with every free number in its place: from one vector (P,), or one for each channel."""
        values: list[dict[str, Value]] = [{} for _ in terms]
        for g in self.free:
            n = np.concatenate([p[self.of(g)] for p in vectors])
            values[g.term][g.path] = Value(tuple(n.tolist()) if n.size > 1 else float(n[0]))
        return tuple(map(changed, terms, values))


class Parameters(NamedTuple):
    """The free parameters of an expression, the fixed values of each term, and the given starts (P,), or NaN."""

    parameterisation: Parameterisation
    fixed: FixedValues
    start: np.ndarray


def parameters(terms: tuple[Term, ...], channels: int) -> Parameters:
    """The parameterisation of terms (as `with_defaults` gives them); lists have one value for each of the channels."""
    free, fixed, start, size = [], [], [], 0
    for index, term in enumerate(terms):
        values: dict[str, np.ndarray] = {}
        several = sum(_domain(n).linear for n in numbers(term) if n.path != FACTOR) > 1
        for n in numbers(term):
            value, info = n.value, _domain(n)
            if several and n.path != FACTOR:  # f is a sum of what is proportional to each
                info = dataclasses.replace(info, linear=False)
            if not value.free:
                values[n.path] = in_double(value.number)
                continue
            usual = info.per_channel if value.each is None else value.each
            per_channel = channels > 1 and (usual or isinstance(value.number, tuple))
            free.append(FreeParameter(index, n.path, per_channel, info.linear, info, size))
            count = channels if per_channel else 1
            number = np.nan if value.number is None else value.number
            start.append(np.broadcast_to(np.asarray(number, float), (count,)))
            size += count
        fixed.append(values)
    flat = np.concatenate(start) if start else np.empty(0)
    each = [(g, c) for g in free for c in range(channels if g.per_channel else 1)]
    largest = float(jnp.finfo(jnp.result_type(float)).max) / 2  # of single precision, where JAX computes in it
    domains = Domains(
        np.array([domain_kind(g.info.low, g.info.log) for g, _ in each], int),
        np.array([max(g.info.low, -largest) for g, _ in each], float),
        np.array([min(g.info.high, largest) for g, _ in each], float),
    )
    columns = np.array([[g.first + (c if g.per_channel else 0) for g in free] for c in range(channels)], int)
    linear = np.array([g.linear for g, _ in each], bool)
    frames = tuple(frame(t) for t in terms)
    names = {g: number_label(frames, g.term, g.path) for g in free}
    labels = [(names[g], c if g.per_channel else None) for g, c in each]
    whole = Parameterisation(frames, tuple(free), channels, size, labels, linear, domains, columns)
    return Parameters(whole, tuple(fixed), flat)


def of_channel(terms: tuple[Term, ...], c: int) -> tuple[Term, ...]:
    """The terms of one channel: of every list its value there."""
    complete = []
    for t in terms:
        lists = {n.path: (n.value, n.value.number) for n in numbers(t) if isinstance(n.value.number, tuple)}
        one = {path: dataclasses.replace(value, number=number[c]) for path, (value, number) in lists.items()}
        complete.append(changed(t, one))
    return tuple(complete)


def _domain(n: ParameterRef) -> ParameterInfo:
    # A dielectric seen from outside has an index of at least 1; below, 1/eta gives nearly the same data.
    info = n.info
    if n.name == "eta" and "k" not in n.call.values:
        info = dataclasses.replace(info, low=max(info.low, 1.0))
    # What stands inside another model is not what f is proportional to.
    return dataclasses.replace(info, linear=False) if "." in n.path else info
