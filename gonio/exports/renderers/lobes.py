"""What renderers build surfaces of, in NumPy over pairs of directions: facets, Fresnel factors, diffusers, albedos.

Values have the shape (n, 1), or (n, C) where a number has channels (C,). The same formulas as in `gonio.models`, but
without a compilation: an export is fitted in a second.
"""

import functools
from typing import Any, Literal

import numpy as np
from scipy.interpolate import RectBivariateSpline

from gonio.exports.pairs import Pairs
from gonio.models.geometry.directions import Direction

Array = np.ndarray
Value = np.ndarray | float
"""Of a number, with or without channels."""
Smith = Literal["correlated", "separable"]
C1, C2 = 0.5 - 2 / (3 * np.pi), 2 / 3 - 28 / (15 * np.pi)
"""Of the energy-preserving Oren–Nayar model [Portsmouth, Kutz & Hill 2024]."""
F82_COSINE = 1 / 7


def column(values: Array) -> Array:
    """Values (n,) as (n, 1), which broadcast with channels."""
    return np.asarray(values)[:, None]


def _stretched(w: Direction, alpha_x: Value, alpha_y: Value) -> Array:
    return (alpha_x * column(w.x)) ** 2 + (alpha_y * column(w.y)) ** 2


def ggx_facets(pairs: Pairs, alpha_x: Value, alpha_y: Value, smith: Smith = "correlated") -> Array:
    """D G/(4 cosθi cosθo) of GGX [Walter 2007, eq. 33 and 34; Heitz 2014, eq. 72, 85 and 99]."""
    spread = [column(w.z) ** 2 + _stretched(w, alpha_x, alpha_y) for w in (pairs.wi, pairs.wo)]
    s_i, s_o = (np.sqrt(s) for s in spread)
    z_i, z_o = column(pairs.wi.z), column(pairs.wo.z)
    visible = 0.5 / (z_o * s_i + z_i * s_o) if smith == "correlated" else 1.0 / ((z_i + s_i) * (z_o + s_o))
    return ggx_density(pairs, alpha_x, alpha_y) * visible


def ggx_density(pairs: Pairs, alpha_x: Value, alpha_y: Value) -> Array:
    """D of GGX, 1/sr."""
    h = pairs.h
    s = (column(h.x) / alpha_x) ** 2 + (column(h.y) / alpha_y) ** 2 + column(h.z) ** 2
    return 1.0 / (np.pi * alpha_x * alpha_y * s * s)


def beckmann_facets(pairs: Pairs, alpha_x: Value, alpha_y: Value) -> Array:
    """D G/(4 cosθi cosθo) of Beckmann, G the product of Walter's rational fits [Walter 2007, eq. 25 and 27]."""
    h = pairs.h
    z2 = column(h.z) ** 2
    tan2 = ((column(h.x) / alpha_x) ** 2 + (column(h.y) / alpha_y) ** 2) / z2
    density = np.exp(-np.minimum(tan2, 700.0)) / (np.pi * alpha_x * alpha_y * z2 * z2)
    masked = 0.25 * density
    for w in (pairs.wi, pairs.wo):
        b, z = np.sqrt(np.maximum(_stretched(w, alpha_x, alpha_y), 1e-30)), column(w.z)
        a = np.minimum(z / b, 1.6)
        fitted = (3.535 + 2.181 * a) / (b * (1.0 + 2.276 * a + 2.577 * a * a))
        masked = masked * np.where(z >= 1.6 * b, 1.0 / z, fitted)
    return masked


def schlick(cos_d: Value, f0: Value, f90: Value = 1.0) -> Any:
    """f0 + (f90 − f0)(1 − cos)⁵ [Schlick 1994]."""
    return f0 + (f90 - f0) * (1.0 - cos_d) ** 5


def f82(cos_d: Array, f0: Value, tint: Value) -> Any:
    """Schlick's reflectance less a term that makes it `tint` times as high at 82° [Kutz et al. 2021]."""
    at_82 = schlick(F82_COSINE, f0)
    a = at_82 * (1.0 - tint) / (F82_COSINE * (1 - F82_COSINE) ** 6)
    return schlick(cos_d, f0) - a * cos_d * (1.0 - cos_d) ** 6


def f82_average(f0: Value, tint: Value) -> Value:
    """2 ∫ F μ dμ of `f82`."""
    a = schlick(F82_COSINE, f0) * (1.0 - tint) / (F82_COSINE * (1 - F82_COSINE) ** 6)
    return f0 + (1.0 - f0) / 21.0 - a / 126.0


def dielectric(cos_d: Value, eta: Value) -> Array:
    """Reflectance of a smooth dielectric of relative index `eta`, unpolarised."""
    g2 = eta * eta - 1.0 + cos_d * cos_d
    g = np.sqrt(np.maximum(g2, 0.0))
    r_s = (cos_d - g) / np.maximum(cos_d + g, 1e-30)
    r_p = (eta * eta * cos_d - g) / np.maximum(eta * eta * cos_d + g, 1e-30)
    return np.where(g2 > 0, 0.5 * (r_s * r_s + r_p * r_p), 1.0)


def conductor(cos_d: Array, eta: Value, k: Value) -> Array:
    """Reflectance of a smooth conductor of relative index η + ik, unpolarised."""
    cosine = np.asarray(cos_d, complex)
    g = np.sqrt((eta + 1j * k) ** 2 - 1.0 + cosine * cosine)
    r_s, r_p = (cosine - g) / (cosine + g), ((eta + 1j * k) ** 2 * cosine - g) / ((eta + 1j * k) ** 2 * cosine + g)
    return 0.5 * (np.abs(r_s) ** 2 + np.abs(r_p) ** 2)


@functools.cache
def _unit_rule() -> tuple[Array, Array]:
    x, w = np.polynomial.legendre.leggauss(48)
    return (x + 1) / 2, w / 2


def dielectric_average(eta: Value) -> Array:
    """2 ∫ F μ dμ of `dielectric`, for eta > 1."""
    mu, w = (a[:, None] for a in _unit_rule())
    return np.sum(2 * w * mu * dielectric(mu, eta), axis=0)


def f0_of(eta: Value) -> Value:
    """Reflectance at normal incidence of a dielectric."""
    return ((eta - 1.0) / (eta + 1.0)) ** 2


def index_of(f0: Value) -> Value:
    """Index above 1 of the dielectric that reflects `f0` at normal incidence."""
    root = np.sqrt(np.minimum(f0, 0.99999))
    return (1.0 + root) / (1.0 - root)


def _fujii_albedo(mu: Array, r: Value) -> Array:
    sin = np.sqrt(np.maximum(1.0 - mu * mu, 0.0))
    g = sin * (np.arccos(np.clip(mu, -1, 1)) - sin * mu) + 2 / 3 * (sin / mu * (1.0 - sin**3) - sin)
    return (1.0 + r * g / np.pi) / (1.0 + C1 * r)


def eon(pairs: Pairs, rho: Value, r: Value, repeated: Value = 1.0) -> Array:
    """The energy-preserving Oren–Nayar diffuser [Portsmouth, Kutz & Hill 2024]; Lambert for r = 0.

    `repeated` multiplies what is scattered more than once.
    """
    z_i, z_o = column(pairs.wi.z), column(pairs.wo.z)
    s = column(pairs.wi.x * pairs.wo.x + pairs.wi.y * pairs.wo.y)
    single = rho * (1.0 + r * np.where(s > 0, s / np.maximum(z_i, z_o), s)) / (1.0 + C1 * r)
    average = (1.0 + C2 * r) / (1.0 + C1 * r)
    lost = np.maximum(1.0 - average, 1e-12)
    several = repeated * rho * rho * average / (1.0 - rho * lost)
    missing = (1.0 - _fujii_albedo(z_i, r)) * (1.0 - _fujii_albedo(z_o, r)) / lost
    return (single + several * np.where(r > 1e-9, missing, 0.0)) / np.pi


MU_NODES, WIDTH_NODES, FEW_NORMALS = 32, 24, 16
"""Of the tables of albedos: cosines and widths; stratified normals along each side for what is computed in a search."""


def _visible(mu: Array, alpha: Array, side: int = 32) -> tuple[Array, tuple[Array, Array, Array]]:
    """(cosθd, the normal) of side² visible normals, stratified, on new last axes [Dupuy & Benyoub 2023]."""
    u = v = (np.arange(side) + 0.5) / side
    phi, u2 = np.pi * u[:, None], v[None, :]
    mu, alpha = mu[..., None, None], alpha[..., None, None]
    sin = np.sqrt(1 - mu * mu)
    length = np.sqrt((alpha * sin) ** 2 + mu * mu)
    x, z = alpha * sin / length, mu / length
    c = (1 - u2) * (1 + z) - z
    s = np.sqrt(np.clip(1 - c * c, 0, 1))
    m = alpha * (s * np.cos(phi) + x), alpha * s * np.sin(phi), np.maximum(c + z, 0.0)
    size = np.sqrt(m[0] ** 2 + m[1] ** 2 + m[2] ** 2)
    m = m[0] / size, m[1] / size, m[2] / size
    return np.clip(sin * m[0] + mu * m[2], 0, 1), m


def _passing(mu: Array, alpha: Array, out: Array) -> Array:
    """G₂/G₁ of a direction that leaves at the cosine `out` > 0; 0 where it does not leave."""
    mu, alpha = mu[..., None, None], alpha[..., None, None]
    a_i, a_o = (np.sqrt(w * w + alpha * alpha * (1 - w * w)) for w in (mu, np.maximum(out, 1e-9)))
    return np.where(out > 0, out * (mu + a_i) / (np.maximum(out, 1e-9) * a_i + mu * a_o), 0.0)


def _seen(mu: Array, alpha: Array) -> tuple[Array, Array]:
    """(cosθd, share of the light that a facet reflects which leaves) of visible normals."""
    cos_d, m = _visible(mu, alpha)
    return cos_d, _passing(mu, alpha, 2 * cos_d * m[2] - mu[..., None, None])


@functools.cache
def _albedo_splines() -> tuple[RectBivariateSpline, RectBivariateSpline]:
    mu = np.linspace(0, 1, MU_NODES) ** 2
    root = np.linspace(0.0, 1.0, WIDTH_NODES)
    cos_d, weight = _seen(np.maximum(mu, 1e-4)[:, None], np.maximum(root**2, 1e-4)[None, :])
    white, grazing = (np.mean(weight * f, axis=(-2, -1)) for f in (1.0, (1 - cos_d) ** 5))
    return RectBivariateSpline(np.sqrt(mu), root, white), RectBivariateSpline(np.sqrt(mu), root, grazing)


def ggx_albedos(mu: Array, alpha: float) -> tuple[Array, Array]:
    """∫ f cosθ dω of correlated GGX for the cosines `mu`, with F = 1 and with F = (1 − cos)⁵; alpha > 0."""
    nodes = np.linspace(0, 1, 129)
    each = (s(nodes, np.sqrt(alpha))[:, 0] for s in _albedo_splines())
    white, grazing = (np.interp(np.sqrt(mu), nodes, np.clip(e, 1e-6, 1.0)) for e in each)
    return white, grazing


def ggx_average(alpha: float) -> float:
    """2 ∫ E μ dμ of correlated GGX with F = 1."""
    mu, w = _unit_rule()
    return float(np.sum(2 * w * mu * ggx_albedos(mu, alpha)[0]))


def dielectric_share(mu: Array, alpha: float, eta: float) -> Array:
    """Albedo of a dielectric's GGX facets over that of F = 1, for the cosines `mu` (n,)."""
    nodes = np.linspace(0, 1, 16)
    cos_d, weight = _seen(np.maximum(nodes**2, 1e-4), np.full(nodes.shape, max(alpha, 1e-4)))
    shares = np.mean(weight * dielectric(cos_d, np.asarray(eta)), axis=(-2, -1)) / np.mean(weight, axis=(-2, -1))
    return np.interp(np.sqrt(mu), nodes, shares)


def interface_shares(mu: Array, alpha: float, eta: float) -> tuple[Array, Array]:
    """(R, T): shares of the light at the cosines `mu` (n,) that a rough interface reflects and lets through, once."""
    mu, widths = np.maximum(mu, 1e-4), np.full(mu.shape, max(alpha, 1e-4))
    cos_d, m = _visible(mu, widths, FEW_NORMALS)
    fresnel = dielectric(cos_d, eta)
    cos_t = np.sqrt(np.maximum(1.0 - (1.0 - cos_d * cos_d) / eta**2, 0.0))
    behind = mu[:, None, None] / eta - (cos_d / eta - cos_t) * m[2]
    back = fresnel * _passing(mu, widths, 2 * cos_d * m[2] - mu[:, None, None])
    through = (1.0 - fresnel) * _passing(mu, widths, behind)
    return np.mean(back, axis=(-2, -1)), np.mean(through, axis=(-2, -1))


def refracted(pairs: Pairs, alpha_x: Value, alpha_y: Value, eta: float, smith: Smith = "correlated") -> tuple[Any, Any]:
    """(f (n, 1) but for 1 − F, cosine between light and facet) through a rough interface [Walter 2007, eq. 21].

    "correlated" masks by 1/(1 + Λi + Λo), as renderers do there too.
    """
    v = [a + eta * b for a, b in zip(pairs.wi, pairs.wo, strict=True)]
    length2 = np.maximum(v[0] ** 2 + v[1] ** 2 + v[2] ** 2, 1e-12)
    scale = np.where(v[2] < 0, -1.0, 1.0) / np.sqrt(length2)
    h = Direction(*(c * scale for c in v))
    cos_i, cos_o = (w.x * h.x + w.y * h.y + w.z * h.z for w in (pairs.wi, pairs.wo))
    refracts = (cos_i > 0) & (cos_o < 0)
    s = (column(h.x) / alpha_x) ** 2 + (column(h.y) / alpha_y) ** 2 + column(h.z) ** 2
    density = 1.0 / (np.pi * alpha_x * alpha_y * s * s)
    z_i, z_o = column(pairs.wi.z), column(-pairs.wo.z)
    s_i, s_o = (np.sqrt(column(w.z) ** 2 + _stretched(w, alpha_x, alpha_y)) for w in (pairs.wi, pairs.wo))
    masking = 2.0 / (z_o * s_i + z_i * s_o) if smith == "correlated" else 4.0 / ((z_i + s_i) * (z_o + s_o))
    passed = column(np.where(refracts, cos_i * -cos_o * eta**2 / length2, 0.0)) * density * masking
    return passed, column(np.where(refracts, cos_i, 1.0))
