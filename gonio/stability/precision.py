"""The floating-point types of the atlas, and models cast to them."""

import jax
import jax.numpy as jnp
import numpy as np

PRECISIONS = {"float64": np.float64, "float32": np.float32}


def cast(brdf, dtype):
    """The model with its numbers in another precision."""
    return jax.tree.map(lambda a: jnp.asarray(a, dtype), brdf)
