"""Textbook forms of the diffuse models."""

from mpmath import mp, mpf

from gonio.stability.textbook.frame import above_horizon, delta_phi, theta, theta_d


@above_horizon
def lambert(params, options, wi, wo):
    """ρ/π [Lambert 1760]."""
    return params["rho"] / mp.pi


def _fujii_a(r):
    return 1 / (1 + (mpf(1) / 2 - 2 / (3 * mp.pi)) * r)


def _fujii_shape(r, wi, wo):
    """A (1 + r s/t), s = sin θi sin θo cos Δφ, t = max(μi, μo) where s > 0, else 1."""
    s = mp.sin(theta(wi)) * mp.sin(theta(wo)) * mp.cos(delta_phi(wi, wo))
    t = max(wi[2], wo[2]) if s > 0 else 1
    return _fujii_a(r) * (1 + r * s / t)


@above_horizon
def fujii(params, options, wi, wo):
    """ρ/π A (1 + r s/t) [Fujii's Oren-Nayar, as in Portsmouth, Kutz & Hill 2024]."""
    return params["rho"] / mp.pi * _fujii_shape(params["r"], wi, wo)


def _fujii_albedo(r, w):
    """E(θ) = A + (r A/π) G, G = S (θ − S μ) + (2/3)((S/μ)(1 − S³) − S), S = sin θ."""
    angle = theta(w)
    s, mu = mp.sin(angle), mp.cos(angle)
    g = s * (angle - s * mu) + mpf(2) / 3 * (s / mu * (1 - s**3) - s)
    return _fujii_a(r) * (1 + r / mp.pi * g)


@above_horizon
def eon(params, options, wi, wo):
    """Fujii's single scattering plus ρ_ms/π (1 − E(μi))(1 − E(μo))/(1 − E_avg) [Portsmouth, Kutz & Hill 2024]."""
    rho, r = params["rho"], params["r"]
    single = rho / mp.pi * _fujii_shape(r, wi, wo)
    if r == 0:  # Lambert: nothing is lost, 1 - E_avg = 0
        return single
    average = _fujii_a(r) * (1 + (mpf(2) / 3 - mpf(28) / (15 * mp.pi)) * r)
    rho_ms = rho**2 * average / (1 - rho * (1 - average))
    return single + rho_ms / mp.pi * (1 - _fujii_albedo(r, wi)) * (1 - _fujii_albedo(r, wo)) / (1 - average)


@above_horizon
def oren_nayar(params, options, wi, wo):
    """Oren & Nayar 1994: their full model (C1, C2, C3 and interreflection) or their qualitative one.

    Both with σ²/(σ² + 0.33) in the first coefficient, as printed; the footnote's 0.57 is not used.
    """
    rho, s2 = params["rho"], params["sigma"] ** 2
    theta_i, theta_o, cos_phi = theta(wi), theta(wo), mp.cos(delta_phi(wi, wo))
    alpha, beta = max(theta_i, theta_o), min(theta_i, theta_o)
    c1 = 1 - s2 / (s2 + mpf("0.33")) / 2
    c2 = mpf("0.45") * s2 / (s2 + mpf("0.09"))
    if options.get("form", "full") == "qualitative":
        return rho / mp.pi * (c1 + c2 * max(mpf(0), cos_phi) * mp.sin(alpha) * mp.tan(beta))
    c2 *= mp.sin(alpha) - (0 if cos_phi >= 0 else (2 * beta / mp.pi) ** 3)
    c3 = mpf("0.125") * s2 / (s2 + mpf("0.09")) * (4 * alpha * beta / mp.pi**2) ** 2
    single = c1 + cos_phi * c2 * mp.tan(beta) + (1 - abs(cos_phi)) * c3 * mp.tan((alpha + beta) / 2)
    twice = mpf("0.17") * s2 / (s2 + mpf("0.13")) * (1 - cos_phi * (2 * beta / mp.pi) ** 2)
    return rho / mp.pi * single + rho**2 / mp.pi * twice


@above_horizon
def minnaert(params, options, wi, wo):
    """ρ (k + 1)/(2π) (μi μo)^(k − 1) [Minnaert 1941]."""
    k = params["k"]
    return params["rho"] * (k + 1) / (2 * mp.pi) * (wi[2] * wo[2]) ** (k - 1)


@above_horizon
def burley_diffuse(params, options, wi, wo):
    """ρ/π (1 + (F90 − 1)(1 − μi)⁵)(1 + (F90 − 1)(1 − μo)⁵), F90 = ½ + 2 roughness cos²θd [Burley 2012]."""
    f90 = mpf(1) / 2 + 2 * params["roughness"] * mp.cos(theta_d(wi, wo)) ** 2
    return params["rho"] / mp.pi * (1 + (f90 - 1) * (1 - wi[2]) ** 5) * (1 + (f90 - 1) * (1 - wo[2]) ** 5)


@above_horizon
def ashikhmin_shirley_diffuse(params, options, wi, wo):
    """28 Rd/(23π) (1 − Rs)(1 − (1 − μi/2)⁵)(1 − (1 − μo/2)⁵) [Ashikhmin & Shirley 2000]."""
    scale = 28 * params["rd"] / (23 * mp.pi) * (1 - params["rs"])
    return scale * (1 - (1 - wi[2] / 2) ** 5) * (1 - (1 - wo[2] / 2) ** 5)
