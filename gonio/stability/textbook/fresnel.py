"""Fresnel reflectance of unpolarised light in textbook form."""

from gonio.stability.textbook.frame import Params, mp, mpf


def schlick1994(cos_d: mpf, f0: mpf) -> mpf:
    return f0 + (1 - f0) * (1 - cos_d) ** 5


def exact(cos_d: mpf, eta: mpf, k: mpf | int = 0) -> mpf:
    """Mean of |r_s|² and |r_p|² with Snell's refracted cosine, for the index η + ik relative to the outside."""
    n = mp.mpc(eta, k) if k else eta
    cos_t = mp.sqrt(1 - (1 - cos_d**2) / n**2)
    r_s = (cos_d - n * cos_t) / (cos_d + n * cos_t)
    r_p = (n * cos_d - cos_t) / (n * cos_d + cos_t)
    return (abs(r_s) ** 2 + abs(r_p) ** 2) / 2


def fresnel(cos_d: mpf, params: Params) -> mpf:
    """By the parameters given: Schlick's with f0, the exact one with eta (and k), else 1."""
    if "f0" in params:
        return schlick1994(cos_d, params["f0"])
    if "eta" in params:
        return exact(cos_d, params["eta"], params.get("k", 0))
    return mpf(1)


def average(params: Params) -> mpf:
    """F_avg = 2 ∫ F(μ) μ dμ; Schlick's is F0 + (1 − F0)/21."""
    if "f0" in params:
        return params["f0"] + (1 - params["f0"]) / 21
    if "eta" not in params:
        return mpf(1)
    eta = params["eta"]
    critical = [mp.sqrt(1 - eta**2)] if eta < 1 else []  # below it dielectrics reflect totally
    return 2 * mp.quad(lambda mu: fresnel(mu, params) * mu, [0, *critical, 1])
