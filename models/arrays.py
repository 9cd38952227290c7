"""The shapes of the arrays that models take and give."""

from typing import Any

from jaxtyping import Array, Float

Scalar = Float[Any, "..."]
"""A number, of JAX or of NumPy: shape () in a formula, any shape where functions broadcast."""

Channels = Float[Array, "*channel"]
"""One number, or one for each channel: shape () or (channels,)."""
