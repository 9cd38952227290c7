"""Cosines that laws with negative powers of them may take."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, "..."]


def floored(mu: Scalar) -> Scalar:
    """μ, but at least tiny^(1/5) of its precision: 3e-8 in single, 5e-62 in double precision.

    Three reciprocal cosines and their gradients then stay finite. In single precision the floor is below the rounding
    of a cosine near grazing, so that nothing is lost that was known.
    """
    return jnp.maximum(mu, float(jnp.finfo(jnp.result_type(mu)).tiny) ** 0.2)
