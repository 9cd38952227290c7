"""Textbook forms of models that count several reflections: energy compensation, coats, coupled matte layers, Disney's.

Their albedos are integrals of this package, in double precision (see albedo.py); all else has the caller's digits.
"""

import functools
from collections.abc import Callable

import numpy as np
from scipy.special import erfcx

from gonio.stability.textbook import albedo as integral
from gonio.stability.textbook import fresnel, microfacet
from gonio.stability.textbook.frame import Options, Pair, Params, TextbookForm, Vector, mp, mpf


def _ggx_lambda(alpha: float, mu: np.ndarray) -> np.ndarray:
    return (np.sqrt(1 + alpha**2 * (1 - mu) * (1 + mu) / mu**2) - 1) / 2


def _beckmann_lambda(alpha: float, mu: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        a = np.minimum(mu / (alpha * np.sqrt((1 - mu) * (1 + mu))), 30.0)  # exp(-900) masks nothing
    return np.exp(-(a**2)) * (1 / (2 * a * np.sqrt(np.pi)) - erfcx(a) / 2)


SLOPES = {"ggx": (integral.ggx_slopes, _ggx_lambda), "beckmann": (integral.gauss_slopes, _beckmann_lambda)}


def _cosine(v: Vector) -> float:
    return min(1.0, float(v[2]))


@functools.lru_cache(maxsize=100_000)
def single_albedo(name: str, smith: str, alpha: float, mu: float, eta: float | None = None) -> float:
    """E(μ) of one scattering, F = 1 or a dielectric's."""
    slopes, masking = SLOPES[name]
    lambda_i = masking(alpha, np.asarray(mu))

    def share(cos_d: np.ndarray, mu_o: np.ndarray) -> np.ndarray:
        g = microfacet.smith_g(smith, lambda_i, masking(alpha, mu_o))
        return g if eta is None else g * _dielectric(cos_d, eta)

    return integral.albedo(slopes, alpha, mu, share)


@functools.lru_cache(maxsize=1000)
def average_albedo(name: str, smith: str, alpha: float) -> float:
    return integral.average(lambda mu: single_albedo(name, smith, alpha, mu))


def _dielectric(cos_d: np.ndarray, eta: float) -> np.ndarray:
    cos_t = np.sqrt(1 - (1 - cos_d) * (1 + cos_d) / eta**2)
    r_s = (cos_d - eta * cos_t) / (cos_d + eta * cos_t)
    r_p = (eta * cos_d - cos_t) / (eta * cos_d + cos_t)
    return (r_s**2 + r_p**2) / 2


def compensated(name: str, single: Callable[[Params, Options, Pair], mpf]) -> TextbookForm:
    """A microfacet model with its option `energy`: single, kulla_conty or turquin.

    Kulla & Conty 2017 add (1 − E(μi))(1 − E(μo))/(π(1 − E_avg)) F_avg² E_avg/(1 − F_avg(1 − E_avg)). Turquin 2019
    scales by 1 + F0 (1 − E)/E, with E taken at the incidence wi, so that F = 1 has albedo 1 there, and F0 at normal
    incidence.
    """

    def formula(params: Params, options: Options, pair: Pair) -> mpf:
        f, energy = single(params, options, pair), options.get("energy", "single")
        if energy == "single":
            return f
        smith, alpha = options.get("smith", "correlated"), float(params["alpha"])
        if smith not in ("correlated", "separable"):
            raise ValueError(f"energy = {energy} is defined for correlated and separable masking, not for {smith}")
        e_i, e_o = (single_albedo(name, smith, alpha, _cosine(w)) for w in (pair.wi, pair.wo))
        if energy == "turquin":
            return f * (1 + fresnel.fresnel(mpf(1), params) * (1 - e_i) / e_i)
        e_avg, f_avg = average_albedo(name, smith, alpha), fresnel.average(params)
        again = f_avg**2 * e_avg / (1 - f_avg * (1 - e_avg))
        return f + again * (1 - e_i) * (1 - e_o) / (mp.pi * (1 - e_avg))

    return TextbookForm(formula)


ggx = compensated("ggx", microfacet.ggx_single)
beckmann = compensated("beckmann", microfacet.beckmann_single)


def _refracted(v: Vector, eta: mpf) -> Vector:
    """The direction inside: Snell's law at the mean plane, the same azimuth."""
    x, y = v[0] / eta, v[1] / eta
    return x, y, mp.sqrt(1 - x**2 - y**2)


@TextbookForm
def coat(params: Params, options: Options, pair: Pair, base: Callable[[Vector, Vector], mpf]) -> mpf:
    """Coat + T(μi) T(μo) f_base(i', o')/η², T = 1 − E_coat(μ), i' and o' refracted at the mean plane.

    The coat is GGX, height-correlated, with the dielectric's exact Fresnel. `base` is a function of the directions
    inside.
    """
    alpha, eta = params["alpha"], params["eta"]
    lobe = microfacet.ggx_single({"alpha": alpha, "eta": eta}, {}, pair)
    t_i, t_o = (
        1 - single_albedo("ggx", "correlated", float(alpha), _cosine(w), float(eta)) for w in (pair.wi, pair.wo)
    )
    return lobe + t_i * t_o * base(_refracted(pair.wi, eta), _refracted(pair.wo, eta)) / eta**2


@functools.lru_cache(maxsize=100_000)
def _kelemen_albedo(alpha: float, f0: float, mu: float) -> float:
    """E of F D/|H|², which is F D G/(4 μi μo) with G = μi μo/cos²θd."""

    def share(cos_d: np.ndarray, mu_o: np.ndarray) -> np.ndarray:
        return (f0 + (1 - f0) * (1 - cos_d) ** 5) * mu * mu_o / cos_d**2

    return integral.albedo(integral.gauss_slopes, alpha, mu, share)


@functools.lru_cache(maxsize=1000)
def _kelemen_average(alpha: float, f0: float) -> float:
    return integral.average(lambda mu: _kelemen_albedo(alpha, f0, mu))


@TextbookForm
def kelemen(params: Params, options: Options, pair: Pair) -> mpf:
    """F D/|H|² + ρ (1 − E(μi))(1 − E(μo))/(π(1 − E_avg)), H = i + o [Kelemen & Szirmay-Kalos 2001].

    D is Beckmann's, normalised; |H|² = 2(1 + i·o), so at normal incidence the lobe is F D/4.
    """
    alpha, f0 = float(params["alpha"]), float(params["f0"])
    lobe = fresnel.schlick1994(pair.cos_d, params["f0"]) * microfacet.beckmann_d(params, pair.half) / pair.sum2
    e_i, e_o = (_kelemen_albedo(alpha, f0, _cosine(w)) for w in (pair.wi, pair.wo))
    return lobe + params["rho"] * (1 - e_i) * (1 - e_o) / (mp.pi * (1 - _kelemen_average(alpha, f0)))


DISNEY = {  # what Burley's program starts with
    "metallic": "0", "roughness": "0.5", "specular": "0.5", "specular_tint": "0", "anisotropic": "0", "sheen": "0",
    "sheen_tint": "0.5", "clearcoat": "0", "clearcoat_gloss": "1", "subsurface": "0",
}  # fmt: skip
LEAST_WIDTH = "0.001"


def _mix(a: mpf, b: mpf, share: mpf) -> mpf:
    return a * (1 - share) + b * share


def _disney_matte(p: Params, color: mpf, tint: mpf, pair: Pair) -> mpf:
    schlick_i, schlick_o, schlick_d = ((1 - c) ** 5 for c in (pair.mu_i, pair.mu_o, pair.cos_d))
    one, half = mpf(1), mpf(1) / 2
    f_d90, f_ss90 = half + 2 * pair.cos_d**2 * p["roughness"], pair.cos_d**2 * p["roughness"]
    f_d = _mix(one, f_d90, schlick_i) * _mix(one, f_d90, schlick_o)
    f_ss = _mix(one, f_ss90, schlick_i) * _mix(one, f_ss90, schlick_o)
    flat = mpf(5) / 4 * (f_ss * (1 / (pair.mu_i + pair.mu_o) - half) + half)
    sheen = schlick_d * p["sheen"] * _mix(one, tint, p["sheen_tint"])
    return (_mix(f_d, flat, p["subsurface"]) * color / mp.pi + sheen) * (1 - p["metallic"])


def _disney_specular(p: Params, color: mpf, tint: mpf, pair: Pair, mitsuba: bool) -> mpf:
    aspect = mp.sqrt(1 - mpf("0.9") * p["anisotropic"])
    rough2 = p["roughness"] ** 2
    least = mpf(LEAST_WIDTH)
    widths = {"alpha_x": max(least, rough2 / aspect), "alpha_y": max(least, rough2 * aspect)}
    f0 = p["specular"] * mpf("0.08")
    plain, tinted, metal = (fresnel.schlick1994(pair.cos_d, c) for c in (f0, f0 * tint, color))
    if mitsuba:
        root = mp.sqrt(f0)
        plain = fresnel.exact(pair.cos_d, (1 + root) / (1 - root))
    reflected = _mix(_mix(plain, tinted, p["specular_tint"]), metal, p["metallic"])
    return reflected * _separable(widths, pair) * microfacet.ggx_d(widths, pair.half) / (4 * pair.mu_i * pair.mu_o)


def _disney_clearcoat(p: Params, pair: Pair, mitsuba: bool) -> mpf:
    gloss = {"alpha": _mix(mpf("0.1"), mpf(LEAST_WIDTH), p["clearcoat_gloss"]), "gamma": mpf(1)}
    # the program's G for the coat is (1/(μ + √(a² + μ² − a²μ²)))² = G1/(2μ) for each direction
    lobe = microfacet.gtr_d(gloss, pair.half) * _separable({"alpha": mpf(1) / 4}, pair)
    lobe *= p["clearcoat"] / 4 * fresnel.schlick1994(pair.cos_d, mpf("0.04"))
    return lobe if mitsuba else lobe / (4 * pair.mu_i * pair.mu_o)


def _separable(widths: Params, pair: Pair) -> mpf:
    return microfacet.smith_g("separable", *(microfacet.ggx_lambda(widths, w) for w in (pair.wi, pair.wo)))


@TextbookForm
def principled(params: Params, options: Options, pair: Pair) -> mpf:
    """Disney's model of 2012 by Burley's notes and program, without its power 2.2: base_color is linear.

    Tints divide the colour by its luminance 0.3 R + 0.6 G + 0.1 B: the parameter `luminance`, or else the one channel's
    own value, for which both tints are 1. The masking is that of the program (a = roughness², not the notes' remapped
    one). variant = mitsuba: the untinted dielectric part by the exact formula, at the index of the same reflectance
    at normal incidence; and a clearcoat without 1/(4 μi μo) [Mitsuba 3, principled].
    """
    mitsuba = options.get("variant", "disney") == "mitsuba"
    p = {name: params.get(name, mpf(default)) for name, default in DISNEY.items()}
    color = params["base_color"]
    luminance = params.get("luminance", color)
    tint = color / luminance if luminance > 0 else mpf(1)
    specular = _disney_specular(p, color, tint, pair, mitsuba)
    return _disney_matte(p, color, tint, pair) + specular + _disney_clearcoat(p, pair, mitsuba)
