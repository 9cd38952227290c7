"""The signal chain: from the reading that is expected to the reading that is made, and its uncertainty.

One reading counts twice: with the source on (signal S, ambient light and dark counts B) and with it off (B).

    on  = Poisson(S·(1 + noise·g₁)) + Poisson(B) + read_noise·g₂
    off = Poisson(B) + read_noise·g₃
    f   = gain·(on − off)/(photons·π·irradiance),   S = photons·π·irradiance·f_expected/gain

`irradiance` is relative to that at normal incidence: cosθi for a point source. A negative S (tables may hold negative
values) counts down: −Poisson(|S|).
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np

from gonio.instrument.instrument import Instrument
from gonio.instrument.poisson import poisson

BATCH = 1 << 16
"""Readings drawn in one call: one compiled program serves any number."""
STREAM = 0x6E6F


def standard_uncertainty(
    instrument: Instrument, expected: np.ndarray, irradiance: np.ndarray, gain: float = 1.0
) -> np.ndarray:
    """Standard uncertainty, 1/sr, of readings whose expectation is `expected`, 1/sr; 0 for an ideal instrument.

    Shapes: `expected` (n, channels), `irradiance` (n,) relative to normal incidence. It is the standard deviation of
    the law above, exactly; systematic errors are not in it.
    """
    variance = (instrument.noise * expected) ** 2
    if instrument.photons is not None:
        scale = instrument.photons * np.pi * irradiance[:, None] / gain
        signal = np.abs(expected) * scale * _mean_magnitude(instrument.noise)
        background = instrument.ambient * instrument.photons + instrument.dark
        variance = variance + (signal + 2 * background + 2 * instrument.read_noise**2) / scale**2
    return np.sqrt(variance)


def _mean_magnitude(sd: float) -> float:
    """E|1 + sd·g| for a standard normal g: a source so noisy that it turns negative still counts."""
    if sd == 0:
        return 1.0
    return sd * math.sqrt(2 / math.pi) * math.exp(-0.5 / sd**2) + math.erf(1 / (sd * math.sqrt(2)))


def read(
    instrument: Instrument,
    seed: int,
    start: int,
    expected: np.ndarray,
    irradiance: np.ndarray,
    gain: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """(readings in 1/sr, whether the detector was full) of the cells from number `start` on: both (n, channels).

    Drawn from the seed by the number of the cell and its channel: how a table is cut into blocks changes no bit.
    """
    if not instrument.has_noise:
        return expected, np.zeros(expected.shape, bool)
    cells, channels = expected.shape
    number = np.arange(start * channels, (start + cells) * channels, dtype=np.uint64)
    low, high = (number & 0xFFFFFFFF).astype(np.uint32), (number >> 32).astype(np.uint32)
    inputs = (low, high, expected.reshape(-1), np.repeat(irradiance, channels))
    key = jax.random.fold_in(jax.random.key(seed & 0xFFFFFFFF, impl="threefry2x32"), seed >> 32)
    key = jax.random.fold_in(key, STREAM)
    photons = instrument.photons
    chain = jnp.asarray([
        instrument.noise,
        1.0 if photons is None else photons * math.pi / gain,
        0.0 if photons is None else instrument.ambient * photons + instrument.dark,
        instrument.read_noise,
        math.inf if instrument.saturation is None else instrument.saturation,
    ])  # fmt: skip
    readings, full = np.empty(number.size, expected.dtype), np.empty(number.size, bool)
    for first in range(0, number.size, BATCH):
        part = slice(first, min(first + BATCH, number.size))
        padded = (np.pad(a[part], (0, BATCH - part.stop + first), mode="edge") for a in inputs)
        batch = _batch(photons is not None, key, chain, *padded)
        for whole, values in zip((readings, full), batch, strict=True):
            whole[part] = np.asarray(values)[: part.stop - first]
    return readings.reshape(expected.shape), full.reshape(expected.shape)


@functools.partial(jax.jit, static_argnums=0)
def _batch(
    counted: bool,
    key: jax.Array,
    chain: jax.Array,
    low: jax.Array,
    high: jax.Array,
    expected: jax.Array,
    irradiance: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """(readings, whether the detector was full); `low` and `high` are the halves of the readings' numbers."""
    noise, scale, background, read_noise, saturation = chain
    keys = jax.vmap(lambda lo, hi: jax.random.fold_in(jax.random.fold_in(key, hi), lo))(low, high)
    streams = jax.vmap(lambda k: jax.vmap(functools.partial(jax.random.fold_in, k))(jnp.arange(4)))(keys)
    g = jax.vmap(lambda k: jax.random.normal(k, (3,)))(streams[:, 0])
    lit = expected * (1 + noise * g[:, 0])
    if not counted:
        return lit, jnp.zeros(lit.shape, bool)
    scale = scale * irradiance
    signal = lit * scale
    background = jnp.broadcast_to(background, lit.shape)
    on = jnp.sign(signal) * poisson(streams[:, 1], jnp.abs(signal)) + poisson(streams[:, 2], background)
    off = poisson(streams[:, 3], background)
    on, off = (count + read_noise * g[:, k] for k, count in ((1, on), (2, off)))
    return (on - off) / scale, jnp.maximum(on, off) >= saturation
