"""Textbook forms of the lobes about the mirror direction, and of the standard of reflection 1."""

from mpmath import mp, mpf

from gonio.stability.textbook.frame import above_horizon, angle, mirror, projected_distance2, unit
from gonio.stability.textbook.fresnel import fresnel


@above_horizon
def white_standard(params, options, wi, wo):
    """1/(2π(μi + μo)) + R(μi) R(μo)/(π(1 − E_avg)), R = μ ln(1 + 1/μ), E_avg = (4/3)(1 − ln 2)."""

    def missing(mu):
        return mu * mp.log(1 + 1 / mu)

    average = mpf(4) / 3 * (1 - mp.log(2))
    lost = missing(wi[2]) * missing(wo[2]) / (mp.pi * (1 - average))
    return 1 / (2 * mp.pi * (wi[2] + wo[2])) + lost


@above_horizon
def phong(params, options, wi, wo):
    """(n + 2)/(2π) cosⁿβ, β the angle from the mirror direction, 0 beyond 90° [Phong 1975; Lafortune & Willems 1994].

    For n = 0, where 0⁰ is a matter of taste, the limit n → 0 is taken: 0 beyond 90°.
    """
    n, cos_beta = params["n"], mp.cos(angle(mirror(wi), wo))
    return (n + 2) / (2 * mp.pi) * cos_beta**n if cos_beta > 0 else mpf(0)


@above_horizon
def lafortune(params, options, wi, wo):
    """max(cx ix ox + cy iy oy + cz iz oz, 0)ⁿ [Lafortune et al. 1997].

    norm = ngan: times (n + 2)/(2π max(|cz|, |cxy|)ⁿ) [Ngan et al. 2005]; where cx ≠ cy, |cxy| is the larger of the two.
    """
    c, n = (params["c_x"], params["c_y"], params["c_z"]), params["n"]
    base = sum(scale * i * o for scale, i, o in zip(c, wi, wo, strict=True))
    if base <= 0:
        return mpf(0)
    if options.get("norm", "lafortune") == "ngan":
        return (n + 2) / (2 * mp.pi) * (base / max(abs(scale) for scale in c)) ** n
    return base**n


@above_horizon
def abc_smooth(params, options, wi, wo):
    """F S, S = (1 + b |Dp|²)^(−c), cos θd = √(1 − |ip − op|²/4) [Löw et al. 2012, eq. 10 to 14]."""
    # Of unit vectors: beyond the unit circle, where rounding puts some, the root would not exist.
    i, o = unit(wi), unit(wo)
    apart2 = (i[0] - o[0]) ** 2 + (i[1] - o[1]) ** 2
    cos_d = mp.sqrt(max(mpf(0), 1 - apart2 / 4))
    return fresnel(cos_d, params) * (1 + params["b"] * projected_distance2(wi, wo)) ** (-params["c"])


@above_horizon
def harvey_shack(params, options, wi, wo):
    """b0 (1 + (|β − β0|/l)²)^(s/2) [Harvey 1976]."""
    return params["b0"] * (1 + projected_distance2(wi, wo) / params["l"] ** 2) ** (params["s"] / 2)


@above_horizon
def abg(params, options, wi, wo):
    """a/(b + |β − β0|^g), the form of stray-light programs."""
    return params["a"] / (params["b"] + mp.sqrt(projected_distance2(wi, wo)) ** params["g"])
