"""The shapes of the arrays that models take and give."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxtyping import Array, Float

    Scalar = Float[Any, "..."]
    """A number, of JAX or of NumPy: shape () in a formula, any shape where functions broadcast."""

    Channels = Float[Array, "*channel"]
    """One number, or one for each channel: shape () or (channels,)."""
else:
    # Words for readers and type checkers: what computes with NumPy alone does not wait for JAX.
    Scalar = Channels = Any
