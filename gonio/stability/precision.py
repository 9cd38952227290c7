"""The floating-point types of the atlas, and models and directions cast to them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction

PRECISIONS: dict[str, Any] = {"float64": np.float64, "float32": np.float32}


def cast(brdf: AbstractBRDF, dtype: Any) -> AbstractBRDF:
    """The model with its numbers in another precision."""
    return jax.tree.map(lambda a: jnp.asarray(a, dtype), brdf)


def cast_directions(vectors: np.ndarray, dtype: Any) -> Direction:
    """Unit vectors (..., 3) as components in a precision."""
    return Direction(*(jnp.asarray(c, dtype) for c in np.moveaxis(vectors, -1, 0)))
