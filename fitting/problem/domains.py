"""From unconstrained coordinates to parameters inside their closed domains, with both bounds in reach.

u = u_low + (u_high − u_low) sin²x, and the parameter is u, eᵘ or eᵘ − 1 by the domain: a bound is an ordinary point
of x [James & Roos 1975, MINUIT], reached at finite x. There the slope vanishes, so Gauss–Newton alone would crawl; the
curvature of the map is known in closed form and goes into the Hessian (`fitting.solver`).
"""

import functools
from types import ModuleType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

LINEAR, LOG, LOG1P = 0, 1, 2


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


def _span(d: Domains, xp: ModuleType) -> tuple[np.ndarray, np.ndarray]:
    """(low end, width) of the domains in the coordinates in which they are even."""
    if xp is np and d.low.ndim == 1 and d.low.dtype == d.high.dtype == float and d.kind.dtype == np.int64:
        return _known_span(*(a.tobytes() for a in d))
    u_low = mapped(d.kind, d.low, xp)
    return u_low, mapped(d.kind, d.high, xp) - u_low


def to_parameters(d: Domains, x: Any, xp: ModuleType = jnp) -> Mapped:
    """The parameters at unconstrained coordinates x (..., P)."""
    u_low, width = _span(d, xp)
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


def at_bounds(d: Domains, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which parameters lie on their lower, and which on their upper bound (to 1e-9 of the domain's size there)."""
    span = np.minimum(d.high - d.low, 1.0)
    return p - d.low <= 1e-9 * span, d.high - p <= 1e-9 * span


def snapped(d: Domains, p: np.ndarray) -> np.ndarray:
    """The parameters, those within rounding of a bound on it."""
    low, high = at_bounds(d, p)
    return np.where(low, d.low, np.where(high, d.high, p))
