"""Rays of disc apertures: nodes in discs laid out gnomonically, cut by the horizon, and sums of f over pairs of rays.

A disc's nodes (see `disc_frames`) are x = cos ψ, y = v sin ψ: a rule in ψ from 0 to where the horizon cuts the disc, a
rule in v from −1 to 1 along the chord, so that the integrand is smooth whether the disc is whole or cut.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction, normalize
from gonio.models.kept_jit import kept_jit
from gonio.models.warps.disc_frames import DiscFrame, disc_frame, disc_ray, psi_of_horizon

NODES_MAX = 180
Array = jax.Array | np.ndarray
State = tuple[jax.Array, ...]
"""Sums of a loop."""


class Rule(NamedTuple):
    """A rule of n × m nodes in a disc: columns over ψ and rows along the chords, both padded to one size."""

    columns: np.ndarray
    rows: np.ndarray
    n: np.ndarray
    m: np.ndarray


class Disc(NamedTuple):
    """Discs of one half-angle, radians, about the directions of some lanes, with the rule of their nodes."""

    axis: Direction
    half_angle: jax.Array
    rule: Rule


class Frame(NamedTuple):
    """Frames of discs, and ψ where the horizon cuts them, if it does."""

    disc: DiscFrame
    psi_end: jax.Array | None


class Column(NamedTuple):
    """Nodes of one ψ: x in units of the axis, half the length of the chord, weight."""

    x: jax.Array
    chord: jax.Array
    weight: jax.Array


@functools.cache
def disc_rule(n: int, m: int) -> Rule:
    """A rule of n × m nodes.

    ψ: Gauss-Legendre in [0, 1] and its weights, for a disc that is cut; cos ψ, sin ψ and weights of Gauss's rule of
    the second Chebyshev kind for a whole one, which with v is exact to degree 2 min(n, m) − 1 in (x, y). v:
    Gauss-Legendre.
    """
    g, w_g = np.polynomial.legendre.leggauss(n)
    psi = np.pi * np.arange(1, n + 1) / (n + 1)
    columns = np.stack([0.5 * (1 + g), 0.5 * w_g, np.cos(psi), np.sin(psi), np.sin(psi) ** 2 / (n + 1)], axis=1)
    if n == 1:
        columns[0, 2] = 0.0
    rows = np.stack(np.polynomial.legendre.leggauss(m), axis=1)
    columns, rows = (np.pad(a, ((0, NODES_MAX - len(a)), (0, 0))) for a in (columns, rows))
    return Rule(columns, rows, np.asarray(n), np.asarray(m))


@kept_jit
def disc_sums(
    brdf: AbstractBRDF, source: Disc, detector: Disc, first: Array, stride: Array, crossing: bool
) -> tuple[jax.Array, ...]:
    """Sums over the source's nodes first, first + stride, ... of each lane, and all of the detector's.

    (Σ w f (channels, lanes), Σ weights of the source, of the detector, largest |f| met, f at the mirror configuration.)
    """
    value = jax.vmap(lambda i, o: jnp.atleast_1d(brdf.f(i, o)), out_axes=1)
    frame_i, frame_o = (_frame(disc, crossing) for disc in (source, detector))
    probe = jnp.max(jnp.abs(value(*_towards_mirror(source, detector))), axis=0)
    rule_i, rule_o = source.rule, detector.rule
    zero = jnp.zeros_like(source.axis.x)
    shape = jax.eval_shape(value, source.axis, detector.axis).shape

    def over_source(j: jax.Array, state: State) -> State:
        total, weights_i, _, met = state
        node = first + j * stride
        inside = node < rule_i.n * rule_i.m
        node = jnp.where(inside, node, 0)
        column = _column(frame_i, rule_i.columns[node // rule_i.m].T)
        ray_i, weight_i = _ray(frame_i, column, rule_i.rows[node % rule_i.m].T)
        weight_i = jnp.where(inside, weight_i, 0.0)

        def over_column(k: jax.Array, state: State) -> State:
            column = _column(frame_o, rule_o.columns[k])

            def over_row(m: jax.Array, state: State) -> State:
                total, weights_o, met = state
                ray_o, weight_o = _ray(frame_o, column, rule_o.rows[m])
                f = jnp.where((weight_i * weight_o > 0)[None], value(ray_i, ray_o), 0.0)
                total = total + (weight_i * weight_o)[None] * f
                return total, weights_o + weight_o, jnp.maximum(met, jnp.max(jnp.abs(f), axis=0))

            return jax.lax.fori_loop(0, rule_o.m, over_row, state)

        total, weights_o, met = jax.lax.fori_loop(0, rule_o.n, over_column, (total, zero, met))
        return total, weights_i + weight_i, weights_o, met

    start = (jnp.zeros(shape), zero, zero, zero)
    steps = (rule_i.n * rule_i.m + stride - 1) // stride
    return *jax.lax.fori_loop(0, steps, over_source, start), probe


def _frame(disc: Disc, crossing: bool) -> Frame:
    frame = disc_frame(disc.axis, jnp.tan(disc.half_angle))
    return Frame(frame, psi_of_horizon(frame) if crossing else None)


def _column(frame: Frame, node: Array) -> Column:
    """The nodes of one ψ in each lane's disc."""
    g, w_g, cos_psi, sin_psi, weight = node
    if frame.psi_end is not None:
        psi = frame.psi_end * g
        cos_psi, sin_psi = jnp.cos(psi), jnp.sin(psi)
        weight = w_g * frame.psi_end * sin_psi**2
    return Column(frame.disc.tan_s * cos_psi, frame.disc.tan_s * sin_psi, weight)


def _ray(frame: Frame, column: Column, node: Array) -> tuple[Direction, jax.Array]:
    """The direction of one node in each lane's disc, and its weight × cosθ (common factors left out)."""
    v, w_v = node
    ray, share = disc_ray(frame.disc, column.x, column.chord * v)
    return ray, column.weight * w_v * share


def _towards_mirror(source: Disc, detector: Disc) -> tuple[Direction, Direction]:
    """The pair within the discs that is nearest to mirror reflection."""
    wi, wo = source.axis, detector.axis
    mirror_i, mirror_o = Direction(-wi.x, -wi.y, wi.z), Direction(-wo.x, -wo.y, wo.z)
    gap = [a - b for a, b in zip(mirror_i, wo, strict=True)]
    angle = 2 * jnp.arcsin(jnp.clip(0.5 * jnp.sqrt(sum(c * c for c in gap)), 0.0, 1.0))
    reach = jnp.maximum(jnp.maximum(angle, source.half_angle + detector.half_angle), 1e-30)

    def moved(w: Direction, target: Direction, s: jax.Array) -> Direction:
        return normalize(Direction(*(a + s / reach * (b - a) for a, b in zip(w, target, strict=True))))

    return moved(wi, mirror_o, source.half_angle), moved(wo, mirror_i, detector.half_angle)
