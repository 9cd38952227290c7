"""Textbook forms of models that count several reflections: energy compensation, coats, coupled matte layers, Disney's.

Their albedos are integrals of this package, in double precision (see albedo.py); all else has the caller's digits.
"""

import functools

import numpy as np
from mpmath import mp, mpf
from scipy.special import erfcx

from gonio.stability.textbook import albedo as integral
from gonio.stability.textbook import fresnel, microfacet
from gonio.stability.textbook.frame import above_horizon, half_vector, theta_d


def _ggx_lambda(alpha, mu):
    return (np.sqrt(1 + alpha**2 * (1 - mu) * (1 + mu) / mu**2) - 1) / 2


def _beckmann_lambda(alpha, mu):
    with np.errstate(divide="ignore"):
        a = np.minimum(mu / (alpha * np.sqrt((1 - mu) * (1 + mu))), 30.0)  # exp(-900) masks nothing
    return np.exp(-(a**2)) * (1 / (2 * a * np.sqrt(np.pi)) - erfcx(a) / 2)


SLOPES = {"ggx": (integral.ggx_slopes, _ggx_lambda), "beckmann": (integral.gauss_slopes, _beckmann_lambda)}


@functools.lru_cache(maxsize=100_000)
def single_albedo(name, smith, alpha, mu, eta=None):
    """E(μ) of one scattering, F = 1 or a dielectric's; numbers are Python floats."""
    slopes, masking = SLOPES[name]
    lambda_i = masking(alpha, mu)

    def share(cos_d, mu_o):
        g = microfacet.smith_g(smith, lambda_i, masking(alpha, mu_o))
        return g if eta is None else g * _dielectric(cos_d, eta)

    return integral.albedo(slopes, alpha, mu, share)


@functools.lru_cache(maxsize=1000)
def average_albedo(name, smith, alpha):
    return integral.average(lambda mu: single_albedo(name, smith, alpha, float(mu)))


def _dielectric(cos_d, eta):
    cos_t = np.sqrt(1 - (1 - cos_d) * (1 + cos_d) / eta**2)
    r_s = (cos_d - eta * cos_t) / (cos_d + eta * cos_t)
    r_p = (eta * cos_d - cos_t) / (eta * cos_d + cos_t)
    return (r_s**2 + r_p**2) / 2


def compensated(name, single):
    """A microfacet model with its option `energy`: single, kulla_conty or turquin.

    Kulla & Conty 2017 add (1 − E(μi))(1 − E(μo))/(π(1 − E_avg)) F_avg² E_avg/(1 − F_avg(1 − E_avg)). Turquin 2019
    scales by 1 + F0 (1 − E)/E, with E taken at the incidence wi, so that F = 1 has albedo 1 there, and F0 at normal
    incidence.
    """

    @above_horizon
    @functools.wraps(single.__wrapped__)
    def evaluate(params, options, wi, wo):
        f, energy = single(params, options, wi, wo), options.get("energy", "single")
        if energy == "single":
            return f
        smith, alpha = options.get("smith", "correlated"), float(params["alpha"])
        if smith not in ("correlated", "separable"):
            raise ValueError(f"energy = {energy} is defined for correlated and separable masking, not for {smith}")
        e_i = single_albedo(name, smith, alpha, min(1.0, float(wi[2])))
        if energy == "turquin":
            return f * (1 + fresnel.fresnel(mpf(1), params) * (1 - e_i) / e_i)
        e_o = single_albedo(name, smith, alpha, min(1.0, float(wo[2])))
        e_avg, f_avg = average_albedo(name, smith, alpha), fresnel.average(params)
        again = f_avg**2 * e_avg / (1 - f_avg * (1 - e_avg))
        return f + again * (1 - e_i) * (1 - e_o) / (mp.pi * (1 - e_avg))

    return evaluate


ggx = compensated("ggx", microfacet.ggx_single)
beckmann = compensated("beckmann", microfacet.beckmann_single)


def _refracted(v, eta):
    """The direction inside: Snell's law at the mean plane, the same azimuth."""
    x, y = v[0] / eta, v[1] / eta
    return x, y, mp.sqrt(1 - x**2 - y**2)


@above_horizon
def coat(params, options, wi, wo, base):
    """Coat + T(μi) T(μo) f_base(i', o')/η², T = 1 − E_coat(μ), i' and o' refracted at the mean plane.

    The coat is GGX, height-correlated, with the dielectric's exact Fresnel. `base` is a function of the directions
    inside.
    """
    alpha, eta = float(params["alpha"]), float(params["eta"])
    lobe = microfacet.ggx_single({"alpha": params["alpha"], "eta": params["eta"]}, {}, wi, wo)
    t_i = 1 - single_albedo("ggx", "correlated", alpha, min(1.0, float(wi[2])), eta)
    t_o = 1 - single_albedo("ggx", "correlated", alpha, min(1.0, float(wo[2])), eta)
    return lobe + t_i * t_o * base(_refracted(wi, params["eta"]), _refracted(wo, params["eta"])) / params["eta"] ** 2


@functools.lru_cache(maxsize=100_000)
def _kelemen_albedo(alpha, f0, mu):
    """E of F D/|H|², which is F D G/(4 μi μo) with G = μi μo/cos²θd."""

    def share(cos_d, mu_o):
        return (f0 + (1 - f0) * (1 - cos_d) ** 5) * mu * mu_o / cos_d**2

    return integral.albedo(integral.gauss_slopes, alpha, mu, share)


@functools.lru_cache(maxsize=1000)
def _kelemen_average(alpha, f0):
    return integral.average(lambda mu: _kelemen_albedo(alpha, f0, float(mu)))


@above_horizon
def kelemen(params, options, wi, wo):
    """F D/|H|² + ρ (1 − E(μi))(1 − E(μo))/(π(1 − E_avg)), H = i + o [Kelemen & Szirmay-Kalos 2001].

    D is Beckmann's, normalised; |H|² = 2(1 + i·o), so at normal incidence the lobe is F D/4.
    """
    alpha, f0 = float(params["alpha"]), float(params["f0"])
    h2 = sum((i + o) ** 2 for i, o in zip(wi, wo, strict=True))
    f = fresnel.schlick1994(mp.cos(theta_d(wi, wo)), params["f0"])
    lobe = f * microfacet.beckmann_d(params, half_vector(wi, wo)) / h2
    e_i, e_o = (_kelemen_albedo(alpha, f0, min(1.0, float(w[2]))) for w in (wi, wo))
    return lobe + params["rho"] * (1 - e_i) * (1 - e_o) / (mp.pi * (1 - _kelemen_average(alpha, f0)))


DISNEY = {  # what Burley's program starts with
    "metallic": "0",
    "roughness": "0.5",
    "specular": "0.5",
    "specular_tint": "0",
    "anisotropic": "0",
    "sheen": "0",
    "sheen_tint": "0.5",
    "clearcoat": "0",
    "clearcoat_gloss": "1",
    "subsurface": "0",
}


def _mix(a, b, share):
    return a * (1 - share) + b * share


@above_horizon
def principled(params, options, wi, wo):
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
    mu_i, mu_o, cos_d = wi[2], wo[2], mp.cos(theta_d(wi, wo))
    h = half_vector(wi, wo)
    schlick_i, schlick_o, schlick_d = ((1 - c) ** 5 for c in (mu_i, mu_o, cos_d))

    f_d90 = mpf(1) / 2 + 2 * cos_d**2 * p["roughness"]
    f_d = _mix(1, f_d90, schlick_i) * _mix(1, f_d90, schlick_o)
    f_ss90 = cos_d**2 * p["roughness"]
    f_ss = _mix(1, f_ss90, schlick_i) * _mix(1, f_ss90, schlick_o)
    flat = mpf(5) / 4 * (f_ss * (1 / (mu_i + mu_o) - mpf(1) / 2) + mpf(1) / 2)
    sheen = schlick_d * p["sheen"] * _mix(1, tint, p["sheen_tint"])
    matte = (_mix(f_d, flat, p["subsurface"]) * color / mp.pi + sheen) * (1 - p["metallic"])

    aspect = mp.sqrt(1 - mpf("0.9") * p["anisotropic"])
    least = mpf("0.001")
    widths = {
        "alpha_x": max(least, p["roughness"] ** 2 / aspect),
        "alpha_y": max(least, p["roughness"] ** 2 * aspect),
    }
    f0 = p["specular"] * mpf("0.08")
    plain, tinted, metal = (_mix(c, 1, schlick_d) for c in (f0, f0 * tint, color))
    if mitsuba:
        root = mp.sqrt(f0)
        plain = fresnel.exact(cos_d, (1 + root) / (1 - root))
    reflected = _mix(_mix(plain, tinted, p["specular_tint"]), metal, p["metallic"])
    g = microfacet.smith_g("separable", *(microfacet.ggx_lambda(widths, w) for w in (wi, wo)))
    specular = reflected * microfacet.ggx_d(widths, h) * g / (4 * mu_i * mu_o)

    gloss = {"alpha": _mix(mpf("0.1"), least, p["clearcoat_gloss"]), "gamma": mpf(1)}
    quarter = {"alpha": mpf(1) / 4}
    # the program's G for the coat is (1/(μ + √(a² + μ² − a²μ²)))² = G1/(2μ) for each direction
    g = microfacet.smith_g("separable", *(microfacet.ggx_lambda(quarter, w) for w in (wi, wo)))
    coat_lobe = _mix(mpf("0.04"), 1, schlick_d) * microfacet.gtr_d(gloss, h) * g
    if not mitsuba:
        coat_lobe /= 4 * mu_i * mu_o
    return matte + specular + p["clearcoat"] / 4 * coat_lobe
