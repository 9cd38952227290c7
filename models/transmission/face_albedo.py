"""What a rough face of a dielectric reflects at once, by the incidence: Gaussian slopes, correlated masking."""

import functools

import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Scalar
from gonio.models.fresnel import fresnel_dielectric
from gonio.models.geometry.directions import Direction
from gonio.models.microfacet.distributions import beckmann_cos_lambda

ALONG, ACROSS = 14, 3
"""Slopes in the plane of incidence, and on one side of it."""
STEEPEST = 4.0
"""Slopes, over α, that are counted."""


@functools.lru_cache
def _slopes() -> tuple[np.ndarray, ...]:
    """(nodes and weights on [−1, 1], slopes across the plane of incidence over α and their weights)."""
    x, w = np.polynomial.legendre.leggauss(ALONG)
    y, v = np.polynomial.hermite.hermgauss(2 * ACROSS)
    return x[:, None], w[:, None], y[None, ACROSS:], 2 * v[None, ACROSS:] / np.sqrt(np.pi)


def face_albedo(cosine: Scalar, alpha: Scalar, eta: Scalar) -> Scalar:
    """The directional albedo of `beckmann(alpha, eta)` at these cosines (n,): a mean over the facets that are seen."""
    x, w, y, v = (jnp.asarray(a, cosine.dtype)[None] for a in _slopes())
    z = cosine[:, None, None]
    sine = jnp.sqrt(jnp.maximum((1.0 - z) * (1.0 + z), 1e-12))
    last = jnp.minimum(z / (alpha * sine), STEEPEST)  # steeper ones are turned away
    t = 0.5 * ((last - STEEPEST) + (last + STEEPEST) * x)
    weight = w * v * jnp.exp(-(t**2)) * jnp.maximum(z - alpha * sine * t, 0.0)
    along, across = alpha * t, alpha * y
    up = 1.0 / jnp.sqrt(1.0 + along**2 + across**2)
    towards = jnp.maximum((z - along * sine) * up, 1e-9)
    out = Direction(-sine - 2.0 * towards * along * up, 2.0 * towards * across * up, 2.0 * towards * up - z)
    above = jnp.maximum(out.z, 1e-9)
    masked_i = beckmann_cos_lambda(Direction(sine, jnp.zeros_like(z), z), alpha, alpha) / z
    masked_o = beckmann_cos_lambda(Direction(out.x, out.y, above), alpha, alpha) / above
    kept = jnp.where(out.z > 0.0, (1.0 + masked_i) / (1.0 + masked_i + masked_o), 0.0)
    total = jnp.sum(weight * fresnel_dielectric(towards, eta) * kept, (1, 2))
    return total / jnp.sum(weight, (1, 2))
