"""Power spectral densities of isotropic surfaces, and the rms height that a band of spatial frequencies holds.

S2(f) in µm⁴ of the frequency f in 1/µm, two-sided and two-dimensional: σ² = ∫ S2 2πf df over the band. Each form is a
pair: the density by f², and the variance below a frequency, in closed form.
"""

import math

import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Scalar
from gonio.models.errors import GonioError
from gonio.models.special.exprel import exprel


def abc_density(f2: Scalar, a: Scalar, b: Scalar, c: Scalar) -> Scalar:
    """A/(1 + B²f²)^(C/2), the ABC or K-correlation form [Church & Takacs 1991]."""
    return a * jnp.exp(-0.5 * c * jnp.log1p(b * b * f2))


def abc_variance(f: Scalar, a: Scalar, b: Scalar, c: Scalar) -> Scalar:
    """(2πA/(B²(C−2)))[1 − (1+B²f²)^(−(C−2)/2)], and its limit at C = 2."""
    octaves = jnp.log1p((b * f) ** 2)
    return jnp.pi * a / b**2 * octaves * exprel((1.0 - 0.5 * c) * octaves)


def gaussian_density(f2: Scalar, sigma: Scalar, tau: Scalar) -> Scalar:
    """πσ²τ² exp(−(πτf)²), of the autocorrelation σ² exp(−r²/τ²)."""
    return jnp.pi * (sigma * tau) ** 2 * jnp.exp(-((jnp.pi * tau) ** 2) * f2)


def gaussian_variance(f: Scalar, sigma: Scalar, tau: Scalar) -> Scalar:
    """σ²(1 − exp(−(πτf)²))."""
    return -(sigma**2) * jnp.expm1(-((jnp.pi * tau * f) ** 2))


def fractal_density(f2: Scalar, strength: Scalar, power: Scalar, lowest: Scalar) -> Scalar:
    """K f^(−p) from the frequency `lowest` on, and below it the value there."""
    return strength * jnp.exp(-0.5 * power * jnp.log(jnp.maximum(f2, lowest**2)))


def fractal_variance(f: Scalar, strength: Scalar, power: Scalar, lowest: Scalar) -> Scalar:
    """πK f_low^(−p) f² up to the lowest frequency, and 2πK ∫ f^(1−p) df beyond it."""
    return strength * _power_law_variance(f, lowest, power, 1.0) * lowest**-power


def _power_law_variance(f: Scalar, lowest: Scalar, power: Scalar, level: Scalar) -> Scalar:
    core = jnp.minimum(f, lowest)
    octaves = jnp.log(jnp.maximum(f / lowest, 1.0))
    return jnp.pi * level * (core**2 + 2.0 * lowest**2 * octaves * exprel((2.0 - power) * octaves))


class TabulatedSpectrum:
    """A measured spectrum: powers of f between its points, level below the first, its last power beyond the last."""

    def __init__(self, text: str) -> None:
        """Reads `text`, pairs "f:S2" with blanks between them, in 1/µm and µm⁴.

        Raises:
            GonioError: for anything else, fewer than two pairs, or frequencies that do not increase.
        """
        try:
            pairs = np.array([[float(x) for x in pair.split(":")] for pair in text.split()])
            good = pairs.ndim == 2 and pairs.shape[1] == 2 and len(pairs) > 1 and bool(np.isfinite(pairs).all())
        except ValueError:
            good = False
        if not good or bool(np.any(pairs <= 0) or np.any(np.diff(pairs[:, 0]) <= 0)):
            raise GonioError(
                f"a tabulated spectrum is pairs of a frequency, 1/µm, and a density, µm⁴, both above 0 and the"
                f' frequencies increasing, as in psd="0.001:1e3 0.1:0.2 1:1e-5"; "{text}" came'
            )
        self.log_f, self.log_s = np.log(pairs).T
        self.powers = -np.diff(self.log_s) / np.diff(self.log_f)
        self.beyond = max(float(self.powers[-1]), 0.0)

    @property
    def lowest(self) -> float:
        """The first frequency, 1/µm."""
        return math.exp(self.log_f[0])

    @property
    def mean_power(self) -> float:
        """The power of f with which the density falls from the first to the last point, at least 0."""
        return max(0.0, float(-np.ptp(self.log_s[[0, -1]]) / (self.log_f[0] - self.log_f[-1])))

    def density(self, f2: Scalar) -> Scalar:
        """S2 at f²."""
        nodes, values = (jnp.asarray(a, f2.dtype) for a in (self.log_f, self.log_s))
        log_f = 0.5 * jnp.log(jnp.maximum(f2, math.exp(2 * self.log_f[0])))
        shape, flat = jnp.shape(log_f), jnp.ravel(log_f)
        inside = jnp.reshape(jnp.interp(flat, nodes, values), shape)
        return jnp.exp(inside - self.beyond * jnp.maximum(log_f - nodes[-1], 0.0))

    def variance(self, f: Scalar) -> Scalar:
        """σ² below a frequency, µm²."""
        points = list(zip(np.exp(self.log_f), np.exp(self.log_s), [*self.powers, self.beyond], strict=True))
        total = jnp.pi * points[0][1] * jnp.minimum(f, points[0][0]) ** 2
        ends = [low for low, _, _ in points[1:]] + [math.inf]
        for (low, level, power), end in zip(points, ends, strict=True):
            whole = _power_law_variance(jnp.minimum(f, end), low, power, level)
            total = total + whole - jnp.pi * level * jnp.minimum(f, low) ** 2
        return total


def rms_slope(frequencies: np.ndarray, density: np.ndarray) -> np.ndarray:
    """√∫ (2πf)² S2 2πf df by the trapezoidal rule in ln f; `frequencies` (n,), `density` (n, channels)."""
    integrand = (2 * np.pi * frequencies**2)[:, None] ** 2 * density * 2 * np.pi
    return np.sqrt(np.trapezoid(integrand, np.log(frequencies), axis=0))


def half_open_band(low: float, high: float) -> tuple[float, float]:
    """A band of frequencies, 1/µm, checked: 0 ≤ low < high."""
    if not 0 <= low < high < math.inf:
        raise GonioError(f"a band is two frequencies in 1/µm, 0 or more and increasing; {low:g} to {high:g} came")
    return low, high
