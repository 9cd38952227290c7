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
from gonio.models.fresnel import fresnel_dielectric
from gonio.models.kept_jit import kept_jit
from gonio.models.microfacet.albedo_tables import Cosines
from gonio.models.microfacet.chebyshev import chebyshev_basis
from gonio.models.transmission.rough_faces import Faces, cosines_outside, interpolation, light_through

TERMS = 20
"""Of the series."""
POINTS = 24
"""At which they are fitted."""
RADII = 20
"""Nodes of a lobe's integral over the distance from the normal."""
REACH = 4.0
"""Of that integral, in widths of the lobe."""
STEPS = 4
"""By which lobes are brought below the light there is."""
AVERAGE = 32
COSINES = Cosines(False, 3.0, 2)
"""The series' variable: fine towards grazing."""
GRAZING = 1e-9
"""Cosines below are as good as this: the variable's slope is endless at 0."""


class Flat(NamedTuple):
    """Of a flat sheet in one direction: all light that gets through, and for one passage: what the far side reflects
    of it and the inside keeps; then η cosθ′ − cosθ and η cosθ′, squared."""

    through: Scalar
    mirrored: Scalar
    bend2: Scalar
    inside2: Scalar


def flat_sheet(cosine: Scalar, eta: Scalar, clear: Scalar) -> Flat:
    inside = jnp.sqrt((eta - 1.0) * (eta + 1.0) + cosine * cosine)
    passed = 2.0 * cosine * inside * (1.0 / (cosine + inside) ** 2 + (eta / (eta**2 * cosine + inside)) ** 2)
    reflected, kept = fresnel_dielectric(cosine, eta), clear ** (eta / inside)
    through = passed**2 * kept / ((1.0 - kept + passed * kept) * (1.0 + reflected * kept))
    return Flat(through, reflected * kept, (inside - cosine) ** 2, inside**2)


def mean_share(w_i: Scalar, w_o: Scalar) -> Scalar:
    """A mean that stays near the lesser: a grazing direction must not get the greater one of the lobe's rest."""
    squares = 0.5 * (w_i**2 + w_o**2)
    some = squares > float(jnp.finfo(squares.dtype).tiny)
    return jnp.where(some, w_i * w_o / jnp.sqrt(jnp.where(some, squares, 1.0)), 0.0)


def passed_width2(i: Flat, o: Flat, near2: Scalar, far2: Scalar) -> Scalar:
    """Squared width, in direction cosines, that slopes (α² near the light, far from it) give what gets through."""
    return i.bend2 * near2 + o.bend2 * far2


def mirrored_width2(i: Flat, o: Flat, near2: Scalar, far2: Scalar) -> Scalar:
    """The same of what the far side reflects."""
    return (i.bend2 + o.bend2) * near2 + 4.0 * jnp.sqrt(i.inside2 * o.inside2) * far2


class Balance(NamedTuple):
    """Series, four rows: factors of the lobes, and what the broad terms get of a direction."""

    factors: Scalar
    rests: Scalar

    def on(self, front: Bool[Array, ""], passes: bool) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
        """(factor, rest) of the side that light enters, then of the side that it leaves."""
        first, second = (2, 3) if passes else (0, 1)
        entering = tuple(jnp.where(front, rows[first], rows[second]) for rows in self)
        leaving = tuple(jnp.where(front, rows[second], rows[first]) for rows in self) if passes else entering
        return entering, leaving  # pyright: ignore[reportReturnType]


def coordinate(cosine: Scalar) -> Scalar:
    """The variable of the series, in [−1, 1]."""
    return 2.0 * COSINES.inverse(jnp.maximum(cosine, GRAZING), jnp.ones_like(cosine)) - 1.0


def level(series: Scalar, cosine: Scalar) -> Scalar:
    """A series, which is nowhere below 0."""
    return jnp.maximum(jnp.tensordot(chebyshev_basis(coordinate(cosine), TERMS), series, 1), 0.0)


@functools.lru_cache
def _points() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(cosines of the points, the matrices from values there to a series, and from rough faces' values to there)."""
    x = np.cos(np.pi * (np.arange(POINTS) + 0.5) / POINTS)
    s2 = ((x + 1) / 2) ** 2
    mu = COSINES.c * s2 / (COSINES.c + 1 - s2)
    return mu, np.linalg.pinv(np.polynomial.chebyshev.chebvander(x, TERMS - 1)).T, interpolation(mu).T


def lobe_matrices(cosine: Scalar, faces: Faces) -> Scalar:
    """Matrices from a factor of exits, at the points of a series, to lobes' shares of light with these cosines (n,).

    Over the azimuth a Gaussian has a closed form:
    2β/s² exp(−(β − β₀)²/s²) e^(−x)I₀(x), x = 2ββ₀/s².
    """
    u, w = (jnp.asarray(a, cosine.dtype)[None, None] for a in np.polynomial.legendre.leggauss(RADII))
    front, back = faces.alpha**2, faces.behind**2
    near, far = (
        jnp.stack([front, back, front, back])[:, None, None],
        jnp.stack([back, front, back, front])[:, None, None],
    )
    passes = np.array([False, False, True, True])[:, None, None]

    def share(flat: Flat) -> Scalar:
        return flat.through * jnp.where(passes, 1.0, flat.mirrored)

    def width2(i: Flat, o: Flat) -> Scalar:
        return jnp.where(passes, passed_width2(i, o, near, far), mirrored_width2(i, o, near, far))

    z_i = cosine[None, :, None]
    beta_i = jnp.sqrt((1.0 - z_i) * (1.0 + z_i))
    flat_i = flat_sheet(z_i, faces.eta, faces.clear)
    reach = REACH * jnp.sqrt(width2(flat_i, flat_i))
    ends = jnp.stack([beta_i - reach, beta_i + reach])
    inner, outer = jnp.where(ends >= 1.0, 0.5 * jnp.pi, jnp.arcsin(jnp.clip(ends, 0.0, 1.0 - 1e-7)))
    half = 0.5 * (outer - inner)
    theta = 0.5 * (outer + inner) + half * u
    beta, z = jnp.sin(theta), jnp.cos(theta)
    flat_o = flat_sheet(z, faces.eta, faces.clear)
    s2 = width2(flat_i, flat_o)
    ring = jnp.exp(-((beta - beta_i) ** 2) / s2) * i0e(2.0 * beta * beta_i / s2)
    values = 2.0 * beta * z * half * w * mean_share(share(flat_i), share(flat_o)) * ring / s2
    series = jnp.sum(values[None] * chebyshev_basis(coordinate(z), TERMS), -1)
    return jnp.moveaxis(series, 0, -1) @ jnp.asarray(_points()[1].T, cosine.dtype)


def _flat_correction(cosine: Scalar, to_points: Scalar, faces: Faces) -> Scalar:
    """By what polynomials between rough faces' cosines are too low of a flat sheet, shape (4, n)."""
    rows = []
    for z in (cosine, jnp.maximum(jnp.asarray(cosines_outside(), cosine.dtype), 1e-9)):
        flat = flat_sheet(z, faces.eta, jnp.asarray(1.0, cosine.dtype))
        rows.append(jnp.stack([flat.through * flat.mirrored, flat.through]))
    exact, nodes = rows
    ratio = jnp.clip(exact / jnp.maximum(nodes @ to_points, 1e-12), 0.8, 1.25)
    return jnp.stack([ratio[0], ratio[0], ratio[1], ratio[1]])


def _other(rows: Scalar) -> Scalar:
    """Of four rows, those of the side where light leaves that entered by theirs."""
    return jnp.stack([rows[0], rows[1], rows[3], rows[2]])


def _scaled(matrices: Scalar, light: Scalar) -> Scalar:
    """Factors ≤ 1 of the lobes' directions, by which they have no more light than there is, on either side."""
    factors = jnp.ones_like(light)
    for step in range(STEPS):
        lobes = factors * jnp.sum(matrices * _other(factors)[:, None], -1)
        less = jnp.minimum(1.0, light / jnp.maximum(lobes, 1e-12))
        factors = factors * (jnp.sqrt(less) if step < STEPS - 1 else less)
    return factors


@functools.lru_cache
def _averaging() -> tuple[np.ndarray, np.ndarray]:
    """(the matrix from a series to values at nodes, the weights of 2 ∫ μ dμ there)."""
    x, w = np.polynomial.legendre.leggauss(AVERAGE)
    s2, c = ((x + 1) / 2) ** 2, COSINES.c
    mu, rate = c * s2 / (c + 1 - s2), c * (c + 1) / (c + 1 - s2) ** 2 * (x + 1)
    return np.polynomial.chebyshev.chebvander(x, TERMS - 1).T, w * rate * mu


def balance(faces: Faces) -> Balance:
    """The series of a sheet without channels."""
    mu, to_series, to_points = (jnp.asarray(a, faces.eta.dtype) for a in _points())
    light = jnp.maximum((light_through(faces) @ to_points) * _flat_correction(mu, to_points, faces), 1e-12)
    matrices = lobe_matrices(mu, faces)
    factors = _scaled(matrices, light)
    rests = (light - factors * jnp.sum(matrices * _other(factors)[:, None], -1)) @ to_series
    # What a broad term has of a direction is its rest, over the root of the greater average of both sides.
    to_values, weight = (jnp.asarray(a, faces.eta.dtype) for a in _averaging())
    averages = jnp.maximum(rests @ to_values, 0.0) @ weight
    greater = jnp.maximum(jnp.maximum(averages, _other(averages)), 1e-12)
    return Balance(factors @ to_series, rests / jnp.sqrt(greater)[:, None])


def _of_channels(faces: Faces) -> Balance:
    axes = Faces(*(0 if jnp.ndim(v) else None for v in faces))
    return balance(faces) if all(a is None for a in axes) else jax.vmap(balance, (axes,), -1)(faces)


@whole
def sheet_balance(faces: Faces) -> Balance:
    """The series of a sheet, channels last."""
    axes = Faces(*(0 if jnp.ndim(v) else None for v in faces))
    return balance(faces) if all(a is None for a in axes) else jax.vmap(balance, (axes,), -1)(faces)


@whole
def sheet_balance_and_slopes(faces: Faces) -> tuple[Balance, Balance]:
    """The series, and on another first axis their slopes by the four parameters, by differences.

    A program of exact slopes takes five times as long to compile. Central ones but for `clear`, which may be 0 or 1.
    """
    r = float(jnp.finfo(faces.eta.dtype).eps) ** (1 / 3)
    steps = r * faces.alpha, r * faces.behind, r * (faces.eta - 1.0), jnp.where(faces.clear > 0.5, -r, r)
    ends = np.zeros((2, 4, 4), faces.eta.dtype)
    ends[0], ends[1, :3, :3] = np.eye(4), -np.eye(3)
    moved = (
        jnp.asarray(v)[None, None] + jnp.multiply.outer(ends[..., k], h)
        for k, (v, h) in enumerate(zip(faces, steps, strict=True))
    )
    every = jax.vmap(jax.vmap(sheet_balance))(Faces(*moved))
    spans = jnp.stack(jnp.broadcast_arrays(*(2.0 * h for h in steps[:3]), steps[3]))[:, None, None]
    return jax.tree.map(lambda a: a[1, 3], every), jax.tree.map(lambda a: (a[0] - a[1]) / spans, every)


_kept = kept_jit(sheet_balance)


@jax.custom_jvp
def sheet_light(faces: Faces) -> Balance:
    """The series of a sheet, channels last."""
    # Traced, the program stays a part of its own: what depends on no direction is then computed once.
    traced = any(isinstance(v, Tracer) for v in jax.tree.leaves(faces))
    return sheet_balance(faces) if traced else _kept(faces)


@sheet_light.defjvp
def _sheet_light_jvp(primals: tuple[Faces], tangents: tuple[Faces]) -> tuple[Balance, Balance]:
    series, slopes = sheet_balance_and_slopes(*primals)

    def along(a: Scalar) -> Scalar:
        return sum(
            (a[k] * jnp.broadcast_to(rate, a[0].shape) for k, rate in enumerate(tangents[0])), jnp.zeros_like(a[0])
        )

    return series, jax.tree.map(along, slopes)
