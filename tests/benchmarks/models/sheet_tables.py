"""Makes models/transmission/rough_faces.npz, what a rough face makes of light that meets it, in a minute.

    python tests/benchmarks/models/sheet_tables.py

Facets are those of rays traced through a sheet [Walter 2007]: visible ones with Gaussian slopes, Fresnel's reflectance
at each, masking of what leaves one; what a facet sends to the wrong side is lost. Azimuths do not matter to what a
sheet reflects and transmits in all, so that light inside goes by its cosine alone. A function of that is a polynomial
on either side of the critical angle, by its values at nodes (`nodes`). Rows of the table are light that meets the face,
from the inside at all nodes, then from outside at those with cosines there; columns are the weights of the nodes in
what is inside next (mirrored, or let in), and last what leaves, or what `beckmann` reflects of light from outside.
Chebyshev coefficients of ln(1 + α/0.005) and ln √(η² − 1).
"""

import pathlib
import sys

import numpy as np
from scipy.special import erf

ALPHA_LEAST, ALPHA_MOST = 4e-3, 0.5
ETA_LEAST, ETA_MOST = 1.01, 4.0
NARROW = 0.005
INSIDE, OUTSIDE = 6, 11
"""Degrees of the polynomials beyond the critical angle, and before it."""
WIDTHS, INDICES = 12, 10
QUANTUM = 1e-7
ALONG, ACROSS = 160, 12
REACH = 4.5


def lobatto(degree: int) -> np.ndarray:
    """Points of [0, 1], both ends among them."""
    return (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2


def variable(v: np.ndarray, alpha: float) -> np.ndarray:
    """Of the polynomials before the critical angle, by the cosine outside: fine where the face hides itself."""
    c = 2 * alpha + 0.04
    return v * (1 + c) / (v + c)


def nodes(alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """(ψ of the nodes beyond the critical angle, in quarter turns, from 1 to 0; cosines outside of the others)."""
    c, t = 2 * alpha + 0.04, lobatto(OUTSIDE)
    return lobatto(INSIDE)[:0:-1], c * t / (c + 1 - t)


def cosines(eta: float, alpha: float) -> np.ndarray:
    """Of the nodes, inside: √(η² − 1) cosψ/η beyond the critical angle, √(η² − 1 + v²)/η before it."""
    psi, v = nodes(alpha)
    excess = (eta - 1) * (eta + 1)
    return np.r_[np.sqrt(excess) * np.cos(np.pi / 2 * psi), np.sqrt(excess + v**2)] / eta


def lagrange(points: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Values at x of the polynomials that are 1 at one point and 0 at the others, last axis."""
    weights = np.array([1 / np.prod(p - np.delete(points, k)) for k, p in enumerate(points)])
    d = x[..., None] - points
    near = np.abs(d) < 1e-13
    d = np.where(near, 1e-13, d)
    values = weights / d
    return values / values.sum(-1, keepdims=True)


def weights_of(cosine: np.ndarray, eta: float, alpha: float) -> np.ndarray:
    """Weights of the nodes in the value at these cosines inside."""
    excess = (eta - 1) * (eta + 1)
    q = (eta * cosine) ** 2 - excess
    psi = np.arccos(np.clip(eta * cosine / np.sqrt(excess), 0, 1)) * 2 / np.pi
    before = lagrange(lobatto(OUTSIDE), variable(np.sqrt(np.clip(q, 0, 1)), alpha))
    beyond = lagrange(lobatto(INSIDE), psi)
    before, beyond = before * (q > 0)[..., None], beyond * (q <= 0)[..., None]
    out = np.zeros((*cosine.shape, INSIDE + OUTSIDE + 1))
    out[..., INSIDE:] += before
    out[..., : INSIDE + 1] += beyond[..., ::-1]
    return out


def masking(sine: np.ndarray, cosine: np.ndarray, alpha: float) -> np.ndarray:
    """Smith's G1 of Gaussian slopes; 0 below the horizon."""
    a = np.maximum(cosine, 1e-300) / (alpha * np.maximum(sine, 1e-300))
    a = np.minimum(a, 26.0)
    g = 1 / (0.5 + erf(a) / 2 + np.exp(-(a**2)) / (2 * np.sqrt(np.pi) * np.maximum(a, 1e-300)))
    return np.where(cosine > 0, g, 0.0)


def met(cosine: np.ndarray, alpha: float, ratio: float) -> tuple[np.ndarray, ...]:
    """(cosine mirrored, its weight, cosine refracted, its weight, weight mirrored with correlated masking).

    Of light that meets a face towards a medium of relative index 1/ratio, shapes (cosine, slopes).
    """
    x, wx = np.polynomial.legendre.leggauss(ALONG)
    y, wy = np.polynomial.hermite.hermgauss(2 * ACROSS)
    y, wy = y[ACROSS:], 2 * wy[ACROSS:] / np.sqrt(np.pi)
    c, s = cosine[:, None, None], np.sqrt(np.maximum(1 - cosine**2, 0))[:, None, None]
    steepest = np.minimum(c / (alpha * np.maximum(s, 1e-300)), REACH)
    t = 0.5 * (steepest - REACH) + 0.5 * (steepest + REACH) * x[:, None]
    weight = wx[:, None] * wy * np.exp(-(t**2)) * np.maximum(c - alpha * s * t, 0)
    weight = weight / weight.sum((1, 2), keepdims=True)
    along, across = alpha * t, alpha * y
    up = 1 / np.sqrt(1 + along**2 + across**2)
    cos_i = np.maximum((c - along * s) * up, 0)
    cos2 = 1 - ratio**2 * (1 - cos_i**2)
    cos_t = np.sqrt(np.maximum(cos2, 0))
    r_s = (ratio * cos_i - cos_t) / np.maximum(ratio * cos_i + cos_t, 1e-300)
    r_p = (cos_i - ratio * cos_t) / np.maximum(cos_i + ratio * cos_t, 1e-300)
    mirrored = np.where(cos2 > 0, (r_s**2 + r_p**2) / 2, 1.0)
    out = []
    for side, turn in ((-1.0, 2 * cos_i), (-ratio, ratio * cos_i - cos_t)):
        z = side * c + turn * up
        out.append((np.hypot(side * s - turn * along * up, turn * across * up), z if side == -1.0 else -z))
    (sine, z), (sine_t, z_t) = out
    g_i, g_o = masking(s, c, alpha), masking(sine, z, alpha)
    correlated = mirrored * np.where(z > 0, g_o / np.maximum(g_o + g_i * (1 - g_o), 1e-300), 0.0)
    mirrored, passed = mirrored * g_o, (1 - mirrored) * masking(sine_t, z_t, alpha)
    parts = np.abs(z), mirrored * weight, np.abs(z_t), passed * weight, correlated * weight
    return tuple(np.broadcast_to(a, weight.shape).reshape(len(cosine), -1) for a in parts)


def rows(alpha: float, eta: float) -> np.ndarray:
    inner, v = cosines(eta, alpha), nodes(alpha)[1]
    z, w, _, passed, _ = met(inner, alpha, eta)
    back = np.einsum("jq,jqk->jk", w, weights_of(z, eta, alpha))
    _, _, z, w, at_once = met(v, alpha, 1 / eta)
    let_in = np.einsum("jq,jqk->jk", w, weights_of(z, eta, alpha))
    return np.block([[back, passed.sum(1)[:, None]], [let_in, at_once.sum(1)[:, None]]])


def chebyshev_points(n: int) -> tuple[np.ndarray, np.ndarray]:
    x = np.cos(np.pi * (np.arange(n) + 0.5) / n)
    return x, np.linalg.inv(np.polynomial.chebyshev.chebvander(x, n - 1))


def parameters(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(α, η) of coordinates in [−1, 1]."""
    low, high = (0.5 * np.log((e - 1) * (e + 1)) for e in (ETA_LEAST, ETA_MOST))
    first, last = np.log1p(np.array([ALPHA_LEAST, ALPHA_MOST]) / NARROW)
    alpha = NARROW * np.expm1(first + (x + 1) / 2 * (last - first))
    return alpha, np.sqrt(1 + np.exp(2 * (low + (y + 1) / 2 * (high - low))))


def table() -> np.ndarray:
    """Coefficients, shape (rows, columns, widths, indices)."""
    (x, to_x), (y, to_y) = chebyshev_points(WIDTHS), chebyshev_points(INDICES)
    alphas, etas = parameters(x, y)
    values = np.array([[rows(a, e) for e in etas] for a in alphas])
    return np.einsum("xa,ye,aeij->ijxy", to_x, to_y, values)


def main(path: str | None = None) -> None:
    kept = np.round(table() / QUANTUM).astype(np.int32)
    target = pathlib.Path(path) if path else pathlib.Path(__file__).parents[3] / "models/transmission/rough_faces.npz"
    np.savez_compressed(target, faces=kept)
    print(target, target.stat().st_size, "bytes")
    rng, errors = np.random.default_rng(0), []
    for _ in range(40):
        x, y = rng.uniform(-1, 1, 2)
        truth = rows(*parameters(x, y))
        bases = (np.polynomial.chebyshev.chebvander(c, n - 1)[0] for c, n in ((x, WIDTHS), (y, INDICES)))
        error = np.abs(np.einsum("ijae,a,e->ij", QUANTUM * kept, *bases) - truth)
        errors.append([np.sqrt(np.mean(error**2)), error.max()])
    print("errors at random α and η, rms and greatest, quantiles 50 90 100 %:")
    print(np.quantile(errors, [0.5, 0.9, 1], axis=0).T.round(5))


if __name__ == "__main__":
    main(*sys.argv[1:])
