"""Textbook forms of the microfacet models F D G/(4 μi μo) and their relatives."""

from mpmath import mp, mpf

from gonio.stability.textbook.frame import above_horizon, half_vector, mirror, phi, theta, theta_d
from gonio.stability.textbook.fresnel import fresnel, schlick1994


def widths(params):
    """(αx, αy)."""
    if "alpha" in params:
        return params["alpha"], params["alpha"]
    return params["alpha_x"], params["alpha_y"]


def scaled_tan2(params, h):
    """tan²θh (cos²φh/αx² + sin²φh/αy²)."""
    alpha_x, alpha_y = widths(params)
    azimuth = phi(h)
    return mp.tan(theta(h)) ** 2 * ((mp.cos(azimuth) / alpha_x) ** 2 + (mp.sin(azimuth) / alpha_y) ** 2)


def cot_over_alpha(params, v):
    """a = cot θ/α(φ), α(φ)² = αx² cos²φ + αy² sin²φ; infinite for the normal."""
    alpha_x, alpha_y = widths(params)
    azimuth = phi(v)
    tangent = mp.tan(theta(v))
    if tangent == 0:
        return mp.inf
    return 1 / (tangent * mp.sqrt((alpha_x * mp.cos(azimuth)) ** 2 + (alpha_y * mp.sin(azimuth)) ** 2))


def ggx_d(params, h):
    """1/(π αx αy cos⁴θ (1 + tan²θ(cos²φ/αx² + sin²φ/αy²))²) [Walter 2007, eq. 33; Heitz 2014, eq. 85]."""
    alpha_x, alpha_y = widths(params)
    return 1 / (mp.pi * alpha_x * alpha_y * mp.cos(theta(h)) ** 4 * (1 + scaled_tan2(params, h)) ** 2)


def ggx_lambda(params, v):
    """(√(1 + 1/a²) − 1)/2 [Heitz 2014, eq. 72]."""
    a = cot_over_alpha(params, v)
    return mpf(0) if a == mp.inf else (mp.sqrt(1 + 1 / a**2) - 1) / 2


def beckmann_d(params, h):
    """exp(−tan²θ(cos²φ/αx² + sin²φ/αy²))/(π αx αy cos⁴θ) [Walter 2007, eq. 25]."""
    alpha_x, alpha_y = widths(params)
    return mp.exp(-scaled_tan2(params, h)) / (mp.pi * alpha_x * alpha_y * mp.cos(theta(h)) ** 4)


def beckmann_lambda(params, v):
    """exp(−a²)/(2a√π) − erfc(a)/2 [Heitz 2014, eq. 66]."""
    a = cot_over_alpha(params, v)
    return mpf(0) if a == mp.inf else mp.exp(-(a**2)) / (2 * a * mp.sqrt(mp.pi)) - mp.erfc(a) / 2


def beckmann_g1_walter2007(params, v):
    """(3.535 a + 2.181 a²)/(1 + 2.276 a + 2.577 a²) for a < 1.6, else 1 [Walter 2007, eq. 27]."""
    a = cot_over_alpha(params, v)
    if a >= mpf("1.6"):
        return mpf(1)
    numerator = mpf("3.535") * a + mpf("2.181") * a**2
    return numerator / (1 + mpf("2.276") * a + mpf("2.577") * a**2)


def std_d(params, h):
    """Student's t of slopes: (1 + tan²θ(...)/(γ − 1))^(−γ)/(π αx αy cos⁴θ) [Ribardière et al. 2017]."""
    alpha_x, alpha_y = widths(params)
    gamma = params["gamma"]
    profile = (1 + scaled_tan2(params, h) / (gamma - 1)) ** (-gamma)
    return profile / (mp.pi * alpha_x * alpha_y * mp.cos(theta(h)) ** 4)


def std_lambda(params, v):
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


def gtr_d(params, h):
    """Generalised Trowbridge-Reitz, c/(1 + (α² − 1) cos²θ)^γ normalised [Burley 2012, eq. 4 and appendix B]."""
    gamma, t = params["gamma"], params["alpha"] ** 2 - 1
    if t == 0:
        return 1 / mp.pi
    scale = t / mp.log(1 + t) if gamma == 1 else (gamma - 1) * t / (1 - (1 + t) ** (1 - gamma))
    return scale / mp.pi / (1 + t * mp.cos(theta(h)) ** 2) ** gamma


def smith_g(smith, lambda_i, lambda_o):
    """Smith's masking and shadowing: height-correlated, separable or none."""
    if smith == "none":
        return mpf(1)
    if smith == "separable":
        return 1 / ((1 + lambda_i) * (1 + lambda_o))
    return 1 / (1 + lambda_i + lambda_o)


def v_cavity(wi, wo):
    """min(1, 2 cos θh μi/cos θd, 2 cos θh μo/cos θd) [Torrance & Sparrow 1967]."""
    cos_h, cos_d = mp.cos(theta(half_vector(wi, wo))), mp.cos(theta_d(wi, wo))
    return min(mpf(1), 2 * cos_h * wi[2] / cos_d, 2 * cos_h * wo[2] / cos_d)


def reflected(d, g, params, wi, wo):
    """F D G/(4 μi μo)."""
    return fresnel(mp.cos(theta_d(wi, wo)), params) * d * g / (4 * wi[2] * wo[2])


def smith_lobe(density, masking, params, options, wi, wo):
    """The lobe of a distribution of normals with its own Smith masking."""
    g = smith_g(options.get("smith", "correlated"), masking(params, wi), masking(params, wo))
    return reflected(density(params, half_vector(wi, wo)), g, params, wi, wo)


@above_horizon
def ggx_single(params, options, wi, wo):
    """GGX, scattering once [Walter 2007, Heitz 2014]."""
    return smith_lobe(ggx_d, ggx_lambda, params, options, wi, wo)


@above_horizon
def beckmann_single(params, options, wi, wo):
    """Beckmann, scattering once; smith = walter takes the rational fit of G1, separably."""
    if options.get("smith") == "walter":
        g = beckmann_g1_walter2007(params, wi) * beckmann_g1_walter2007(params, wo)
        return reflected(beckmann_d(params, half_vector(wi, wo)), g, params, wi, wo)
    return smith_lobe(beckmann_d, beckmann_lambda, params, options, wi, wo)


@above_horizon
def std(params, options, wi, wo):
    """Student's t-distribution of slopes [Ribardière et al. 2017] with the masking of its own marginal."""
    return smith_lobe(std_d, std_lambda, params, options, wi, wo)


@above_horizon
def gtr(params, options, wi, wo):
    """Generalised Trowbridge-Reitz [Burley 2012] with GGX masking of the same α, height-correlated unless told."""
    return smith_lobe(gtr_d, ggx_lambda, params, options, wi, wo)


@above_horizon
def retro(params, options, wi, wo):
    """GGX about the back vector: wi is mirrored in the normal first [Belcour et al. 2014], for Fresnel's angle too."""
    return smith_lobe(ggx_d, ggx_lambda, params, options, mirror(wi), wo)


@above_horizon
def cook_torrance(params, options, wi, wo):
    """F D G/(4 μi μo), Beckmann's D, V-cavities [Cook & Torrance 1982 with the factor corrected]."""
    return reflected(beckmann_d(params, half_vector(wi, wo)), v_cavity(wi, wo), params, wi, wo)


@above_horizon
def cook_torrance_1982(params, options, wi, wo):
    """F (π D) G/(π μi μo), as often read from Cook & Torrance 1982: four times cook_torrance."""
    un_normalised = mp.pi * beckmann_d(params, half_vector(wi, wo))
    f = fresnel(mp.cos(theta_d(wi, wo)), params)
    return f * un_normalised * v_cavity(wi, wo) / (mp.pi * wi[2] * wo[2])


@above_horizon
def abc_microfacet(params, options, wi, wo):
    """F S G/(μi μo), S = (1 + b(1 − cos θh))^(−c), V-cavities [Löw et al. 2012, eq. 15]."""
    s = (1 + params["b"] * (1 - mp.cos(theta(half_vector(wi, wo))))) ** (-params["c"])
    return fresnel(mp.cos(theta_d(wi, wo)), params) * s * v_cavity(wi, wo) / (wi[2] * wo[2])


def _sgd_g1(params, v):
    beyond = theta(v) - params["theta_0"]
    if beyond <= 0:
        return mpf(1)
    return 1 + params["lam"] * (1 - mp.exp(params["c"] * beyond ** params["k"]))


@above_horizon
def sgd(params, options, wi, wo):
    """Shifted gamma distribution, (1/π) F D G1(i) G1(o)/(μi μo) [Bagher, Soler & Holzschuch 2012].

    D = κ exp(−t)/(π cos⁴θh t^p), t = α + tan²θh/α; F = f0 + (1 − f0)(1 − cos θd)⁵ − f1 cos θd; G1 is 1 up to θ0.
    """
    theta_h, cos_d = theta(half_vector(wi, wo)), mp.cos(theta_d(wi, wo))
    t = params["alpha"] + mp.tan(theta_h) ** 2 / params["alpha"]
    d = params["kappa"] * mp.exp(-t) / t ** params["p"] / (mp.pi * mp.cos(theta_h) ** 4)
    f = schlick1994(cos_d, params["f0"]) - params["f1"] * cos_d
    return f * d * _sgd_g1(params, wi) * _sgd_g1(params, wo) / (mp.pi * wi[2] * wo[2])


CHARLIE = {  # the fit's numbers at roughness 0 and 1
    "a": ("25.3245", "21.5473"),
    "b": ("3.32435", "3.82987"),
    "c": ("0.16801", "0.19823"),
    "d": ("-1.27393", "-1.97760"),
    "e": ("-4.85967", "-4.32054"),
}


def _charlie_lambda(alpha, mu):
    """exp L(μ) for μ < ½, exp(2 L(½) − L(1 − μ)) above, L(x) = a/(1 + b x^c) + d x + e."""
    weight = (1 - alpha) ** 2
    a, b, c, d, e = (weight * mpf(first) + (1 - weight) * mpf(last) for first, last in CHARLIE.values())

    def exponent(x):
        return a / (1 + b * x**c) + d * x + e

    if mu < mpf(1) / 2:
        return mp.exp(exponent(mu))
    return mp.exp(2 * exponent(mpf(1) / 2) - exponent(1 - mu))


@above_horizon
def charlie(params, options, wi, wo):
    """D G/(4 μi μo), D = (2 + 1/α) sin^(1/α) θh/(2π), F = 1 [Estevez & Kulla 2017].

    α is the paper's roughness itself (not its square, as in some renderers); the paper's softening of the terminator,
    which breaks reciprocity, is left out. visibility = ashikhmin: 1/(4(μi + μo − μi μo)) [Ashikhmin & Premože 2007].
    """
    alpha = params["alpha"]
    d = (2 + 1 / alpha) * mp.sin(theta(half_vector(wi, wo))) ** (1 / alpha) / (2 * mp.pi)
    if options.get("visibility", "fitted") == "ashikhmin":
        return d / (4 * (wi[2] + wo[2] - wi[2] * wo[2]))
    total = 1 + _charlie_lambda(alpha, wi[2]) + _charlie_lambda(alpha, wo[2])
    return d / (total * 4 * wi[2] * wo[2])
