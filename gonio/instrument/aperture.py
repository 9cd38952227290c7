"""What disc apertures read: f averaged over both discs, with the quadrature's own error beside it.

    reading = ∫∫ f cosθi cosθo dωi dωo / (∫ cosθi dωi · ∫ cosθo dωo),   directions below the horizon left out

A disc about the direction n is laid out gnomonically, n + tan s·(x t + y b) with t towards the normal: the horizon
is then a straight line. Its nodes are x = cos ψ, y = v sin ψ: a rule in ψ from 0 to where the horizon cuts the disc,
a rule in v from −1 to 1 along the chord, so that the integrand is smooth whether the disc is whole or cut. Each step
of a ladder takes more nodes; a cell climbs until two steps agree. Source and detector use the same rule in frames that
depend only on their own direction, so that with equal discs the reading of a reciprocal f is reciprocal.
"""

import functools
import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction, normalize

LANES = 2048
"""Lanes of the kernel: all calls have this shape, so that one compiled program serves every step."""
LADDERS = (
    (0.4, ((2, 2), (3, 3), (5, 5), (8, 8), (12, 12), (18, 18), (27, 27), (40, 40), (60, 60), (90, 90), (135, 135))),
    (0.15, ((2, 2), (3, 3), (4, 6), (6, 10), (9, 16), (13, 24), (20, 36), (29, 54), (43, 80), (64, 120), (96, 180))),
    (-1.0, ((2, 2), (3, 3), (4, 8), (6, 14), (8, 24), (11, 40), (16, 64), (20, 86), (30, 120), (45, 180))),
)
"""Nodes in ψ and along the chords, step by step, for cells whose lower cosine is above the first number: a lobe seen
at grazing is narrower in azimuth, by the cosine, than in polar angle."""
NODES_MAX = 180
PAIRS_MAX = 3_000_000
"""Pairs of rays of one cell at which the climb ends: 40² × 40²."""
PEAK_MISSED = 2.0
"""A cell climbs on while f at the mirror configuration within its discs is this many times what its rays have met."""


def average(
    brdf: AbstractBRDF,
    wi: Direction,
    wo: Direction,
    source_half_angle: float,
    detector_half_angle: float,
    tolerance: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """(readings in 1/sr, estimates of their error): (n, channels) each, for NumPy directions of shape (n,).

    Half-angles in [0, π/4], radians; 0 is a point. `tolerance(values, cells)` says which error is allowed to values;
    where the estimate stays above it, the ladder was at its end. The estimate is how much the last two steps differ,
    which is the error of the coarser one. 0 where a whole disc is below the horizon.
    """
    wi, wo = (np.stack([np.asarray(c, np.float64) for c in w]) for w in (wi, wo))
    half = (source_half_angle, detector_half_angle)
    lower = np.minimum(wi[2], wo[2])
    kinds = np.sum([lower <= bound for bound, _ in LADDERS[:-1]], axis=0)
    kinds[_crosses(wi[2], half[0]) | _crosses(wo[2], half[1])] = len(LADDERS)
    values = error = None
    for kind in np.unique(kinds) if kinds.size else [0]:
        cells = np.flatnonzero(kinds == kind)
        crossing = bool(kind == len(LADDERS))
        ladder = LADDERS[-1 if crossing else kind][1]
        allowed = functools.partial(_allowed, tolerance, cells)
        got = _climb(brdf, wi[:, cells], wo[:, cells], half, ladder, allowed, crossing)
        if values is None:
            values, error = (np.zeros((wi.shape[1], got[0].shape[1])) for _ in range(2))
        values[cells], error[cells] = got
    return values, error


def irradiance(cos_theta: np.ndarray, half_angle: float) -> np.ndarray:
    """Irradiance from a disc source at these cosines (n,), relative to normal incidence: cosθ, if it is wholly up."""
    from gonio.models.geometry.solid_angle import projected_cap

    cosine = np.maximum(np.asarray(cos_theta, np.float64), 0.0)
    at = np.flatnonzero(_crosses(cos_theta, half_angle))
    if not at.size or half_angle == 0:
        return cosine
    part = projected_cap(half_angle, np.arccos(np.clip(np.asarray(cos_theta)[at], -1.0, 1.0)))
    out = cosine.copy()
    out[at] = np.asarray(part) / (math.pi * math.sin(half_angle) ** 2)
    return out


def _allowed(tolerance, cells, values, climbing):
    return tolerance(values, cells[climbing])


def _crosses(cosine, half_angle):
    return cosine < math.sin(half_angle)


def _climb(brdf, wi, wo, half, ladder, tolerance, crossing):
    discs = sum(s > 0 for s in half)
    ladder = [rule for rule in ladder if math.prod(rule) ** discs <= PAIRS_MAX]
    values, _ = _step(brdf, wi, wo, half, ladder[0], crossing)
    error = np.full(values.shape, np.inf)
    climbing = np.arange(wi.shape[1])
    for rule in ladder[1:]:
        if not climbing.size:
            break
        finer, missed = _step(brdf, wi[:, climbing], wo[:, climbing], half, rule, crossing)
        difference = np.abs(finer - values[climbing])
        # A peak that no ray has met is an error as large as itself, until one meets it.
        difference = np.where(missed > PEAK_MISSED, np.maximum(difference, np.abs(finer)), difference)
        values[climbing], error[climbing] = finer, difference
        rough = ~(difference <= tolerance(finer, climbing)) & np.isfinite(finer)
        climbing = climbing[rough.any(axis=1)]
    return values, error


def _step(brdf, wi, wo, half, rule, crossing):
    """One rule on all cells: (values, f at the mirror configuration over the largest f met)."""
    nodes = [_nodes(*(rule if s > 0 else (1, 1))) for s in half]
    # Arrays all, or each number would be compiled in.
    radii = [jnp.asarray(s, jnp.result_type(float)) for s in half]
    split = _lanes_per_cell(math.prod(rule) if half[0] > 0 else 1)
    per_call = LANES // split
    with_node = np.tile(np.arange(split), per_call)

    def call(at):
        lanes = [_lanes(w[:, at : at + per_call], split, per_call) for w in (wi, wo)]
        total, *rest = _kernel(brdf, *lanes, with_node, np.asarray(split), *nodes, *radii, crossing)
        return [np.asarray(a).reshape(per_call, split, -1) for a in (total.T, *rest)]

    out = []
    for total, weight_i, weight_o, met, probe in _on_all_cores(call, range(0, max(wi.shape[1], 1), per_call)):
        weight = weight_i.sum(axis=1) * weight_o[:, 0]
        lit = weight > 0
        value = np.where(lit, total.sum(axis=1) / np.where(lit, weight, 1.0), 0.0)
        met = np.maximum(met.max(axis=1), 1e-300)
        out.append((value, np.where(lit, probe[:, 0] / met, 0.0)))
    return tuple(np.concatenate(a)[: wi.shape[1]] for a in zip(*out, strict=True))


def _on_all_cores(call, starts):
    # The kernel is a loop of small steps, which the compiler leaves to one core. Compiled once, before the others.
    first, *others = starts
    done = [call(first)]
    if others:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            done += pool.map(call, others)
    return done


def _lanes_per_cell(nodes):
    # By the rule alone, never by how many cells there are: a cell's value is summed in one order in any batch.
    return 1 if nodes < 64 else 16 if nodes < 400 else 512


def _lanes(w, split, per_call):
    if w.shape[1] < per_call:
        spare = np.zeros((3, per_call - w.shape[1]))
        spare[2] = 1.0
        w = np.concatenate([w, spare], axis=1)
    return Direction(*(np.repeat(c, split).astype(jnp.result_type(float)) for c in w))


@functools.cache
def _nodes(n: int, m: int):
    """A rule of n × m nodes: columns over ψ, columns over v (both padded), n and m.

    ψ: Gauss-Legendre in [0, 1] and its weights, for a disc that is cut; cos ψ, sin ψ and weights of Gauss's rule of
    the second Chebyshev kind for a whole one, which with v is exact to degree 2 min(n, m) − 1 in (x, y). v:
    Gauss-Legendre.
    """
    g, w_g = np.polynomial.legendre.leggauss(n)
    psi = np.pi * np.arange(1, n + 1) / (n + 1)
    along = np.stack([0.5 * (1 + g), 0.5 * w_g, np.cos(psi), np.sin(psi), np.sin(psi) ** 2 / (n + 1)], axis=1)
    if n == 1:
        along[0, 2] = 0.0
    across = np.stack(np.polynomial.legendre.leggauss(m), axis=1)
    return *(np.pad(a, ((0, NODES_MAX - len(a)), (0, 0))) for a in (along, across)), np.asarray(n), np.asarray(m)


@eqx.filter_jit
def _kernel(brdf, wi, wo, first, stride, source, detector, s_i, s_o, crossing):
    """Sums over the source's nodes first, first + stride, ... of each lane, and all of the detector's."""
    value = jax.vmap(lambda i, o: jnp.atleast_1d(brdf.f(i, o)), out_axes=1)
    frame_i, frame_o = _frame(wi, s_i, crossing), _frame(wo, s_o, crossing)
    probe = jnp.max(jnp.abs(value(*_towards_mirror(wi, wo, s_i, s_o))), axis=0)
    (along_i, across_i, n_i, m_i), (along_o, across_o, n_o, m_o) = source, detector
    zero = jnp.zeros_like(wi.x)
    shape = jax.eval_shape(value, wi, wo).shape

    def over_source(j, state):
        total, weights_i, _, met = state
        at = first + j * stride
        inside = at < n_i * m_i
        at = jnp.where(inside, at, 0)
        ray_i, weight_i = _ray(frame_i, _column(frame_i, along_i[at // m_i].T, crossing), across_i[at % m_i].T)
        weight_i = jnp.where(inside, weight_i, 0.0)

        def over_column(k, state):
            column = _column(frame_o, along_o[k], crossing)

            def over_row(m, state):
                total, weights_o, met = state
                ray_o, weight_o = _ray(frame_o, column, across_o[m])
                f = jnp.where((weight_i * weight_o > 0)[None], value(ray_i, ray_o), 0.0)
                total = total + (weight_i * weight_o)[None] * f
                return total, weights_o + weight_o, jnp.maximum(met, jnp.max(jnp.abs(f), axis=0))

            return jax.lax.fori_loop(0, m_o, over_row, state)

        total, weights_o, met = jax.lax.fori_loop(0, n_o, over_column, (total, zero, met))
        return total, weights_i + weight_i, weights_o, met

    start = (jnp.zeros(shape), zero, zero, zero)
    steps = (n_i * m_i + stride - 1) // stride
    return *jax.lax.fori_loop(0, steps, over_source, start), probe


def _frame(w, half_angle, crossing):
    """Axis, unit tangent towards the normal, horizontal one, tan s, and the ψ at which the horizon cuts the disc."""
    sin_t = jnp.sqrt(w.x**2 + w.y**2)
    tilted = sin_t > 0
    safe = jnp.where(tilted, sin_t, 1.0)
    cos_p, sin_p = jnp.where(tilted, w.x / safe, 1.0), jnp.where(tilted, w.y / safe, 0.0)
    up = Direction(-w.z * cos_p, -w.z * sin_p, sin_t)
    tan_s = jnp.tan(half_angle)
    if not crossing:
        return w, up, (-sin_p, cos_p), tan_s, None
    reach = w.z / jnp.maximum(sin_t * tan_s, 1e-30)
    return w, up, (-sin_p, cos_p), tan_s, jnp.arccos(jnp.clip(-reach, -1.0, 1.0))


def _column(frame, node, crossing):
    """(x, half the length of the chord, weight) of the nodes of one ψ in each lane's disc, in the units of n."""
    *_, tan_s, psi_end = frame
    g, w_g, cos_psi, sin_psi, weight = node
    if crossing:
        psi = psi_end * g
        cos_psi, sin_psi = jnp.cos(psi), jnp.sin(psi)
        weight = w_g * psi_end * sin_psi**2
    return tan_s * cos_psi, tan_s * sin_psi, weight


def _ray(frame, column, node):
    """The direction of one node in each lane's disc, and its weight × cosθ (what they have in common left out)."""
    axis, up, (b_x, b_y), *_ = frame
    x, chord, weight = column
    v, w_v = node
    y = chord * v
    inverse = 1.0 / jnp.sqrt(1.0 + x * x + y * y)
    ray = Direction(
        (axis.x + x * up.x + y * b_x) * inverse,
        (axis.y + x * up.y + y * b_y) * inverse,
        (axis.z + x * up.z) * inverse,
    )
    return ray, weight * w_v * inverse**3 * jnp.maximum(ray.z, 0.0)


def _towards_mirror(wi, wo, s_i, s_o):
    """The pair within the discs that is nearest to mirror reflection."""
    mirror_i, mirror_o = Direction(-wi.x, -wi.y, wi.z), Direction(-wo.x, -wo.y, wo.z)
    gap = [a - b for a, b in zip(mirror_i, wo, strict=True)]
    angle = 2 * jnp.arcsin(jnp.clip(0.5 * jnp.sqrt(sum(c * c for c in gap)), 0.0, 1.0))
    reach = jnp.maximum(jnp.maximum(angle, s_i + s_o), 1e-30)

    def moved(w, target, s):
        return normalize(Direction(*(a + s / reach * (b - a) for a, b in zip(w, target, strict=True))))

    return moved(wi, mirror_o, s_i), moved(wo, mirror_i, s_o)
