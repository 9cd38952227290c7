"""Textbook forms of models of particulate and layered media, and of remote sensing."""

import functools

from gonio.stability.textbook.frame import Options, Pair, Params, TextbookForm, mp, mpf

H_STEP = mpf(3) / 25  # the trapezoidal rule's error is about exp(-pi²/step), 1e-35
H_REACH = 80  # exp(-80) is what the rule leaves out


@TextbookForm
def lommel_seeliger(params: Params, options: Options, pair: Pair) -> mpf:
    """w/(4π(μi + μo)) [Lommel 1887; Seeliger 1888]."""
    return params["w"] / (4 * mp.pi * (pair.mu_i + pair.mu_o))


@functools.lru_cache(maxsize=256)
def _h_nodes(w: mpf, decades: int) -> list[tuple[mpf, mpf]]:
    """Nodes t of the integral for ln H and ln(1 − w arctan(t)/t) there, for every μ down to 10^-decades."""
    nodes = []
    with mp.workdps(120):  # 1 - arctan(t)/t is t²/3 at the lower end, 1e-70
        last = mp.ceil((decades * mp.log(10) + H_REACH / mpf(2)) / H_STEP)
        for j in range(-int(H_REACH / H_STEP), int(last) + 1):
            t = mp.exp(j * H_STEP)
            nodes.append((t, mp.log(1 - w * mp.atan(t) / t)))
    with mp.workdps(45):
        return [(+t, +value) for t, value in nodes]


@functools.lru_cache(maxsize=100_000)
def chandrasekhar_h(w: mpf, mu: mpf) -> mpf:
    """H of isotropic scattering: ln H(μ) = −(μ/π) ∫₀^∞ ln(1 − w arctan(t)/t)/(1 + μ²t²) dt, to 32 digits.

    [Chandrasekhar 1960, ch. V, the integral over the imaginary axis]. With t = eˢ the integrand is analytic for
    |Im s| < π/2, and the trapezoidal rule converges geometrically at every w and μ.
    """
    if w == 0:
        return mpf(1)
    decades = 20 * max(1, int(mp.ceil(-mp.log10(mu) / 20)))
    nodes = _h_nodes(w, decades)
    with mp.workdps(45):
        total = mpf(0)
        for t, value in nodes:
            s = mu * t
            total += value * s / (1 + s * s)
        return mp.exp(-H_STEP / mp.pi * total)


@TextbookForm
def chandrasekhar(params: Params, options: Options, pair: Pair) -> mpf:
    """w H(μi) H(μo)/(4π(μi + μo)) [Chandrasekhar 1960]."""
    w, mu_i, mu_o = params["w"], pair.mu_i, pair.mu_o
    return w * chandrasekhar_h(w, mu_i) * chandrasekhar_h(w, mu_o) / (4 * mp.pi * (mu_i + mu_o))


def _hapke_h(version: str, w: mpf, mu: mpf) -> mpf:
    gamma = mp.sqrt(1 - w)
    if version == "1981":
        return (1 + 2 * mu) / (1 + 2 * mu * gamma)
    if version == "2002":
        r0 = (1 - gamma) / (1 + gamma)
        return 1 / (1 - w * mu * (r0 + (1 - 2 * r0 * mu) / 2 * mp.log((1 + mu) / mu)))
    return chandrasekhar_h(w, mu)


def _henyey_greenstein(b: mpf, cos_g: mpf) -> mpf:
    """(1 − b²)/(1 + 2b cos g + b²)^1.5, forward for b > 0 at the phase angle g [Henyey & Greenstein 1941]."""
    return (1 - b**2) / (1 + 2 * b * cos_g + b**2) ** mpf("1.5")


@TextbookForm
def hapke(params: Params, options: Options, pair: Pair) -> mpf:
    """w/(4π(μi + μo)) [(1 + B(g)) P(g) + H(μi) H(μo) − 1] [Hapke 1981, 2002]; g is the phase angle.

    P = (1+c)/2 (1−b²)/(1 − 2b cos g + b²)^1.5 + (1−c)/2 (1−b²)/(1 + 2b cos g + b²)^1.5, B = b0/(1 + tan(g/2)/h). The
    default of h_function is taken to be "1981".
    """
    w, b, c, h = (params[n] for n in ("w", "b", "c", "h"))
    opening, cos_g = mp.tan(pair.phase / 2), mp.cos(pair.phase)
    surge = params["b0"] / (1 + opening / h if h else mp.inf if opening else 1)
    phase = (1 + c) / 2 * _henyey_greenstein(-b, cos_g) + (1 - c) / 2 * _henyey_greenstein(b, cos_g)
    version = options.get("h_function", "1981")
    multiple = _hapke_h(version, w, pair.mu_i) * _hapke_h(version, w, pair.mu_o) - 1
    return w / (4 * mp.pi * (pair.mu_i + pair.mu_o)) * ((1 + surge) * phase + multiple)


def _hot_spot_distance(pair: Pair) -> mpf:
    """√(tan²θi + tan²θo − 2 tan θi tan θo cos Δφ)."""
    tan_i, tan_o = mp.tan(pair.theta_i), mp.tan(pair.theta_o)
    return mp.sqrt(abs(tan_i**2 + tan_o**2 - 2 * tan_i * tan_o * mp.cos(pair.delta_phi)))


@TextbookForm
def rpv(params: Params, options: Options, pair: Pair) -> mpf:
    """BRF/π, BRF = ρ0 (μi μo)^(k−1) (μi + μo)^(k−1) F(g) (1 + (1 − ρc)/(1 + G)) [Rahman, Pinty & Verstraete 1993].

    F = (1 − Θ²)/(1 + Θ² + 2Θ cos g)^1.5 with the phase angle g, so Θ < 0 scatters backward; the azimuths of light and
    detector are equal at the hot spot.
    """
    minnaert_term = (pair.mu_i * pair.mu_o * (pair.mu_i + pair.mu_o)) ** (params["k"] - 1)
    phase = _henyey_greenstein(params["theta"], mp.cos(pair.phase))
    hot_spot = 1 + (1 - params["rho_c"]) / (1 + _hot_spot_distance(pair))
    return params["rho0"] / mp.pi * minnaert_term * phase * hot_spot


@TextbookForm
def ross_li(params: Params, options: Options, pair: Pair) -> mpf:
    """(f_iso + f_vol K_vol + f_geo K_geo)/π: Ross-thick, Li-sparse-reciprocal [Lucht, Schaaf & Strahler 2000].

    h/b = 2 and b/r = 1, so θ' = θ; ξ is the phase angle, 0 at the hot spot.
    """
    theta_i, theta_o, xi = pair.theta_i, pair.theta_o, pair.phase
    k_vol = ((mp.pi / 2 - xi) * mp.cos(xi) + mp.sin(xi)) / (mp.cos(theta_i) + mp.cos(theta_o)) - mp.pi / 4
    sec_i, sec_o = mp.sec(theta_i), mp.sec(theta_o)
    across = mp.tan(theta_i) * mp.tan(theta_o) * mp.sin(pair.delta_phi)
    cos_t = min(mpf(1), 2 * mp.sqrt(_hot_spot_distance(pair) ** 2 + across**2) / (sec_i + sec_o))
    t = mp.acos(cos_t)
    overlap = (t - mp.sin(t) * cos_t) * (sec_i + sec_o) / mp.pi
    k_geo = overlap - sec_i - sec_o + (1 + mp.cos(xi)) * sec_i * sec_o / 2
    return (params["f_iso"] + params["f_vol"] * k_vol + params["f_geo"] * k_geo) / mp.pi
