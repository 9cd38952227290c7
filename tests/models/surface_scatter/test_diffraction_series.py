"""The sum over orders of diffraction: mpmath term by term, its limits, the seam between its two ways."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.surface_scatter.diffraction_series import lambert_w, wave_series

value = jax.jit(jax.vmap(wave_series))
slopes = jax.jit(jax.vmap(jax.grad(wave_series, (0, 1))))


def exact(mp, g, b):
    """Σ e^(−g) g^(m−1)/(m! m) e^(−b/m), over the orders within 14 widths of the greatest term."""
    g, b = mp.mpf(g), mp.mpf(b)
    middle = float(g * mp.exp(mp.lambertw(2 * b / g**2) / 2))
    width = max(middle, 1.0) ** 0.5
    first = max(1, int(middle - 14 * width))
    term = mp.exp(-g + (first - 1) * mp.log(g) - mp.loggamma(first + 1))
    total = mp.mpf(0)
    for m in range(first, int(middle + 20 * width + 60)):
        total += term / m * mp.exp(-b / m)
        term *= g / (m + 1)
    return total


def test_against_mpmath():
    mp = pytest.importorskip("mpmath")
    cases = [(g, b) for g in (1e-12, 1e-3, 1.0, 17.0, 47.9, 48.1, 80.0, 1e3) for b in (0.0, 1.0, 60.0, 2e3)]
    g, b = (jnp.asarray(a) for a in zip(*cases, strict=True))
    with mp.workdps(40):
        expected = np.array([float(exact(mp, *case)) for case in cases])
        h = mp.mpf("1e-12")
        by_g = [float((exact(mp, x + x * h, y) - exact(mp, x - x * h, y)) / (2 * x * h)) for x, y in cases[1::4]]
    np.testing.assert_allclose(value(g, b), expected, rtol=3e-14)
    np.testing.assert_allclose(slopes(g, b)[0][1::4], by_g, rtol=1e-13)
    single = value(g.astype(jnp.float32), b.astype(jnp.float32))
    seen = expected > 1e-30
    np.testing.assert_allclose(np.asarray(single)[seen], expected[seen], rtol=2e-5)


def test_limits():
    b = jnp.asarray([0.0, 3.0, 20.0])
    np.testing.assert_allclose(value(jnp.zeros(3), b), np.exp(-b), rtol=1e-14)
    g = 1e6
    np.testing.assert_allclose(value(jnp.full(3, g), b * g), np.exp(-b) / g**2, rtol=1e-3)
    assert all(np.all(np.isfinite(s)) for s in slopes(jnp.asarray([0.0, 0.0, 1e7]), jnp.asarray([0.0, 1e6, 1e8])))


def test_w_solves_its_equation():
    w = lambert_w(jnp.asarray([-50.0, -1.0, 0.0, 1.0, 10.0, 700.0]))
    np.testing.assert_allclose(w + jnp.log(w), [-50.0, -1.0, 0.0, 1.0, 10.0, 700.0], rtol=1e-14, atol=1e-14)
