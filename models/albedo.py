"""Integrals over the hemisphere, each with a bound on its error, and rules chosen by that bound.

A lobe is integrated in the unit square of its own map (`AbstractBRDF.lobe_map`), where it is smooth whatever its
width, by Gauss–Legendre panels whose order doubles until the bound meets the tolerance. Terms of a sum go apart.
"""

import functools
from collections.abc import Iterable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from gonio.models.arrays import Channels, Scalar
from gonio.models.brdf import AbstractBRDF
from gonio.models.compiled.dispatch import Formula
from gonio.models.compiled.dispatch import values as program_values
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.horizon import Hemispheres
from gonio.models.kept_jit import kept_jit

ORDERS = (4, 8, 16, 32, 64, 128)  # nodes of each panel along each side: 8·order² evaluations
NODES_A_CALL, COSTLY_NODES_A_CALL = 2048, 512
INCIDENCES_A_CALL = 8

HIDDEN = 2e-11
"""Share that no two orders may tell apart: at the horizon, shadowing by narrow lobes (α < 1e-3) turns within α."""

ALGEBRAIC = 1 / 8
"""Of the change before, that may remain where kinks inside the panels make rules converge by a factor an order; all of
it where the slope is infinite at them."""


class Estimate(NamedTuple):
    """An integral, a bound on its absolute error, and the evaluations of f that it took."""

    value: np.ndarray
    bound: np.ndarray
    evaluations: int


@functools.lru_cache
def panel_rule(order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(u1, u2, weight) of Gauss–Legendre in panels of the unit square: four along u1, two along u2."""
    x, w = np.polynomial.legendre.leggauss(order)
    u, v = ((np.arange(n)[:, None] + 0.5 + 0.5 * x) / n for n in (4, 2))
    u1, u2 = (g.ravel() for g in np.meshgrid(u.ravel(), v.ravel(), indexing="ij"))
    return u1, u2, np.outer(np.tile(w, 4) / 8, np.tile(w, 2) / 4).ravel()


@kept_jit
def _term_sums(
    brdf_terms: tuple[AbstractBRDF, ...], side: Scalar, wi: Direction, u1: Scalar, u2: Scalar, weight: Scalar
) -> list[tuple[Channels, Channels]]:
    # `side` is 1 for what leaves in front, -1 for what leaves behind.
    def one(term: AbstractBRDF, w: Direction) -> tuple[Channels, Channels]:
        def node(a: Scalar, b: Scalar, c: Scalar) -> Channels:
            return term.flux(w, a, b, side) * c

        values = jax.vmap(node)(u1, u2, weight)
        return jnp.sum(values, 0), jnp.sum(jnp.abs(values), 0)

    return [jax.vmap(lambda w, t=term: one(t, w))(wi) for term in brdf_terms]


def _padded(a: np.ndarray, size: int, fill: float) -> np.ndarray:
    return np.concatenate([a, np.full(size - a.size, fill)])


def _costly(brdf_terms: tuple[AbstractBRDF, ...]) -> bool:
    return any(term.costly for term in brdf_terms)


def _rule_sums(brdf_terms: tuple[AbstractBRDF, ...], side: float, wi: Direction, order: int) -> list[np.ndarray]:
    """(Σ, Σ of absolute values) of each term by the rule of one order."""
    sums = [sums_by_loops(term, side, wi, order) for term in brdf_terms]
    others = [k for k, values in enumerate(sums) if values is None]
    if others:
        for k, values in zip(others, _xla_sums(tuple(brdf_terms[k] for k in others), side, wi, order), strict=True):
            sums[k] = values
    return [values for values in sums if values is not None]


def _flux(term: AbstractBRDF, *components: Scalar) -> Channels:
    return term.flux(Direction(*components[:3]), *components[3:])


FLUX = Formula(_flux, ((0,),) * 3 + ((1,),) * 2 + ((),))


def sums_by_loops(term: AbstractBRDF, side: float, wi: Direction, order: int) -> np.ndarray | None:
    """Light of a term in a hemisphere by the rule of one order: of a compiled loop over incidences and nodes.

    Args:
        term: a term of a model.
        side: 1 for light above the surface, −1 for light below it.
        wi: directions of the light (n,).
        order: of `panel_rule`.

    Returns:
        The sum and that of the absolute values (2, n, *channels); None where XLA has to compute them.
    """
    dtype = jax.dtypes.canonicalize_dtype(float)
    u1, u2, weight = (a.astype(dtype) for a in panel_rule(order))
    incidences, total = [np.asarray(c, dtype) for c in wi], None
    for start in range(0, u1.size, NODES_A_CALL):
        nodes = slice(start, start + NODES_A_CALL)
        arrays = [*incidences, u1[nodes], u2[nodes], np.asarray(side, dtype)]
        values = program_values(FLUX, term, arrays, (incidences[0].size, u1[nodes].size), dtype)
        if values is None:
            return None
        sums = np.stack([np.tensordot(v, weight[nodes], axes=(1, 0)) for v in (values, np.abs(values))])
        total = sums if total is None else total + sums
    return total


def _xla_sums(brdf_terms: tuple[AbstractBRDF, ...], side: float, wi: Direction, order: int) -> list[np.ndarray]:
    # One compiled program for every order and number of incidences: nodes and incidences are padded to fixed blocks.
    (u1, u2, weight), number = panel_rule(order), wi.z.size
    wi = Direction(*(jnp.asarray(_padded(c, INCIDENCES_A_CALL, float(c[0]))) for c in wi))
    blocks, size = [], COSTLY_NODES_A_CALL if _costly(brdf_terms) else NODES_A_CALL
    for start in range(0, u1.size, size):
        block = (
            _padded(a[start : start + size], size, f) for a, f in zip((u1, u2, weight), (0.3, 0.3, 0.0), strict=True)
        )
        sums = _term_sums(brdf_terms, jnp.asarray(side), wi, *(jnp.asarray(a) for a in block))
        blocks.append([np.stack([np.asarray(p)[:number] for p in pair]) for pair in sums])
    return [functools.reduce(np.add, sums) for sums in zip(*blocks, strict=True)]


def _floor(absolute: np.ndarray) -> np.ndarray:
    return (64 * np.finfo(np.dtype(jnp.result_type(float))).eps + HIDDEN) * absolute


def directional_albedo(
    brdf: AbstractBRDF, theta_i: ArrayLike, phi_i: ArrayLike = 0.0, tolerance: float = 1e-9
) -> Estimate:
    """∫ f cosθo dωo over the hemisphere of the light from (theta_i, phi_i), radians: the share that is reflected.

    theta_i in [0, π/2) is light of the front, in (π/2, π] from behind. Shapes: the angles broadcast to S; value and
    bound have S, or S + (channels,). `tolerance` is absolute. Orders double until every bound meets it or the last
    order is reached: the bound says which.
    """
    return _integrals(brdf, theta_i, phi_i, tolerance, Hemispheres.REFLECTION)


def directional_transmittance(
    brdf: AbstractBRDF, theta_i: ArrayLike, phi_i: ArrayLike = 0.0, tolerance: float = 1e-9
) -> Estimate:
    """∫ f |cosθo| dωo over the hemisphere opposite to the light: the share that is transmitted.

    Arguments and shapes are those of `directional_albedo`; 0 for a surface that only reflects.
    """
    return _integrals(brdf, theta_i, phi_i, tolerance, Hemispheres.TRANSMISSION)


def _integrals(
    brdf: AbstractBRDF, theta_i: ArrayLike, phi_i: ArrayLike, tolerance: float, way: Hemispheres
) -> Estimate:
    theta, phi = np.broadcast_arrays(np.asarray(theta_i, float), np.asarray(phi_i, float))
    behind = theta.ravel() > np.pi / 2
    done, whole, evaluations = [], True, 0
    for which, back in ((np.flatnonzero(~behind), False), (np.flatnonzero(behind), True)):
        parts = _scattering(brdf, way, back)
        side = -1.0 if back == (way == Hemispheres.REFLECTION) else 1.0
        whole &= len(parts) == len(brdf.terms()) or not which.size
        if which.size and parts:
            value, bound, n = _terms_integrals(parts, side, theta.ravel()[which], phi.ravel()[which], tolerance)
            done.append((which, value, bound))
            evaluations += n
    # Terms that are left out may be those with channels.
    channels = done[0][1].shape[1:] if whole and done else _channel_shape(brdf)
    value, bound = (np.zeros((theta.size, *channels)) for _ in range(2))
    for here, *pair in done:
        value[here], bound[here] = (a.reshape(here.size, *[-1] * len(channels)) for a in pair)
    value, bound = (a.reshape(theta.shape + channels) for a in (value, bound))
    return Estimate(value, bound, evaluations)


def _scattering(brdf: AbstractBRDF, way: Hemispheres, back: bool) -> tuple[AbstractBRDF, ...]:
    """The terms that reflect, or transmit, light of the front or from behind."""
    scattered = Hemispheres.BACK if back and way == Hemispheres.REFLECTION else way
    return tuple(term for term in brdf.terms() if scattered in term.hemispheres)


def _channel_shape(brdf: AbstractBRDF) -> tuple[int, ...]:
    w = Direction(*(jax.ShapeDtypeStruct((), jnp.result_type(float)) for _ in range(3)))
    return eqx.filter_eval_shape(lambda b, d: b.f(d, d), brdf, w).shape


def _terms_integrals(
    parts: tuple[AbstractBRDF, ...], side: float, theta: np.ndarray, phi: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """(value, bound, evaluations) of the sum of terms; only what misses its tolerance goes on to the next order."""
    terms = [_Term(theta.size, 1.0 if p.totally_reflects else ALGEBRAIC if p.kinked else 0.0) for p in parts]
    evaluations = 0
    for order in ORDERS[1:] if _costly(parts) else ORDERS:
        some = [i for i, term in enumerate(terms) if term.unmet.any()]
        rows = np.flatnonzero(np.any([terms[i].unmet for i in some], axis=0)) if some else np.zeros(0, int)
        for start in range(0, rows.size, INCIDENCES_A_CALL):
            here = rows[start : start + INCIDENCES_A_CALL]
            wi = from_spherical(theta[here], phi[here], np)
            sums = _rule_sums(tuple(parts[i] for i in some), side, wi, order)
            evaluations += 8 * order**2 * here.size * len(some)
            for i, (value, absolute) in zip(some, sums, strict=True):
                terms[i].refine(here, value, absolute, tolerance / len(parts))
    # Terms without channels broadcast against those that have some, so no array of them all can be made.
    pairs = [(term.value, term.bound) for term in terms]
    value, bound = (functools.reduce(np.add, [_channels_last(pair[k], pairs) for pair in pairs]) for k in (0, 1))
    return value, bound, evaluations


class _Term:
    """The integrals of a term at some incidences, with the last changes, by which their errors are bounded."""

    def __init__(self, count: int, remains: float = 0.0) -> None:
        self.remains = remains  # of the change before, where rules converge by no more than a factor an order
        self.unmet = np.ones(count, bool)
        self.value, self.bound, self.step = (np.full(count, np.nan) for _ in range(3))

    def refine(self, here: np.ndarray, value: np.ndarray, absolute: np.ndarray, tolerance: float) -> None:
        """Takes the sums of the next order at the incidences `here`, of which those that are unmet need it."""
        if value.ndim > self.value.ndim:
            self.value = np.full((self.unmet.size, *value.shape[1:]), np.nan)
            self.bound, self.step = self.value.copy(), self.value.copy()
        needed = self.unmet[here]
        if not needed.any():
            return
        here, value, absolute = here[needed], value[needed], absolute[needed]
        change = np.abs(value - self.value[here])
        earlier = np.where(np.isnan(self.step[here]), change, self.step[here])
        # Agreement of two orders by accident is caught by the square of the change before it; of the first two, by a
        # third order.
        bound = 2 * change + earlier * np.minimum(earlier + self.remains, 1.0) + _floor(absolute)
        met = (bound <= tolerance) & (np.isfinite(self.step[here]) | (change <= _floor(absolute)))
        self.value[here], self.bound[here], self.step[here] = value, bound, change
        self.unmet[here] = ~np.all(met.reshape(here.size, -1), axis=1)


def _channels_last(a: np.ndarray, everything: Iterable[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    channels = any(v.ndim > 1 for v, _ in everything)
    return a[:, None] if channels and a.ndim == 1 else a


def hemispherical_albedo(brdf: AbstractBRDF, tolerance: float = 1e-8) -> Estimate:
    """2 ∫ E(μ) μ dμ, averaged over the azimuth of incidence: the share reflected of uniform light in front.

    Shapes () or (channels,). The bound adds the rule's own error to that of the directional albedos.
    """
    evaluations, previous, earlier = 0, None, None
    for order in (4, 8, 16, 32):
        x, w = np.polynomial.legendre.leggauss(order)
        theta = (x + 1) * np.pi / 4
        weight = w * np.pi / 4 * 2 * np.cos(theta) * np.sin(theta)
        azimuths = [0.0] if brdf.isotropic else np.arange(order) * np.pi / order
        albedo = directional_albedo(brdf, theta[:, None], np.asarray(azimuths)[None, :], tolerance / 4)
        evaluations += albedo.evaluations
        value, inner = (np.tensordot(weight, a.mean(axis=1), axes=(0, 0)) for a in albedo[:2])
        if previous is not None:
            change = np.abs(value - previous)
            bound = 2 * change + (change if earlier is None else earlier) ** 2 + inner
            if np.all(bound <= tolerance):
                break
            earlier = change
        previous = value
    return Estimate(value, bound, evaluations)
