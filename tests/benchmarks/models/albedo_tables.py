"""Makes models/microfacet/albedos.npz, the Chebyshev coefficients that albedo_tables reads, in 80 s.

    python tests/benchmarks/models/albedo_tables.py

Every number is an integral over the slopes of the facets, in polar coordinates (s, ψ) of the slope in units of α:
with i·m/m_z = μ(1 + ts), t = α tanθ cosψ, the facet mirrors light above the horizon for s < s_h, below it from there
to the s where it turns its back. What is *missing* of 1 (1 − E for F = 1) is integrated as such, so that it keeps its
digits where it is 1e-8: the part that leaves downwards, and the part above that the neighbours mask.
"""

import pathlib

import numpy as np
from scipy.special import erfc, erfcx

SQRT_PI = np.sqrt(np.pi)
ALPHA_LEAST = 1e-4
ALPHA_BELOW = 6e-5  # of the tables whose slopes count at ALPHA_LEAST, see albedo_tables
ETA_LEAST, ETA_MOST = 1.01, 4.0
LAST_GAUSSIAN = 7.0  # exp(−49) = 5e-22
NODES = 72  # of each of the two panels along s and of each of the two along ψ
QUANTUM = 1e-11  # coefficients are kept as multiples of it: the file is then a third of its size


def legendre(n):
    x, w = np.polynomial.legendre.leggauss(n)
    return (x + 1) / 2, w / 2


def sinhc(x):
    return np.where(np.abs(x) < 1e-4, 1 + x * x / 6, np.sinh(x) / np.where(x == 0, 1, x))


def azimuths(tan_i, n):
    """cos ψ and weights (of 2π in all), clustered at ±π/2 where the horizon of a grazing incidence turns."""
    x, w = legendre(n)
    u, w = np.r_[x, 1 + x] / 4, np.r_[w, w] / 2
    big_y = np.arcsinh(tan_i)[:, None]
    cos_u, sin_u = np.cos(2 * np.pi * u), np.sin(2 * np.pi * u)
    y = -big_y * cos_u
    ends = np.sqrt(sinhc(2 * big_y * np.sin(np.pi * u) ** 2) * sinhc(2 * big_y * np.cos(np.pi * u) ** 2))
    cos_psi = -cos_u * sinhc(y)
    return cos_psi / np.hypot(cos_psi, sin_u * ends), 2 * np.pi * np.cosh(y) / ends * w


def ggx_excess(mu, alpha):
    """μΛ(μ) of GGX."""
    b2 = alpha**2 * (1 - mu) * (1 + mu)
    return 0.5 * b2 / (np.sqrt(mu * mu + b2) + mu)


def beckmann_excess(mu, alpha):
    """μΛ(μ) of Beckmann."""
    b = alpha * np.sqrt((1 - mu) * (1 + mu))
    a = np.minimum(mu / np.maximum(b, 1e-300), 26.0)
    return np.maximum(0.5 * b * np.exp(-a * a) * (1 / SQRT_PI - a * erfcx(a)), 0)


EXCESS = {"ggx": ggx_excess, "beckmann": beckmann_excess}


class Slopes:
    """Nodes over the facets that mirror above the horizon, for incidences mu; shapes (mu, ψ, s).

    `weight` is p(s) s ds dψ, `facing` 1 + ts, `mu_o` the cosine of the outgoing direction, `cos_d` that at the facet.
    The s nearest to the horizon are clustered at the scale on which μ_o passes α.
    """

    def __init__(self, kind, mu, alpha, n):
        self.kind, self.mu, self.alpha = kind, mu, alpha
        cos_psi, self.ring = azimuths(np.sqrt((1 - mu) * (1 + mu)) / mu, n)
        self.t = alpha * (np.sqrt((1 - mu) * (1 + mu)) / mu)[:, None] * cos_psi
        root = np.sqrt(self.t**2 + alpha**2)
        self.horizon = np.where(self.t >= 0, (self.t + root) / alpha**2, 1 / (root + np.abs(self.t)))
        last = self.horizon if kind == "ggx" else np.minimum(self.horizon, LAST_GAUSSIAN)
        x, w = legendre(n)
        m, t, end, last = mu[:, None, None], self.t[..., None], self.horizon[..., None], last[..., None]
        span = np.arcsinh(last / 2)
        s_inner, ds_inner = np.sinh(span * x), np.cosh(span * x) * span * w
        rate = (2 * root * self.horizon * mu[:, None] / (1 + (alpha * self.horizon) ** 2))[..., None]
        layer = np.minimum(alpha / rate, 10.0)
        y_0 = np.arcsinh(np.where(last < end, 1 - last / end, 0) / layer)
        y_1 = np.arcsinh((1 - last / (2 * end)) / layer)
        y = y_0 + (y_1 - y_0) * x
        below = layer * np.sinh(y)  # 1 − s/s_h
        s_outer, ds_outer = end * (1 - below), end * layer * np.cosh(y) * (y_1 - y_0) * w
        s, ds = (np.concatenate(a, -1) for a in ((s_inner, s_outer), (ds_inner, ds_outer)))
        left = np.concatenate([1 - s_inner / end, below], -1)
        stretch = 1 + (alpha * s) ** 2
        self.s, self.stretch, self.facing = s, stretch, 1 + t * s
        self.mu_o = np.clip(m * left * (1 + alpha**2 * end * s) / stretch, 0, 1)
        self.cos_d = np.clip(m * self.facing / np.sqrt(stretch), 0, 1)
        density = 1 / (np.pi * (1 + s * s) ** 2) if kind == "ggx" else np.exp(-s * s) / np.pi
        self.weight = self.ring[..., None] * ds * density * s

    def downwards(self):
        """∫ p (1 + ts) over the facets that face the light and mirror it below the horizon, in closed form."""
        t, start = self.t, self.horizon
        stop = np.where(t < 0, -1 / np.where(t < 0, t, -1), 1e30)
        if self.kind == "ggx":

            def first(s):
                return 0.5 / (1 + s * s)

            def second(s):
                return 0.5 * (np.arctan2(1, s) + s / (1 + s * s))
        else:
            start, stop = np.minimum(start, 1e3), np.minimum(stop, 1e3)

            def first(s):
                return 0.5 * np.exp(-np.minimum(s * s, 700))

            def second(s):
                return 0.5 * s * np.exp(-np.minimum(s * s, 700)) + 0.25 * SQRT_PI * erfc(s)

        value = first(start) - first(stop) + t * (second(start) - second(stop))
        return (self.ring * value).sum(1) / np.pi


def smith_missing(kind, smith, mu, alpha, n=NODES):
    """1 − E(μ) of F = 1 facets: G₁(i) of what leaves downwards, and G₁(i) − G₂ of the rest."""
    slopes, excess = Slopes(kind, mu, alpha, n), EXCESS[kind]
    lambda_i = excess(mu, alpha) / mu
    q_o, mu_o = excess(slopes.mu_o, alpha), slopes.mu_o
    seen = mu_o * (1 + lambda_i[:, None, None]) if smith == "correlated" else mu_o
    masked = q_o / np.where(seen + q_o > 0, seen + q_o, 1)
    return ((slopes.weight * slopes.facing * masked).sum((1, 2)) + slopes.downwards()) / (1 + lambda_i)


def kelemen_missing(mu, alpha, n=NODES):
    """1 − E(μ) of D/|i + o|² with Beckmann's D and F = 1, and how much less F = (1 − d)⁵ reflects."""
    slopes = Slopes("beckmann", mu, alpha, n)
    below = (slopes.ring * np.exp(-np.minimum(slopes.horizon**2, 700))).sum(1) / (2 * np.pi)
    lean = slopes.facing - 1
    white = (slopes.weight * ((alpha * slopes.s) ** 2 - lean) / slopes.facing).sum((1, 2)) + below
    share = slopes.weight * slopes.mu_o * slopes.stretch / (mu[:, None, None] * slopes.facing)
    return white, (share * (1 - (1 - slopes.cos_d) ** 5)).sum((1, 2))


def fresnel_dielectric(c, eta):
    excess = (eta - 1) * (eta + 1)
    g = np.sqrt(excess + c * c)
    r_s = -excess / (c + g) ** 2
    r_p = excess * ((eta**2 + 1) * c * c - 1) / (eta**2 * c + g) ** 2
    return 0.5 * (r_s**2 + r_p**2)


def dielectric_albedo(mu, alpha, etas, n=NODES):
    """E(μ) of GGX with height-correlated masking and a dielectric's Fresnel, shape (mu, eta)."""
    slopes = Slopes("ggx", mu, alpha, n)
    seen = slopes.mu_o * (1 + ggx_excess(mu, alpha) / mu)[:, None, None]
    share = slopes.weight * slopes.facing * slopes.mu_o / (seen + ggx_excess(slopes.mu_o, alpha))
    return np.stack([(share * fresnel_dielectric(slopes.cos_d, eta)).sum((1, 2)) for eta in etas], -1)


def chebyshev_nodes(n):
    return np.cos(np.pi * (np.arange(n) + 0.5) / n)


def coefficients(values):
    """Chebyshev coefficients along every axis of values at the Chebyshev nodes."""
    for axis, n in enumerate(values.shape):
        k = np.arange(n)
        rule = np.cos(np.outer(k, np.pi * (k + 0.5) / n)) * 2 / n
        rule[0] /= 2
        values = np.moveaxis(np.tensordot(rule, values, axes=(1, axis)), 0, axis)
    return np.rint(values / QUANTUM).astype(np.int64)


def log_cosines(s, alpha, power):
    """μ of s in [0, 1] where log(1 + μ/(3α)) grows as s^power; albedo_tables has the inverse."""
    c = 3 * alpha
    return np.clip(c * np.expm1(np.log1p(1 / c) * s**power), 1e-300, 1)


def ratio_cosines(s, alpha):
    """μ of s in [0, 1] where μ(1 + 6α)/(μ + 6α) = s²."""
    c = 6 * alpha
    return np.clip(c * s**2 / (1 + c - s**2), 1e-300, 1)


def log_widths(n, least=ALPHA_LEAST):
    return least ** ((1 - chebyshev_nodes(n)) / 2)


def linear_widths(n):
    return ALPHA_LEAST + (chebyshev_nodes(n) + 1) / 2 * (1 - ALPHA_LEAST)


def table(n_mu, widths, cosines, value):
    s = (chebyshev_nodes(n_mu) + 1) / 2
    return coefficients(np.stack([value(cosines(s, alpha), alpha) for alpha in widths], 1))


def make():
    made = {}
    for smith in ("correlated", "separable"):
        made[f"ggx_{smith}"] = table(
            56,
            log_widths(48),
            lambda s, a: log_cosines(s, a, 3),
            lambda mu, a, smith=smith: smith_missing("ggx", smith, mu, a) * (1 + mu / a) ** 2,
        )
        made[f"beckmann_{smith}"] = table(
            56,
            linear_widths(48),
            ratio_cosines,
            lambda mu, a, smith=smith: smith_missing("beckmann", smith, mu, a) * (1 + mu / (4 * a)) ** 2,
        )
    white, grazing = (
        table(
            76,
            log_widths(64, ALPHA_BELOW),
            lambda s, a: log_cosines(s, a, 2),
            lambda mu, a, k=k: kelemen_missing(mu, a)[k] * ((1 + mu / a) ** 2 if k == 0 else 1),
        )
        for k in (0, 1)
    )
    made |= {"kelemen_white": white, "kelemen_grazing": grazing}
    least, most = (0.5 * np.log((e - 1) * (e + 1)) for e in (ETA_LEAST, ETA_MOST))
    etas = np.sqrt(1 + np.exp(2 * (least + (chebyshev_nodes(24) + 1) / 2 * (most - least))))
    made["coat"] = table(
        48, log_widths(36), lambda s, a: log_cosines(s, a, 2), lambda mu, a: dielectric_albedo(mu, a, etas)
    )
    return made


if __name__ == "__main__":
    made = make()
    for name, c in made.items():
        last = [QUANTUM * np.abs(np.take(c, range(-4, 0), axis)).max() for axis in range(c.ndim)]
        print(f"{name}: {c.shape}, last coefficients {', '.join(f'{x:.1e}' for x in last)}")
    np.savez_compressed(pathlib.Path(__file__).parents[3] / "models" / "microfacet" / "albedos.npz", **made)
