"""Textbook form of the physical-optics model of He, Torrance, Sillion & Greenberg 1991."""

import math
from collections.abc import Callable

from gonio.stability.textbook.frame import Options, Pair, Params, TextbookForm, mp, mpf
from gonio.stability.textbook.fresnel import fresnel

WIDE = 20  # standard deviations of m beyond which the sum over m is sampled, not added term by term


def shadowing(form: str, slope: mpf, angle: mpf) -> mpf:
    """S(θ) = (1 − ½ erfc(s))/(1 + Λ), s = τ cot θ/(2σ) [eq. 23 to 25].

    Λ = exp(−s²)/(2√π s) − erfc(s)/2; the printed paper, "1991", lacks the exponential.
    """
    if angle == 0:
        return mpf(1)
    s = mp.cot(angle) / slope
    missing = mp.erfc(s) / 2
    gauss = 1 if form == "1991" else mp.exp(-(s**2))
    return (1 - missing) / (1 + gauss / (2 * mp.sqrt(mp.pi) * s) - missing)


def _apparent_roughness(sigma: mpf, slope: mpf, angles: tuple[mpf, mpf]) -> mpf:
    """σ0/√(1 + x²), x exp(x²/2) = (Ki + Ko)/√(8π), K = tan θ erfc(τ cot θ/(2σ)) [eq. 80 to 83].

    The equation's solution is x² = W((Ki + Ko)²/(8π)), W Lambert's function.
    """
    k = mp.fsum(mp.tan(angle) * mp.erfc(mp.cot(angle) / slope) for angle in angles if angle > 0)
    return sigma / mp.sqrt(1 + mp.lambertw(k**2 / (8 * mp.pi)).real)


def sum_by_terms(g: mpf, c: mpf) -> mpf:
    """The sum of eq. 78 term by term."""
    total, power, m = mpf(0), mp.exp(-g), 1
    last = mpf(0)
    while True:
        power *= g / m
        term = power / m * mp.exp(-c / m)
        total += term
        if term <= last and term < mp.eps * total:
            return total
        last, m = term, m + 1


def interference_sum(g: mpf, c: mpf) -> mpf:
    """Σ_{m ≥ 1} gᵐ e^(−g)/(m! m) exp(−c/m), the sum of eq. 78 to all digits.

    Its terms are a smooth bump over m; where that is wide, a sum over every few m with Γ(m + 1) for m! has the same
    value to all digits (Poisson's summation formula).
    """
    if g == 0:
        return mpf(0)
    g64, c64 = float(g), float(c)
    peak = _bracketed_root(lambda m: math.log(g64 / m) + c64 / m**2)  # of the terms' logarithmic slope
    width = 1 / math.sqrt(1 / peak + 2 * c64 / peak**3)
    if width < WIDE:
        return sum_by_terms(g, c)
    log_g, step = mp.log(g), mpf(width) / 3

    def term(m: mpf) -> mpf:
        return mp.exp(m * log_g - g - c / m - mp.loggamma(m + 1)) / m

    total = term(mpf(peak))
    for side in (step, -step):
        m = mpf(peak) + side
        while m > 0:
            value = term(m)
            total += value
            if value < mp.eps * total:
                break
            m += side
    return total * step


def _bracketed_root(falling: Callable[[float], float]) -> float:
    low, high = 1.0, 2.0
    while falling(high) > 0:
        low, high = high, 2 * high
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if falling(middle) > 0 else (low, middle)
    return low


@TextbookForm
def he_torrance(params: Params, options: Options, pair: Pair) -> mpf:
    """F G S D/(π μi μo), the directional-diffuse part for unpolarised light [He et al. 1991, eq. 71 to 84].

    D = π² τ²/(4 λ²) Σ gᵐ e^(−g)/(m! m) exp(−v² τ²/(4m)), g = (2π σ (μi + μo)/λ)² with the apparent roughness σ, summed
    without end. v is |ip + op| for "1991" and "errata"; "westin" takes (2π/λ)|ip + op|, as Westin's program does.
    "errata" and "westin" have the exponential in Λ that "1991" lacks. G = (|H|²/H_z)², H = i + o: what eq. 76 is for
    unit vectors, also at normal incidence and at retroreflection, where the equation itself reads 0/0.
    """
    sigma, tau, wavelength = params["sigma"], params["tau"], params["wavelength"]
    if sigma == 0:
        return mpf(0)
    form = options.get("form", "westin")
    angles, slope = (pair.theta_i, pair.theta_o), 2 * sigma / tau
    apparent = _apparent_roughness(sigma, slope, angles)
    g = (2 * mp.pi * apparent * (pair.mu_i + pair.mu_o) / wavelength) ** 2
    c = pair.projected_distance2 * tau**2 / 4
    if form == "westin":
        c *= (2 * mp.pi / wavelength) ** 2
    d = (mp.pi * tau / (2 * wavelength)) ** 2 * interference_sum(g, c)
    geometry = (pair.sum2 / pair.sum[2]) ** 2
    visible = shadowing(form, slope, angles[0]) * shadowing(form, slope, angles[1])
    return fresnel(pair.cos_d, params) * geometry * visible * d / (mp.pi * pair.mu_i * pair.mu_o)
