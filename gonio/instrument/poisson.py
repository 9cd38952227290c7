"""Poisson counts, one for each key: the same key gives the same count in any batch."""

from typing import Any

import jax
import jax.numpy as jnp

State = tuple[Any, ...]
SEARCHED = 10.0
"""Below this expectation the count is found by searching the distribution; above it by rejection."""
SEARCH_END = 120
"""P(count ≥ 120) is below 1e-80 for an expectation of `SEARCHED`."""


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
