"""Directional albedos of isotropic half-vector lobes, integrated over slopes in double precision: right to 1e-12.

For incidence at θ the half vectors whose reflection stays above the horizon are a disc of slopes with centre −tan θ and
radius sec θ. In polar slopes (r, ψ) about the normal, with tan θ cos ψ = sinh y, that disc is r < e^(−y), and
cos θd = (1 − r sinh y) μ/√(1 + r²), μo = μ (e^(−y) − r)(e^y + r)/(1 + r²). Both integrals are trapezoidal rules for
integrands that are analytic and periodic or vanish at both ends: they converge geometrically for every width and angle.
"""

from collections.abc import Callable

import numpy as np

TURN = 300  # midpoints over half a turn

Profile = Callable[[np.ndarray], np.ndarray]
Share = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _logistic(low: float, high: float, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes u and 1 − u of [0, 1] spaced evenly in ln(u/(1 − u)), and their weights."""
    s = low + step * np.arange(int((high - low) / step))
    u, rest = 1 / (1 + np.exp(-s)), 1 / (1 + np.exp(s))
    return u, rest, step * u * rest


def _turn(mu: float) -> tuple[np.ndarray, np.ndarray]:
    """y and dψ over ψ in [0, π], y = Y sin χ with χ spaced evenly, sinh Y = tan θ."""
    chi = np.pi * ((np.arange(TURN) + 0.5) / TURN - 0.5)
    tangent = np.sqrt((1 - mu) * (1 + mu)) / mu
    if tangent < 1e-9:
        return tangent * np.sin(chi), np.full(TURN, np.pi / TURN)
    top = np.arcsinh(tangent)
    y, to_end = top * np.sin(chi), top * np.cos(chi) ** 2 / (1 + abs(np.sin(chi)))
    # tan θ − |sinh y| = 2 cosh((Y + |y|)/2) sinh((Y − |y|)/2)
    below = 2 * np.cosh((top + abs(y)) / 2) * np.sinh(to_end / 2)
    d_psi = np.cosh(y) * top * np.cos(chi) / np.sqrt(below * (tangent + abs(np.sinh(y))))
    return y, d_psi * np.pi / TURN


def ggx_slopes(x: np.ndarray) -> np.ndarray:
    """Density of slopes in units of α."""
    return 1 / (np.pi * (1 + x**2) ** 2)


def gauss_slopes(x: np.ndarray) -> np.ndarray:
    return np.exp(-(x**2)) / np.pi


def albedo(slopes: Profile, alpha: float, mu: float, share: Share) -> float:
    """∫ F D G/(4 μ μo) μo dωo = (1/μ) ∫ F G (cos θd/cos θh) P(slopes), share(cos θd, μo) = F G."""
    y, d_psi = (v[:, None] for v in _turn(mu))
    # from slopes of 1e-9 alpha to 1e-15 of the horizon
    u, rest, d_u = _logistic(np.log(alpha * mu) - 22, 36.0, 0.08)
    end = np.exp(-y)
    r = end * u
    q = 1 + r**2
    facing = 1 - r * np.sinh(y)
    cos_d = np.minimum(1, facing * mu / np.sqrt(q))
    mu_o = np.minimum(1, mu * end * rest * (np.exp(y) + r) / q)
    value = slopes(r / alpha) * r / alpha**2 * facing * share(cos_d, mu_o)
    return 2 * float(np.sum(value * end * d_u * d_psi))


def average(directional: Callable[[float], float]) -> float:
    """2 ∫ E(μ) μ dμ."""
    u, _, d_u = _logistic(-18.0, 36.0, 0.25)
    return 2 * float(sum(weight * mu * directional(mu) for mu, weight in zip(u.tolist(), d_u, strict=True)))
