"""Textbook forms of the microfacet models F D G/(4 μi μo) and their relatives."""

from collections.abc import Callable
from typing import Any

from gonio.stability.textbook.frame import Options, Pair, Params, TextbookForm, Vector, mirror, mp, mpf, phi, theta
from gonio.stability.textbook.fresnel import fresnel, schlick1994


def widths(params: Params, name: str = "alpha") -> tuple[mpf, mpf]:
    """(αx, αy), or another parameter along x and y."""
    if name in params:
        return params[name], params[name]
    return params[f"{name}_x"], params[f"{name}_y"]


def scaled_tan2(params: Params, h: Vector) -> mpf:
    """tan²θh (cos²φh/αx² + sin²φh/αy²)."""
    alpha_x, alpha_y = widths(params)
    azimuth = phi(h)
    return mp.tan(theta(h)) ** 2 * ((mp.cos(azimuth) / alpha_x) ** 2 + (mp.sin(azimuth) / alpha_y) ** 2)


def cot_over_alpha(params: Params, v: Vector) -> mpf:
    """a = cot θ/α(φ), α(φ)² = αx² cos²φ + αy² sin²φ; infinite for the normal."""
    alpha_x, alpha_y = widths(params)
    azimuth = phi(v)
    tangent = mp.tan(theta(v))
    if tangent == 0:
        return mp.inf
    return 1 / (tangent * mp.sqrt((alpha_x * mp.cos(azimuth)) ** 2 + (alpha_y * mp.sin(azimuth)) ** 2))


def _slope_density(profile: Callable[[Params, mpf], mpf]) -> Callable[[Params, Vector], mpf]:
    # D = profile(tan²θ(cos²φ/αx² + sin²φ/αy²))/(π αx αy cos⁴θ).
    def density(params: Params, h: Vector) -> mpf:
        alpha_x, alpha_y = widths(params)
        return profile(params, scaled_tan2(params, h)) / (mp.pi * alpha_x * alpha_y * mp.cos(theta(h)) ** 4)

    return density


ggx_d = _slope_density(lambda params, t: 1 / (1 + t) ** 2)
"""1/(π αx αy cos⁴θ (1 + tan²θ(cos²φ/αx² + sin²φ/αy²))²) [Walter 2007, eq. 33; Heitz 2014, eq. 85]."""

beckmann_d = _slope_density(lambda params, t: mp.exp(-t))
"""exp(−tan²θ(cos²φ/αx² + sin²φ/αy²))/(π αx αy cos⁴θ) [Walter 2007, eq. 25]."""

std_d = _slope_density(lambda params, t: (1 + t / (params["gamma"] - 1)) ** (-params["gamma"]))
"""Student's t of slopes: (1 + tan²θ(...)/(γ − 1))^(−γ)/(π αx αy cos⁴θ) [Ribardière et al. 2017]."""


def ggx_lambda(params: Params, v: Vector) -> mpf:
    """(√(1 + 1/a²) − 1)/2 [Heitz 2014, eq. 72]."""
    return (mp.sqrt(1 + 1 / cot_over_alpha(params, v) ** 2) - 1) / 2


def beckmann_lambda(params: Params, v: Vector) -> mpf:
    """exp(−a²)/(2a√π) − erfc(a)/2 [Heitz 2014, eq. 66]."""
    a = cot_over_alpha(params, v)
    return mpf(0) if a == mp.inf else mp.exp(-(a**2)) / (2 * a * mp.sqrt(mp.pi)) - mp.erfc(a) / 2


def beckmann_g1_walter2007(params: Params, v: Vector) -> mpf:
    """(3.535 a + 2.181 a²)/(1 + 2.276 a + 2.577 a²) for a < 1.6, else 1 [Walter 2007, eq. 27]."""
    a = cot_over_alpha(params, v)
    if a >= mpf("1.6"):
        return mpf(1)
    numerator = mpf("3.535") * a + mpf("2.181") * a**2
    return numerator / (1 + mpf("2.276") * a + mpf("2.577") * a**2)


def std_lambda(params: Params, v: Vector) -> mpf:
    """(1/a) ∫_a^∞ (s − a) P(s) ds with the marginal P ∝ (1 + s²/(γ − 1))^(½ − γ), Student's t of 2γ − 2 degrees.

    ∫ s P ds is elementary, ∫ P ds the tail of Student's t, an incomplete beta function.
    """
    a, gamma = cot_over_alpha(params, v), params["gamma"]
    if a == mp.inf:
        return mpf(0)
    q = 1 + a**2 / (gamma - 1)
    norm = mp.gammaprod([gamma - mpf(1) / 2], [gamma]) * mp.sqrt((gamma - 1) / mp.pi)
    moment = norm * (gamma - 1) / (2 * gamma - 3) * q ** (mpf(3) / 2 - gamma)
    tail = mp.betainc(gamma - 1, mpf(1) / 2, 0, 1 / q, regularized=True) / 2
    return moment / a - tail


def gtr_d(params: Params, h: Vector) -> mpf:
    """Generalised Trowbridge-Reitz, c/(1 + (α² − 1) cos²θ)^γ normalised [Burley 2012, eq. 4 and appendix B]."""
    gamma, t = params["gamma"], params["alpha"] ** 2 - 1
    if t == 0:
        return 1 / mp.pi
    scale = t / mp.log(1 + t) if gamma == 1 else (gamma - 1) * t / (1 - (1 + t) ** (1 - gamma))
    return scale / mp.pi / (1 + t * mp.cos(theta(h)) ** 2) ** gamma


def smith_g(smith: str, lambda_i: Any, lambda_o: Any) -> Any:
    """Smith's masking and shadowing, height-correlated, separable or none, of numbers or arrays Λ."""
    if smith == "none":
        return mpf(1)
    if smith == "separable":
        return 1 / ((1 + lambda_i) * (1 + lambda_o))
    return 1 / (1 + lambda_i + lambda_o)


def v_cavity(pair: Pair) -> mpf:
    """min(1, 2 cos θh μi/cos θd, 2 cos θh μo/cos θd) [Torrance & Sparrow 1967]."""
    return min(mpf(1), 2 * pair.cos_h * min(pair.mu_i, pair.mu_o) / pair.cos_d)


def reflected(d: mpf, g: mpf, params: Params, pair: Pair) -> mpf:
    """F D G/(4 μi μo)."""
    return fresnel(pair.cos_d, params) * d * g / (4 * pair.mu_i * pair.mu_o)


def smith_lobe(
    density: Callable[[Params, Vector], mpf], masking: Callable[[Params, Vector], mpf]
) -> Callable[[Params, Options, Pair], mpf]:
    """The formula of a distribution of normals with its own Smith masking."""

    def formula(params: Params, options: Options, pair: Pair) -> mpf:
        g = smith_g(options.get("smith", "correlated"), masking(params, pair.wi), masking(params, pair.wo))
        return reflected(density(params, pair.half), g, params, pair)

    return formula


ggx_single = smith_lobe(ggx_d, ggx_lambda)
"""GGX, scattering once [Walter 2007, Heitz 2014]."""

_beckmann_smith = smith_lobe(beckmann_d, beckmann_lambda)


def beckmann_single(params: Params, options: Options, pair: Pair) -> mpf:
    """Beckmann, scattering once; smith = walter takes the rational fit of G1, separably."""
    if options.get("smith") == "walter":
        g = beckmann_g1_walter2007(params, pair.wi) * beckmann_g1_walter2007(params, pair.wo)
        return reflected(beckmann_d(params, pair.half), g, params, pair)
    return _beckmann_smith(params, options, pair)


std = TextbookForm(smith_lobe(std_d, std_lambda))
"""Student's t-distribution of slopes [Ribardière et al. 2017] with the masking of its own marginal."""

gtr = TextbookForm(smith_lobe(gtr_d, ggx_lambda))
"""Generalised Trowbridge-Reitz [Burley 2012] with GGX masking of the same α, height-correlated by default."""


@TextbookForm
def retro(params: Params, options: Options, pair: Pair) -> mpf:
    """GGX about the back vector: wi is mirrored in the normal first [Belcour et al. 2014], for Fresnel's angle too."""
    return ggx_single(params, options, Pair(mirror(pair.wi), pair.wo))


@TextbookForm
def cook_torrance(params: Params, options: Options, pair: Pair) -> mpf:
    """F D G/(4 μi μo), Beckmann's D, V-cavities [Cook & Torrance 1982 with the factor corrected]."""
    return reflected(beckmann_d(params, pair.half), v_cavity(pair), params, pair)


@TextbookForm
def cook_torrance_1982(params: Params, options: Options, pair: Pair) -> mpf:
    """F (π D) G/(π μi μo), as often read from Cook & Torrance 1982: four times cook_torrance."""
    return 4 * cook_torrance.formula(params, options, pair)


@TextbookForm
def abc_microfacet(params: Params, options: Options, pair: Pair) -> mpf:
    """F S G/(μi μo), S = (1 + b(1 − cos θh))^(−c), V-cavities [Löw et al. 2012, eq. 15]."""
    s = (1 + params["b"] * (1 - pair.cos_h)) ** (-params["c"])
    return 4 * reflected(s, v_cavity(pair), params, pair)


def _sgd_g1(params: Params, v: Vector) -> mpf:
    beyond = theta(v) - params["theta_0"]
    return 1 + params["lam"] * (1 - mp.exp(params["c"] * beyond ** params["k"])) if beyond > 0 else mpf(1)


@TextbookForm
def sgd(params: Params, options: Options, pair: Pair) -> mpf:
    """Shifted gamma distribution, (1/π) F D G1(i) G1(o)/(μi μo) [Bagher, Soler & Holzschuch 2012].

    D = κ exp(−t)/(π cos⁴θh t^p), t = α + tan²θh/α; F = f0 + (1 − f0)(1 − cos θd)⁵ − f1 cos θd; G1 is 1 up to θ0.
    """
    t = params["alpha"] + mp.tan(pair.theta_h) ** 2 / params["alpha"]
    d = params["kappa"] * mp.exp(-t) / t ** params["p"] / (mp.pi * pair.cos_h**4)
    f = schlick1994(pair.cos_d, params["f0"]) - params["f1"] * pair.cos_d
    return f * d * _sgd_g1(params, pair.wi) * _sgd_g1(params, pair.wo) / (mp.pi * pair.mu_i * pair.mu_o)


CHARLIE = (  # the fit's numbers a to e at roughness 0 and 1
    ("25.3245", "21.5473"),
    ("3.32435", "3.82987"),
    ("0.16801", "0.19823"),
    ("-1.27393", "-1.97760"),
    ("-4.85967", "-4.32054"),
)


def _charlie_lambda(alpha: mpf, mu: mpf) -> mpf:
    """exp L(μ) for μ < ½, exp(2 L(½) − L(1 − μ)) above, L(x) = a/(1 + b x^c) + d x + e."""
    weight = (1 - alpha) ** 2
    a, b, c, d, e = (weight * mpf(first) + (1 - weight) * mpf(last) for first, last in CHARLIE)

    def exponent(x: mpf) -> mpf:
        return a / (1 + b * x**c) + d * x + e

    if mu < mpf(1) / 2:
        return mp.exp(exponent(mu))
    return mp.exp(2 * exponent(mpf(1) / 2) - exponent(1 - mu))


@TextbookForm
def charlie(params: Params, options: Options, pair: Pair) -> mpf:
    """D G/(4 μi μo), D = (2 + 1/α) sin^(1/α) θh/(2π), F = 1 [Estevez & Kulla 2017].

    α is the paper's roughness itself (not its square, as in some renderers); the paper's softening of the terminator,
    which breaks reciprocity, is left out. visibility = ashikhmin: 1/(4(μi + μo − μi μo)) [Ashikhmin & Premože 2007].
    """
    alpha, mu_i, mu_o = params["alpha"], pair.mu_i, pair.mu_o
    d = (2 + 1 / alpha) * mp.sin(pair.theta_h) ** (1 / alpha) / (2 * mp.pi)
    if options.get("visibility", "fitted") == "ashikhmin":
        return d / (4 * (mu_i + mu_o - mu_i * mu_o))
    return d / ((1 + _charlie_lambda(alpha, mu_i) + _charlie_lambda(alpha, mu_o)) * 4 * mu_i * mu_o)
