"""Normal equations of a fit: sums over all residuals and their derivatives."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gonio.fitting.problem.arrow import Arrow, joined
from gonio.fitting.problem.parameterisation import Parameterisation


class NormalEquations(NamedTuple):
    """Sums over all residuals r with the rows J of their Jacobian by the parameters; any leading axes.

    The parameters are in the order of the arrow, see `Parameterisation.order`.
    """

    cost: Float[np.ndarray, "*s"]  # ½ Σ r²
    gradient: Float[np.ndarray, "*s p"]  # Jᵀ r
    matrix: Arrow  # JᵀJ


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Normal equations, score covariance Jᵀ diag(r²) J or None, model values (n, C), perhaps deferred."""

    equations: NormalEquations
    scores: Arrow | None
    f: Any


def summed_pairs(s: Parameterisation, pairs: Float[np.ndarray, "S C pairs"]) -> NormalEquations:
    """The normal equations over all free numbers, from each product of two of a channel's rows once.

    The pairs of rows, residual and derivatives, are in the order of `combinations_with_replacement`.
    """
    total, places, (shared, q) = pairs.sum(axis=1), s.places_of_pairs, (s.sizes.shared, s.sizes.per_channel)
    number, channels = pairs.shape[:2]
    gradient = total.take(places.gradient, axis=1)
    if q:
        each = pairs.take(places.each, axis=2).reshape(number, channels * q)
        gradient = np.concatenate([gradient, each], axis=1)
    matrix = Arrow(
        total.take(places.corner, axis=1).reshape(number, shared, shared),
        pairs.take(places.border, axis=2).reshape(number, channels, shared, q),
        pairs.take(places.blocks, axis=2).reshape(number, channels, q, q),
    )
    return NormalEquations(0.5 * total[:, 0], gradient, matrix)


def summed(s: Parameterisation, squares: Float[np.ndarray, "S C g g"]) -> NormalEquations:
    """The normal equations over all free numbers, from channel-wise products of residuals and derivatives."""
    total, (shared, each) = squares.sum(axis=1), s.kinds
    gradient = np.asarray(joined(total[:, 0, shared], squares[:, :, 0, each]))
    border, blocks = (squares[:, :, rows[:, None], each] for rows in (shared, each))
    matrix = Arrow(total[:, shared[:, None], shared], border, blocks)
    return NormalEquations(0.5 * total[:, 0, 0], gradient, matrix)
