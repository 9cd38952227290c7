"""Textbook forms of the scatter of polished surfaces [Rayleigh 1907; Rice 1951] and of scalar gratings."""

from gonio.stability.textbook.frame import Options, Pair, Params, TextbookForm, mp, mpf
from gonio.stability.textbook.fresnel import fresnel


def polarisation_sum(pair: Pair, params: Params) -> mpf:
    """½ Σ|q|² over the four polarisations [Stover 2012, eq. 5.3 to 5.7], φ counted from the mirror side."""
    n2 = mp.mpc(params["eta"], params.get("k", 0)) ** 2
    c_i, c_s = pair.mu_i, pair.mu_o
    s_i, s_s = mp.sin(pair.theta_i), mp.sin(pair.theta_o)
    cos_p, sin_p = -mp.cos(pair.delta_phi), mp.sin(pair.delta_phi)
    xi_i, xi_s = mp.sqrt(n2 - s_i**2), mp.sqrt(n2 - s_s**2)
    q_ss = cos_p / ((c_i + xi_i) * (c_s + xi_s))
    q_sp = sin_p * xi_s / ((c_i + xi_i) * (n2 * c_s + xi_s))
    q_ps = sin_p * xi_i / ((n2 * c_i + xi_i) * (c_s + xi_s))
    q_pp = (n2 * s_i * s_s - xi_i * xi_s * cos_p) / ((n2 * c_i + xi_i) * (n2 * c_s + xi_s))
    return abs(n2 - 1) ** 2 * mp.fsum(abs(q) ** 2 for q in (q_ss, q_sp, q_ps, q_pp)) / 2


def spectral_density(f: mpf, params: Params, options: Options) -> mpf:
    """S2, µm⁴, of the frequency f, 1/µm."""
    spectrum = options.get("spectrum", "abc")
    if spectrum == "abc":
        return params["a"] / (1 + (params["b"] * f) ** 2) ** (params["c"] / 2)
    if spectrum == "gaussian":
        sigma, tau = params["sigma"], params["tau"]
        return mp.pi * sigma**2 * tau**2 * mp.exp(-((mp.pi * tau * f) ** 2))
    if spectrum == "fractal":
        return params["strength"] / max(f, params["lowest"]) ** params["power"]
    points = [tuple(map(mpf, pair.split(":"))) for pair in options["psd"].split()]
    if f <= points[0][0]:
        return points[0][1]
    k = next((k for k, (end, _) in enumerate(points) if f <= end), len(points) - 1)
    (f_1, s_1), (f_2, s_2) = points[k - 1 : k + 1]
    power = mp.log(s_2 / s_1) / mp.log(f_2 / f_1)
    return s_2 * (f / f_2) ** (min(power, 0) if f > f_2 else power)


@TextbookForm
def rayleigh_rice(params: Params, options: Options, pair: Pair) -> mpf:
    """(16π²/λ⁴) μi μo |q|² S2(|β − β0|/λ)."""
    wavelength = params["wavelength"]
    density = spectral_density(mp.sqrt(pair.projected_distance2) / wavelength, params, options)
    return 16 * mp.pi**2 / wavelength**4 * pair.mu_i * pair.mu_o * polarisation_sum(pair, params) * density


@TextbookForm
def grating(params: Params, options: Options, pair: Pair) -> mpf:
    """Σ_m η_m exp(−|β − β_m|²/2w²)/(2πw²) over the orders about the nearest [Goodman 2005, §4.4]."""
    wavelength, depth = params["wavelength"], params["depth"]
    spacing, angle = wavelength / params["period"], mp.radians(params.get("azimuth", 0))
    width = min(params.get("width", mpf(0.01)), spacing / 4)
    across = pair.sum[0] * mp.cos(angle) + pair.sum[1] * mp.sin(angle)
    along2 = pair.projected_distance2 - across**2
    phase = 2 * mp.pi * depth / wavelength * (pair.mu_i + pair.mu_o)
    total = mpf(0)
    for order in (int(mp.nint(across / spacing)) + n for n in range(-3, 4)):
        if options.get("profile") != "lamellar":
            share = mp.besselj(abs(order), phase / 2) ** 2
        elif order:
            share = (2 * mp.sin(phase / 2) * mp.sin(mp.pi * order * params["duty"]) / (mp.pi * order)) ** 2
        else:
            share = 1 - 4 * params["duty"] * (1 - params["duty"]) * mp.sin(phase / 2) ** 2
        total += share * mp.exp(-((across - order * spacing) ** 2 + along2) / (2 * width**2))
    if options.get("weight") == "perturbation":
        reflected = polarisation_sum(pair, params) * 4 * pair.mu_i * pair.mu_o / (pair.mu_i + pair.mu_o) ** 2
    else:
        reflected = fresnel(pair.cos_d, params)
    return reflected * total / (2 * mp.pi * width**2)
