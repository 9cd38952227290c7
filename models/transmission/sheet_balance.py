"""The light of a sheet shared out: how far its lobes are scaled down, and what they leave to a broad term.

All by the cosine of one direction, as Chebyshev series that depend on the parameters alone. Rows of four are what the
front reflects, the back reflects, and what is transmitted from the front and from behind.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.scipy.special import i0e
from jaxtyping import Array, Bool

from gonio.models.arrays import Scalar
from gonio.models.compiled.known import whole
from gonio.models.compiling import sparing_jit
from gonio.models.fresnel import fresnel_dielectric
from gonio.models.microfacet.chebyshev import chebyshev_basis
from gonio.models.transmission.face_albedo import face_albedo
from gonio.models.transmission.rough_faces import Faces, between_cosines, cosines_outside, light_through

TERMS = 22
"""Of the series, and points that they go through. One more, 0, is there for slopes."""
SCALE = 2.0
"""Of the series' variable, over the cosines to which lobes are cut off by the horizon."""
RADII = 12
"""Nodes of a lobe's integral over the distance from the normal; of what is transmitted, on either side of its peak."""
REACH = 4.0
"""Of that integral, in widths of the lobe."""
STEPS = 4
"""By which lobes are brought below the light there is."""
AVERAGE = 32
"""Nodes of an average over directions."""
LIFTED = 1.003
"""Factors over those of their series, which ring below 1 where the factor is 1."""
NARROW = 0.015
"""Slope widths, of both faces, below which light is shared out as by a flat sheet: the table errs by more."""
TILT = 0.1
"""Facets are seen as by a cosine μ + TILT s/μ. Views of random sheets of rays chose it among 0.1, 0.3 and 1."""
FADE = 0.5
"""Of η² − 1, below which the path inside counts less in how far facets bend: lobes would be rugged."""


class Flat(NamedTuple):
    """A flat sheet in one direction.

    The share transmitted, all bounces summed; what one passage and the far side leave of what is reflected there; μ and
    η cosθ′.
    """

    through: Scalar
    mirrored: Scalar
    cosine: Scalar
    inside: Scalar


def _let_in(cosine: Scalar, inside: Scalar, eta: Scalar) -> Scalar:
    """1 − F of unpolarised light at one face, without the difference."""
    return 2.0 * cosine * inside * (1.0 / (cosine + inside) ** 2 + (eta / (eta**2 * cosine + inside)) ** 2)


def _inside(cosine: Scalar, eta: Scalar) -> Scalar:
    """η cosθ′ by Snell's law."""
    return jnp.sqrt((eta - 1.0) * (eta + 1.0) + cosine * cosine)


def flat_sheet(cosine: Scalar, eta: Scalar, clear: Scalar) -> Flat:
    """Transmittance p²k/(1 − F²k²), p = 1 − F, of a clear flat sheet whose inside passes k, and its parts."""
    inside = _inside(cosine, eta)
    passed = _let_in(cosine, inside, eta)
    reflected, kept = fresnel_dielectric(cosine, eta), clear ** (eta / inside)
    through = passed**2 * kept / ((1.0 - kept + passed * kept) * (1.0 + reflected * kept))
    return Flat(through, reflected * kept, cosine, inside)


def mean_share(w_i: Scalar, w_o: Scalar) -> Scalar:
    """(½(wᵢ⁻² + wₒ⁻²))^(−½): near the lesser, so that a grazing direction does not get the share of a steep one."""
    squares = 0.5 * (w_i**2 + w_o**2)
    some = squares > float(jnp.finfo(squares.dtype).tiny)
    return jnp.where(some, w_i * w_o / jnp.sqrt(jnp.where(some, squares, 1.0)), 0.0)


def mirrored(i: Flat, o: Flat, near2: Scalar, far2: Scalar) -> tuple[Scalar, Scalar]:
    """(share, s²) of what the far side reflects: slopes (α² near the light, far from it) make its squared width."""
    bend2 = (i.inside - i.cosine) ** 2 + (o.inside - o.cosine) ** 2
    share = mean_share(i.through * i.mirrored, o.through * o.mirrored)
    return share, bend2 * near2 + 4.0 * i.inside * o.inside * far2


def _near_one(x: Scalar, excess: Scalar) -> Scalar:
    """1 + x of small x, kept within 1 ± `most`, which falls with the excess η² − 1 of the medium."""
    most = excess / (excess + FADE)
    return 1.0 + most * x / jnp.sqrt(most**2 + x**2)


def passed(i: Flat, o: Flat, near2: Scalar, far2: Scalar, sheet: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    """(share, s²) of what gets through a sheet of this (η, clear).

    The likeliest path: inside, light goes where the slopes that it takes at both faces have their greatest probability
    [Walter 2007, eq. 21, at each face, the integral over directions inside by Laplace's method]. Facets turned towards
    a direction show it more of their area, and let more light in.
    """
    eta, clear = sheet
    sine_i, sine_o = (jnp.sqrt(jnp.maximum((1.0 - d.cosine) * (1.0 + d.cosine), 1e-30)) for d in (i, o))
    first, second = near2 * (i.inside - i.cosine) ** 2, far2 * (o.inside - o.cosine) ** 2
    off = sine_o - sine_i
    # Between the faces light goes where the slopes that it takes are likeliest.
    between = sine_i + off * first / (first + second)
    inside = jnp.sqrt((eta - between) * (eta + between))
    excess = (eta - 1.0) * (eta + 1.0)
    bend_i, bend_o = (
        excess * _near_one((inside - d.inside) * (inside + d.inside) / excess, excess) / (inside + d.cosine)
        for d in (i, o)
    )
    s2 = near2 * bend_i**2 + far2 * bend_o**2
    share, ways = 1.0, []
    for cosine, sine, tilt in ((i.cosine, sine_i, near2 * bend_i), (o.cosine, sine_o, -far2 * bend_o)):
        slope = off * tilt / s2
        towards = jnp.maximum(1.0 + slope * sine * cosine / (cosine**2 + TILT * jnp.sqrt(s2)), 0.0)
        within = jnp.maximum(1.0 + slope * between / inside, 0.0)
        share = share * towards * within
        local = jnp.clip(cosine * towards / jnp.sqrt(1.0 + slope**2), 1e-9, 1.0)
        ways.append(_let_in(local, _inside(local, eta), eta))
    kept = clear ** (eta / inside)
    way = kept * ways[0] * ways[1] / (1.0 - (1.0 - ways[0]) * (1.0 - ways[1]) * kept**2)
    return share * way, s2


class Direct(NamedTuple):
    """Of one side: series of the factor of its lobe, of the lobe's light over that, of all light; the broad level."""

    factor: Scalar
    lobes: Scalar
    light: Scalar
    level: Scalar

    def shares(self, basis: Scalar) -> tuple[Scalar, Scalar]:
        """(factor of the lobe, what the broad term gets)."""
        factor, rest = shared(*(_summed(a, basis) for a in self[:3]))
        return factor, self.level * rest


def shared(factor: Scalar, lobes: Scalar, light: Scalar) -> tuple[Scalar, Scalar]:
    """(the factor, what its lobe leaves) where it would be so much, its lobe's light so many times it, and all light.

    No lobe gets more than there is, and what is left goes by the lesser factor: however series err, hardly any light is
    gained. Factors of 1, the most, are series that ring below it: they are lifted.
    """
    light = jnp.maximum(light, 0.0)
    factor = jnp.minimum(jnp.clip(LIFTED * factor, 0.0, 1.0), light / jnp.maximum(lobes, 1e-12))
    return factor, jnp.maximum(light - factor * lobes, 0.0)


class Balance(NamedTuple):
    """What `Direct` holds, four rows; of the level the average, over directions, of what broad terms share out."""

    factors: Scalar
    lobes: Scalar
    light: Scalar
    averages: Scalar

    def on(self, front: Bool[Array, ""], passes: bool) -> tuple[Direct, Direct]:
        """Of the side that light enters, then of the side that it leaves."""
        first, second = (2, 3) if passes else (0, 1)
        # What a broad term has of a direction is its rest, over the root of the greater average of both sides.
        greater = jnp.maximum(jnp.maximum(self.averages, _other(self.averages)), 1e-12)
        row_sets = *self[:3], 1.0 / jnp.sqrt(greater)
        entering = Direct(*(jnp.where(front, rows[first], rows[second]) for rows in row_sets))
        return entering, Direct(
            *(jnp.where(front, rows[second], rows[first]) for rows in row_sets)
        ) if passes else entering


def grazing_scale(alpha: Scalar, behind: Scalar, eta: Scalar) -> Scalar:
    """Cosines to which what gets through is widened beyond the horizon; the series' variable is fine below."""
    return SCALE * jnp.sqrt(jnp.sqrt((eta - 1.0) * (eta + 1.0) * (alpha**2 + behind**2)))


def basis_of(cosine: Scalar, scale: Scalar, terms: int = TERMS + 1) -> Scalar:
    """Of the series, at a cosine."""
    return chebyshev_basis(2.0 * cosine * (1.0 + scale) / (cosine + scale) - 1.0, terms)


def _cosine_of(t: Scalar, scale: Scalar) -> Scalar:
    """The cosine at which the series' variable has gone so far from grazing, of [0, 1]."""
    return scale * t / (scale + 1.0 - t)


def _summed(series: Scalar, basis: Scalar) -> Scalar:
    return jnp.sum(basis.reshape(basis.shape + (1,) * (series.ndim - basis.ndim)) * series, 0)


@functools.lru_cache
def _points() -> tuple[np.ndarray, np.ndarray]:
    """(the variable of the points, the matrix from values there to a series)."""
    x = np.cos(np.pi * (np.arange(TERMS) + 0.5) / TERMS)
    return (x + 1) / 2, np.linalg.inv(np.polynomial.chebyshev.chebvander(x, TERMS - 1)).T


class Rays(NamedTuple):
    """Exits from which a lobe's light is summed: sines, cosines, weights of the polar angle, f/cosθ's share and s²."""

    sine: Scalar
    cosine: Scalar
    weight: Scalar
    share: Scalar
    s2: Scalar


def _rays(z_i: Scalar, faces: Faces, passes: bool) -> Rays:
    """Of lobes of light with these cosines, shape (sides, n, nodes)."""
    x, w = (jnp.asarray(a, z_i.dtype)[None, None] for a in np.polynomial.legendre.leggauss(RADII))
    near = jnp.stack([faces.alpha, faces.behind])[:, None, None] ** 2
    beta_i, flat_i = jnp.sqrt((1.0 - z_i) * (1.0 + z_i)), flat_sheet(z_i, faces.eta, faces.clear)

    def lobe(cosine: Scalar) -> tuple[Scalar, Scalar]:
        flat_o = flat_sheet(cosine, faces.eta, faces.clear)
        if passes:
            return passed(flat_i, flat_o, near, near[::-1], (faces.eta, faces.clear))
        return mirrored(flat_i, flat_o, near, near[::-1])

    reach = REACH * jnp.sqrt(lobe(z_i)[1])
    beyond = jnp.sqrt(jnp.maximum(1.0 - (beta_i + reach) ** 2, 0.0))  # lobes grow towards the horizon
    further = REACH * jnp.sqrt(lobe(beyond)[1])
    ends = jnp.stack([beta_i - reach, beta_i + jnp.maximum(reach, further)])
    inner, outer = jnp.where(ends >= 1.0, 0.5 * jnp.pi, jnp.arcsin(jnp.clip(ends, 0.0, 1.0 - 1e-7)))
    peak = jnp.arcsin(beta_i) + jnp.zeros_like(inner)
    panels = [(inner, peak), (peak, outer)] if passes else [(inner, outer)]
    theta = jnp.concatenate([0.5 * (a + b) + 0.5 * (b - a) * x for a, b in panels], -1)
    weight = jnp.concatenate([0.5 * (b - a) * w for a, b in panels], -1)
    return Rays(jnp.sin(theta), jnp.cos(theta), weight, *lobe(jnp.cos(theta)))


def lobe_matrices(cosine: Scalar, faces: Faces, scale: Scalar) -> Scalar:
    """Matrices from a factor of exits, at the points of a series, to lobes' shares of light with these cosines (n,).

    Over the azimuth a Gaussian has a closed form:
    2β/s² exp(−(β − β₀)²/s²) e^(−x)I₀(x), x = 2ββ₀/s².
    """
    z_i = cosine[None, :, None]
    beta_i = jnp.sqrt((1.0 - z_i) * (1.0 + z_i))
    both = [_rays(z_i, faces, passes) for passes in (False, True)]
    r = Rays(*(jnp.concatenate(a, -1) for a in zip(*both, strict=True)))
    ring = jnp.exp(-((r.sine - beta_i) ** 2) / r.s2) * i0e(2.0 * r.sine * beta_i / r.s2)
    values = (2.0 * r.sine * r.cosine * r.weight * r.share * ring / r.s2)[None] * basis_of(r.cosine, scale, TERMS)
    split = both[0].s2.shape[-1]
    series = jnp.concatenate([jnp.sum(values[..., :split], -1), jnp.sum(values[..., split:], -1)], 1)
    return jnp.moveaxis(series, 0, -1) @ jnp.asarray(_points()[1].T, cosine.dtype)


def _all_light(cosine: Scalar, faces: Faces) -> Scalar:
    """Shares of light at these cosines (n,), less what a face reflects at once, shape (4, n).

    Of what a face lets in, shares are polynomials between rough faces' cosines: they are as smooth as it, and in all no
    more than 1. A flat sheet shows by how much they are off.
    """
    through, entered = light_through(faces)
    alphas = jnp.stack([faces.alpha, faces.behind])
    rough = -jnp.expm1(-jnp.sum(alphas**2) / NARROW**2)

    def of_side(alpha: Scalar, through: Scalar, entered: Scalar) -> Scalar:
        # Rough faces let in grazing light too: a flat sheet as they see it, so that nodes are close enough.
        nodes, n = jnp.concatenate([cosine, cosines_outside(alpha)]), cosine.size
        softened = jnp.sqrt(nodes**2 + alpha**2 * (1.0 - nodes) * (1.0 + nodes))
        every = jnp.concatenate([cosine, softened])
        sheet = flat_sheet(every, faces.eta, faces.clear)
        shares_of_all = (
            jnp.stack([sheet.mirrored, jnp.ones_like(every)])
            * (sheet.through / (1.0 - fresnel_dielectric(every, faces.eta)))[None]
        )
        flat, like, like_nodes = jnp.split(shares_of_all, (n, 2 * n), 1)
        between = between_cosines(jnp.concatenate([through / entered[None], like_nodes]), cosine, alpha)
        shares, level = jnp.maximum(between[:2], 0.0), jnp.maximum(between[2:], 1e-3)
        right = shares * like / level
        total = jnp.minimum(jnp.sum(shares, 0) * jnp.sum(like, 0) / jnp.sum(level, 0), 1.0)
        right = right * (total / jnp.maximum(jnp.sum(right, 0), 1e-12))[None]
        return (flat + rough * (right - flat)) * (1.0 - face_albedo(cosine, alpha, faces.eta))[None]

    return jax.vmap(of_side, (0, 1, 0), 1)(alphas, through, entered).reshape(4, -1)


def _other(rows: Scalar) -> Scalar:
    """Of four rows, those of the side where light leaves that entered by theirs."""
    return jnp.stack([rows[0], rows[1], rows[3], rows[2]])


def _scaled(matrices: Scalar, light: Scalar) -> Scalar:
    """Factors ≤ 1 of the lobes' directions, by which they have no more light than there is, on either side."""

    def less(factors: Scalar) -> Scalar:
        lobes = factors * jnp.sum(matrices * _other(factors)[:, None], -1)
        return jnp.minimum(1.0, light / jnp.maximum(lobes, 1e-12))

    factors = jax.lax.fori_loop(0, STEPS - 1, lambda _, f: f * jnp.sqrt(less(f)), jnp.ones_like(light))
    return factors * less(factors)


@functools.lru_cache
def _averaging() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(nodes and weights of an integral over the variable, the series' basis at the nodes)."""
    x, w = np.polynomial.legendre.leggauss(AVERAGE)
    return (x + 1) / 2, w / 2, np.polynomial.chebyshev.chebvander(x, TERMS).T


def balance(faces: Faces, scale: Scalar) -> Balance:
    """The series of a sheet without channels."""
    points, to_series = (jnp.asarray(a, faces.eta.dtype) for a in _points())
    mu = _cosine_of(points, scale)
    light = jnp.maximum(_all_light(mu, faces), 1e-12)
    matrices = lobe_matrices(mu, faces, scale)
    factors = _scaled(matrices, light)
    lobes = jnp.sum(matrices * _other(factors)[:, None], -1)
    series = [jnp.pad(values @ to_series, ((0, 0), (0, 1))) for values in (factors, lobes, light)]
    nodes, weight, basis = (jnp.asarray(a, faces.eta.dtype) for a in _averaging())
    cosine = _cosine_of(nodes, scale)
    rate = scale * (1.0 + scale) / (scale + 1.0 - nodes) ** 2
    _, rests = shared(*(a @ basis for a in series))
    return Balance(series[0], series[1], series[2], rests @ (2.0 * weight * rate * cosine))


def _of_channels(faces: Faces, scale: Scalar) -> Balance:
    axes, by_scale = Faces(*(0 if jnp.ndim(v) else None for v in faces)), 0 if jnp.ndim(scale) else None
    if all(a is None for a in axes):
        return balance(faces, scale)
    return jax.vmap(balance, (axes, by_scale), -1)(faces, scale)


def sheet_balance(*values: Scalar) -> Balance:
    """The series of a sheet by its `Faces`, one by one, channels last."""
    faces = Faces(*values)
    return _of_channels(faces, grazing_scale(faces.alpha, faces.behind, faces.eta))


@functools.lru_cache
def stretched() -> np.ndarray:
    """Of a series Σ cₖTₖ(x), that of Σ cₖTₖ′(x) (x² − 1)/2: at a fixed cosine x moves so with ln(scale/(1 + scale))."""
    k = np.arange(TERMS) / 4.0
    return (np.diag(k, -1) - np.diag(np.arange(1, TERMS + 1) / 4.0, 1))[:, : TERMS + 1]


def sheet_balance_and_slopes(*values: Scalar) -> tuple[Balance, Balance]:
    """The series, and on another first axis their slopes by the four parameters, by differences.

    A program of exact slopes takes five times as long to compile. They are one-sided, within the domain. Slopes are
    those at a fixed cosine, of series in a variable that depends on the parameters too: what a series does not resolve
    moves with it.
    """
    faces = Faces(*values)
    r = float(jnp.finfo(faces.eta.dtype).eps) ** 0.5
    steps = r * faces.alpha, r * faces.behind, r * (faces.eta - 1.0), jnp.where(faces.clear > 0.5, -r, r)
    ends = np.vstack([np.eye(4), np.zeros(4)]).astype(faces.eta.dtype)
    near = Faces(
        *(jnp.asarray(v)[None] + jnp.multiply.outer(e, h) for v, e, h in zip(faces, ends.T, steps, strict=True))
    )
    every = jax.vmap(sheet_balance)(*near)
    scales = jax.vmap(grazing_scale)(near.alpha, near.behind, near.eta)  # one may have channels where another has none
    spans = jnp.stack(jnp.broadcast_arrays(*steps))

    def slope(a: Scalar) -> Scalar:
        """Of what has channels last, if it has any."""
        a = a.reshape(a.shape + (1,) * (spans.ndim - a.ndim))
        return (a[:4] - a[4:]) / spans.reshape(4, *(1,) * (a.ndim - spans.ndim), *spans.shape[1:])

    here: Balance = jax.tree.map(lambda a: a[4], every)
    last = scales[4:].reshape(1, *scales.shape[1:], *(1,) * (spans.ndim - scales.ndim))
    moves = (slope(scales) / (last * (1.0 + last)))[:, None, None]
    moved = (jnp.einsum("jk,rk...->rj...", jnp.asarray(stretched(), a.dtype), a) for a in here[:3])
    factors, lobes, light = (slope(a) + moves * m[None] for a, m in zip(every[:3], moved, strict=True))
    return here, Balance(factors, lobes, light, slope(every.averages))


balance_of_values = sparing_jit(sheet_balance)
balance_and_slopes_of_values = sparing_jit(sheet_balance_and_slopes)
_traced = whole(sheet_balance, balance_of_values)
_traced_with_slopes = whole(sheet_balance_and_slopes, balance_and_slopes_of_values)


@jax.custom_jvp
def sheet_light(faces: Faces) -> Balance:
    """The series of a sheet, channels last."""
    # Traced, the program stays a part of its own: what depends on no direction is then computed once.
    traced = any(isinstance(v, Tracer) for v in jax.tree.leaves(faces))
    return (_traced if traced else balance_of_values)(*faces)


@sheet_light.defjvp
def _sheet_light_jvp(primals: tuple[Faces], tangents: tuple[Faces]) -> tuple[Balance, Balance]:
    series, slopes = _traced_with_slopes(*primals[0])

    def along(a: Scalar) -> Scalar:
        return sum(
            (a[k] * jnp.broadcast_to(rate, a[0].shape) for k, rate in enumerate(tangents[0])), jnp.zeros_like(a[0])
        )

    return series, jax.tree.map(along, slopes)
