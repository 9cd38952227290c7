"""Textbook forms of the diffuse models, and of the standard of reflection 1."""

from gonio.stability.textbook.frame import Options, Pair, Params, TextbookForm, Vector, mp, mpf, theta


@TextbookForm
def lambert(params: Params, options: Options, pair: Pair) -> mpf:
    """ρ/π [Lambert 1760]."""
    return params["rho"] / mp.pi


def _fujii_a(r: mpf) -> mpf:
    return 1 / (1 + (mpf(1) / 2 - 2 / (3 * mp.pi)) * r)


@TextbookForm
def fujii(params: Params, options: Options, pair: Pair) -> mpf:
    """ρ/π A (1 + r s/t), s = sin θi sin θo cos Δφ, t = max(μi, μo) where s > 0, else 1.

    [Fujii's Oren-Nayar, as in Portsmouth, Kutz & Hill 2024].
    """
    r = params["r"]
    s = mp.sin(pair.theta_i) * mp.sin(pair.theta_o) * mp.cos(pair.delta_phi)
    t = max(pair.mu_i, pair.mu_o) if s > 0 else 1
    return params["rho"] / mp.pi * _fujii_a(r) * (1 + r * s / t)


def _fujii_albedo(r: mpf, w: Vector) -> mpf:
    """E(θ) = A + (r A/π) G, G = S (θ − S μ) + (2/3)((S/μ)(1 − S³) − S), S = sin θ."""
    angle = theta(w)
    s, mu = mp.sin(angle), mp.cos(angle)
    g = s * (angle - s * mu) + mpf(2) / 3 * (s / mu * (1 - s**3) - s)
    return _fujii_a(r) * (1 + r / mp.pi * g)


@TextbookForm
def eon(params: Params, options: Options, pair: Pair) -> mpf:
    """Fujii's single scattering plus ρ_ms/π (1 − E(μi))(1 − E(μo))/(1 − E_avg) [Portsmouth, Kutz & Hill 2024]."""
    rho, r = params["rho"], params["r"]
    single = fujii.formula(params, options, pair)
    if r == 0:  # Lambert: nothing is lost, 1 - E_avg = 0
        return single
    average = _fujii_a(r) * (1 + (mpf(2) / 3 - mpf(28) / (15 * mp.pi)) * r)
    rho_ms = rho**2 * average / (1 - rho * (1 - average))
    lost = (1 - _fujii_albedo(r, pair.wi)) * (1 - _fujii_albedo(r, pair.wo))
    return single + rho_ms / mp.pi * lost / (1 - average)


@TextbookForm
def oren_nayar(params: Params, options: Options, pair: Pair) -> mpf:
    """Oren & Nayar 1994: their full model (C1, C2, C3 and interreflection) or their qualitative one.

    Both with σ²/(σ² + 0.33) in the first coefficient, as printed; the footnote's 0.57 is not used.
    """
    rho, s2, cos_phi = params["rho"], params["sigma"] ** 2, mp.cos(pair.delta_phi)
    beta, alpha = sorted((pair.theta_i, pair.theta_o))
    c1 = 1 - s2 / (s2 + mpf("0.33")) / 2
    c2 = mpf("0.45") * s2 / (s2 + mpf("0.09"))
    if options.get("form", "full") == "qualitative":
        return rho / mp.pi * (c1 + c2 * max(mpf(0), cos_phi) * mp.sin(alpha) * mp.tan(beta))
    c2 *= mp.sin(alpha) - (0 if cos_phi >= 0 else (2 * beta / mp.pi) ** 3)
    c3 = mpf("0.125") * s2 / (s2 + mpf("0.09")) * (4 * alpha * beta / mp.pi**2) ** 2
    single = c1 + cos_phi * c2 * mp.tan(beta) + (1 - abs(cos_phi)) * c3 * mp.tan((alpha + beta) / 2)
    twice = mpf("0.17") * s2 / (s2 + mpf("0.13")) * (1 - cos_phi * (2 * beta / mp.pi) ** 2)
    return rho / mp.pi * single + rho**2 / mp.pi * twice


@TextbookForm
def minnaert(params: Params, options: Options, pair: Pair) -> mpf:
    """ρ (k + 1)/(2π) (μi μo)^(k − 1) [Minnaert 1941]."""
    k = params["k"]
    return params["rho"] * (k + 1) / (2 * mp.pi) * (pair.mu_i * pair.mu_o) ** (k - 1)


@TextbookForm
def burley_diffuse(params: Params, options: Options, pair: Pair) -> mpf:
    """ρ/π (1 + (F90 − 1)(1 − μi)⁵)(1 + (F90 − 1)(1 − μo)⁵), F90 = ½ + 2 roughness cos²θd [Burley 2012]."""
    f90 = mpf(1) / 2 + 2 * params["roughness"] * pair.cos_d**2
    return params["rho"] / mp.pi * (1 + (f90 - 1) * (1 - pair.mu_i) ** 5) * (1 + (f90 - 1) * (1 - pair.mu_o) ** 5)


@TextbookForm
def ashikhmin_shirley_diffuse(params: Params, options: Options, pair: Pair) -> mpf:
    """28 Rd/(23π) (1 − Rs)(1 − (1 − μi/2)⁵)(1 − (1 − μo/2)⁵) [Ashikhmin & Shirley 2000]."""
    scale = 28 * params["rd"] / (23 * mp.pi) * (1 - params["rs"])
    return scale * (1 - (1 - pair.mu_i / 2) ** 5) * (1 - (1 - pair.mu_o / 2) ** 5)


def _white_loss(mu: mpf) -> mpf:
    return mu * mp.log(1 + 1 / mu)


@TextbookForm
def white_standard(params: Params, options: Options, pair: Pair) -> mpf:
    """1/(2π(μi + μo)) + R(μi) R(μo)/(π(1 − E_avg)), R = μ ln(1 + 1/μ), E_avg = (4/3)(1 − ln 2)."""
    average = mpf(4) / 3 * (1 - mp.log(2))
    lost = _white_loss(pair.mu_i) * _white_loss(pair.mu_o) / (mp.pi * (1 - average))
    return 1 / (2 * mp.pi * (pair.mu_i + pair.mu_o)) + lost
