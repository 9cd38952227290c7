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
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gonio.instrument.instrument import Instrument
from gonio.models.kept_jit import kept_jit

BATCH = 1 << 14
"""Readings drawn in one call: one compiled program serves any number."""
STREAM = 0x6E6F
State = tuple[Any, ...]
SEARCHED = 10.0
"""Below this expectation the count is found by searching the distribution; above it by rejection."""
SEARCH_END = 120
"""P(count ≥ 120) is below 1e-80 for an expectation of `SEARCHED`."""
MANY_READINGS = 10_000
"""Readings without a count that tell no less than one count among them: fewer counts are expected of none of them.

The law itself states 1e-153 where 1e-306 counts are expected, and one such reading outweighs all others. One count of
each reading would be too much: of readings of 0.06 counts each uncertainties of fits would be four times too large.
"""


def standard_uncertainty(
    instrument: Instrument,
    expected: np.ndarray,
    irradiance: np.ndarray,
    gain: float = 1.0,
    exposure: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Standard uncertainty, 1/sr, of readings whose expectation is `expected`, 1/sr; 0 for an ideal instrument.

    Shapes: `expected` (n, channels), `irradiance` (n,) relative to normal incidence, `exposure` (n,): the counting
    times over the instrument's own. It is the standard deviation of the law above, exactly, down to what one count in
    `MANY_READINGS` would be; systematic errors are not in it.
    """
    variance = (instrument.noise * expected) ** 2
    if instrument.photons is not None:
        exposure = np.broadcast_to(exposure, irradiance.shape)[:, None]
        scale = instrument.photons * exposure * np.pi * irradiance[:, None] / gain
        signal = np.abs(expected) * scale * _mean_magnitude(instrument.noise)
        background = (instrument.ambient * instrument.photons + instrument.dark) * exposure
        counted = np.maximum(signal + 2 * background + 2 * instrument.read_noise**2, 1.0 / MANY_READINGS)
        variance = variance + counted / scale**2
    return np.sqrt(variance)


def variance_parts(instrument: Instrument, expected: np.ndarray, irradiance: np.ndarray) -> dict[str, np.ndarray]:
    """The variance of `standard_uncertainty` by its sources, each (n, channels): counting, background, readout, source.

    Arguments as there; all readings are counted for the instrument's own time, with a gain of 1.
    """
    parts = {"source": (instrument.noise * expected) ** 2}
    if instrument.photons is not None:
        scale = instrument.photons * np.pi * irradiance[:, None]
        ones = np.ones_like(expected)
        background = instrument.ambient * instrument.photons + instrument.dark
        parts["counting"] = np.abs(expected) * _mean_magnitude(instrument.noise) / scale
        parts["background"] = 2 * background / scale**2 * ones
        parts["readout"] = 2 * instrument.read_noise**2 / scale**2 * ones
    return parts


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
    exposure: np.ndarray | float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """(readings in 1/sr, whether the detector was full) of the cells from number `start` on: both (n, channels).

    Drawn from the seed by the number of the cell and its channel: how a table is cut into blocks changes no bit.
    `exposure` as in `standard_uncertainty`.
    """
    if not instrument.has_noise:
        return expected, np.zeros(expected.shape, bool)
    cells, channels = expected.shape
    number = np.arange(start * channels, (start + cells) * channels, dtype=np.uint64)
    low, high = (number & 0xFFFFFFFF).astype(np.uint32), (number >> 32).astype(np.uint32)
    exposures = np.broadcast_to(np.asarray(exposure, expected.dtype), (cells,))
    inputs = (low, high, expected.reshape(-1), *(np.repeat(a, channels) for a in (irradiance, exposures)))
    halves = np.asarray([seed & 0xFFFFFFFF, seed >> 32], np.uint32)
    photons = instrument.photons
    chain = np.asarray([
        instrument.noise,
        1.0 if photons is None else photons * math.pi / gain,
        0.0 if photons is None else instrument.ambient * photons + instrument.dark,
        instrument.read_noise,
        math.inf if instrument.saturation is None else instrument.saturation,
    ], jnp.result_type(float))  # fmt: skip
    readings, full = np.empty(number.size, expected.dtype), np.empty(number.size, bool)
    for first in range(0, number.size, BATCH):
        part = slice(first, min(first + BATCH, number.size))
        padded = tuple(np.pad(a[part], (0, BATCH - part.stop + first), mode="edge") for a in inputs)
        batch = _batch(photons is not None, halves, chain, padded)
        readings[part], full[part] = (np.asarray(values)[: part.stop - first] for values in batch)
    return readings.reshape(expected.shape), full.reshape(expected.shape)


@kept_jit
def _batch(counted: bool, seed: jax.Array, chain: jax.Array, inputs: State) -> tuple[jax.Array, jax.Array]:
    """(readings, whether the detector was full); `low` and `high` are the halves of the readings' numbers."""
    low, high, expected, irradiance, exposure = inputs
    noise, scale, background, read_noise, saturation = chain
    key = jax.random.fold_in(jax.random.key(seed[0], impl="threefry2x32"), seed[1])
    key = jax.random.fold_in(key, STREAM)
    keys = jax.vmap(lambda lo, hi: jax.random.fold_in(jax.random.fold_in(key, hi), lo))(low, high)
    streams = jax.vmap(lambda k: jax.vmap(functools.partial(jax.random.fold_in, k))(jnp.arange(4)))(keys)
    g = jax.vmap(lambda k: jax.random.normal(k, (3,)))(streams[:, 0])
    lit = expected * (1 + noise * g[:, 0])
    if not counted:
        return lit, jnp.zeros(lit.shape, bool)
    scale = scale * irradiance * exposure
    signal = lit * scale
    background = background * exposure
    # Both backgrounds in one call: to compile another takes a second.
    dark = poisson(streams[:, 2:].reshape(-1), jnp.repeat(background, 2)).reshape(-1, 2)
    on, off = jnp.sign(signal) * poisson(streams[:, 1], jnp.abs(signal)) + dark[:, 0], dark[:, 1]
    on, off = (count + read_noise * g[:, k] for k, count in ((1, on), (2, off)))
    return (on - off) / scale, jnp.maximum(on, off) >= saturation


def poisson(keys: jax.Array, expected: jax.Array) -> jax.Array:
    """Counts, as floating-point numbers, of expectation `expected` ≥ 0: one for each key, shapes (n,).

    Inversion below `SEARCHED` and transformed rejection above it [Hörmann 1993, algorithm PTRS], with the
    probabilities by Loader's saddle-point form [Loader 2000], which keeps its digits at any expectation and in
    single precision; `jax.random.poisson` loses them there in k log λ − λ − log k!. A count beyond 2^24
    (float32) or 2^53 (float64) is rounded to what the format can hold. Expectations that are not finite give 0.
    """
    expected = jnp.where(jnp.isfinite(expected) & (expected > 0), expected, 0.0)
    few = expected < SEARCHED
    searched = _search(keys, jnp.where(few, expected, 1.0))
    return jnp.where(few, searched, _reject(keys, jnp.where(few, SEARCHED, expected), few))


def _uniform(keys: jax.Array, number: jax.Array | int, count: int) -> jax.Array:
    draw = jax.vmap(lambda key: jax.random.uniform(jax.random.fold_in(key, number), (count,)))
    return draw(keys).T


def _search(keys: jax.Array, expected: jax.Array) -> jax.Array:
    """Inversion of the distribution."""
    (u,) = _uniform(keys, 0, 1)

    def step(state: State) -> State:
        k, count, probability, below = state
        below = below + probability
        higher = u >= below
        return k + 1, count + higher, probability * expected / (k + 1.0), below

    def going(state: State) -> jax.Array:
        k, count, *_ = state
        return (k < SEARCH_END) & jnp.any(count == k)

    zero = jnp.zeros_like(expected)
    return jax.lax.while_loop(going, step, (0, zero, jnp.exp(-expected), zero))[1]


def _reject(keys: jax.Array, expected: jax.Array, done: jax.Array) -> jax.Array:
    """Transformed rejection; nothing is done where `done`."""
    b = 0.931 + 2.53 * jnp.sqrt(expected)
    a = -0.059 + 0.02483 * b
    inverse_alpha = 1.1239 + 1.1328 / (b - 3.4)
    v_r = 0.9277 - 3.6224 / (b - 2.0)

    def step(state: State) -> State:
        attempt, done, count = state
        u, v = _uniform(keys, attempt, 2)
        u = u - 0.5
        u_s = 0.5 - jnp.abs(u)
        inside = u_s > 0
        u_s = jnp.where(inside, u_s, 0.5)
        k = jnp.floor((2.0 * a / u_s + b) * u + expected + 0.43)
        squeezed = (u_s >= 0.07) & (v <= v_r)
        hopeless = (k < 0) | ((u_s < 0.013) & (v > u_s))
        density = jnp.log(jnp.maximum(v, 1e-30) * inverse_alpha / (a / u_s**2 + b))
        taken = inside & (squeezed | (~hopeless & (density <= log_probability(jnp.maximum(k, 0.0), expected))))
        return attempt + 1, done | taken, jnp.where(done, count, k)

    def going(state: State) -> jax.Array:
        return ~jnp.all(state[1])

    return jax.lax.while_loop(going, step, (1, done, jnp.zeros_like(expected)))[2]


def log_probability(k: jax.Array, expected: jax.Array) -> jax.Array:
    """log of the probability of the count k where `expected` (≥ `SEARCHED`) is expected [Loader 2000]."""
    safe = jnp.maximum(k, 1.0)
    t = (safe - expected) / expected
    series = t * t * (1 / 2 - t * (1 / 6 - t * (1 / 12 - t * (1 / 20 - t * (1 / 30 - t / 42)))))
    small = jnp.abs(t) < 0.02
    exact = (1 + t) * jnp.log1p(t) - t
    deviance = expected * jnp.where(small, series, exact)
    inverse = 1.0 / safe
    stirling = inverse * (1 / 12 - inverse**2 * (1 / 360 - inverse**2 / 1260))
    value = -deviance - stirling - 0.5 * jnp.log(2 * jnp.pi * safe)
    return jnp.where(k >= 1, value, -expected)
