"""The light that a model sends into the hemisphere, in the directions of its own lobe maps."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.albedo import panel_rule, sums_by_loops
from gonio.models.arrays import Channels, Scalar
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction
from gonio.models.kept_jit import kept_jit

ORDER, FAST = 32, 16
"""Of the rules by which a model's light is shared out among the readings, and summed."""
PART = 8 * FAST**2
NOISE = 2.0 * 1.22
"""Standard uncertainties of a reading that a difference of two may be without being structure."""


@kept_jit
def _samples(term: AbstractBRDF, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Channels]:
    def one(a: Scalar, b: Scalar) -> tuple[Direction, Channels]:
        wo, jacobian = term.lobe_map(wi, a, b)
        return wo, term.f(wi, wo) * (jnp.maximum(wo.z, 0.0) * jacobian)

    return jax.vmap(one)(u1, u2)


def light_of(brdf: AbstractBRDF, wi: Direction, order: int) -> Iterator[tuple[Direction, np.ndarray]]:
    """Directions (n,) in which each term sends light from wi, and how much of it (n, C or 1)."""
    u1, u2, weight = panel_rule(order)
    for term in brdf.terms():
        # In parts of one size: one program for all rules.
        parts = [_samples(term, wi, u1[k : k + PART], u2[k : k + PART]) for k in range(0, u1.size, PART)]
        wo = Direction(*(np.concatenate([np.asarray(w[k]) for w, _ in parts]) for k in range(3)))
        yield wo, np.concatenate([np.asarray(a).reshape(PART, -1) for _, a in parts]) * weight[:, None]


def albedos_at(brdf: AbstractBRDF, wi: Direction, order: int, channels: int) -> np.ndarray:
    """Directional albedos (n, C) of a model at directions of the light (n,), by a rule of one order."""
    total, count = np.zeros((wi.z.size, channels)), wi.z.size
    for term in brdf.terms():
        sums = sums_by_loops(term, 1.0, wi, order)
        if sums is None:
            each = (Direction(*(jnp.asarray(c[k]) for c in wi)) for k in range(count))
            total += np.stack([sum(a.sum(axis=0) for _, a in light_of(term, w, order)) for w in each])
        else:
            total += sums[0].reshape(count, -1)
    return total
