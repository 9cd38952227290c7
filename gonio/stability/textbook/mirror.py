"""Textbook forms of the lobes about the mirror direction."""

from gonio.stability.textbook.frame import Options, Pair, Params, TextbookForm, angle, mirror, mp, mpf, unit
from gonio.stability.textbook.fresnel import fresnel


@TextbookForm
def phong(params: Params, options: Options, pair: Pair) -> mpf:
    """(n + 2)/(2π) cosⁿβ, β the angle from the mirror direction, 0 beyond 90° [Phong 1975; Lafortune & Willems 1994].

    For n = 0, where 0⁰ is a matter of taste, the limit n → 0 is taken: 0 beyond 90°.
    """
    n, cos_beta = params["n"], mp.cos(angle(mirror(pair.wi), pair.wo))
    return (n + 2) / (2 * mp.pi) * cos_beta**n if cos_beta > 0 else mpf(0)


@TextbookForm
def lafortune(params: Params, options: Options, pair: Pair) -> mpf:
    """max(cx ix ox + cy iy oy + cz iz oz, 0)ⁿ [Lafortune et al. 1997].

    norm = ngan: times (n + 2)/(2π max(|cz|, |cxy|)ⁿ) [Ngan et al. 2005]; where cx ≠ cy, |cxy| is the larger of the two.
    """
    c, n = (params["c_x"], params["c_y"], params["c_z"]), params["n"]
    base = mp.fsum(scale * i * o for scale, i, o in zip(c, pair.wi, pair.wo, strict=True))
    if base <= 0:
        return mpf(0)
    if options.get("norm", "lafortune") == "ngan":
        return (n + 2) / (2 * mp.pi) * (base / max(abs(scale) for scale in c)) ** n
    return base**n


@TextbookForm
def abc_smooth(params: Params, options: Options, pair: Pair) -> mpf:
    """F S, S = (1 + b |Dp|²)^(−c), cos θd = √(1 − |ip − op|²/4) [Löw et al. 2012, eq. 10 to 14]."""
    # Of unit vectors: beyond the unit circle, where rounding puts some, the root would not exist.
    i, o = unit(pair.wi), unit(pair.wo)
    apart2 = (i[0] - o[0]) ** 2 + (i[1] - o[1]) ** 2
    cos_d = mp.sqrt(max(mpf(0), 1 - apart2 / 4))
    return fresnel(cos_d, params) * (1 + params["b"] * pair.projected_distance2) ** (-params["c"])


@TextbookForm
def harvey_shack(params: Params, options: Options, pair: Pair) -> mpf:
    """b0 (1 + (|β − β0|/l)²)^(s/2) [Harvey 1976]."""
    return params["b0"] * (1 + pair.projected_distance2 / params["l"] ** 2) ** (params["s"] / 2)


@TextbookForm
def abg(params: Params, options: Options, pair: Pair) -> mpf:
    """a/(b + |β − β0|^g), the form of stray-light programs."""
    return params["a"] / (params["b"] + mp.sqrt(pair.projected_distance2) ** params["g"])
