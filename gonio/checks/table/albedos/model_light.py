"""The light that a model sends into the hemisphere, in the directions of its own lobe maps."""

from collections.abc import Iterator
from typing import NamedTuple

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


class LobeSamples(NamedTuple):
    """Directions (n,) in which a term sends light, how much of it, and f of the term there, (n, C or 1) each."""

    wo: Direction
    light: np.ndarray
    f: np.ndarray


@kept_jit
def _samples(term: AbstractBRDF, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Channels, Channels]:
    def one(a: Scalar, b: Scalar) -> tuple[Direction, Channels, Channels]:
        wo, jacobian = term.lobe_map(wi, a, b)
        f = term.f(wi, wo)
        return wo, f * (jnp.maximum(wo.z, 0.0) * jacobian), f

    return jax.vmap(one)(u1, u2)


def lobe_samples(term: AbstractBRDF, wi: Direction, order: int) -> LobeSamples:
    """The light that a term with a lobe map sends from wi, by a rule of an order."""
    u1, u2, weight = panel_rule(order)
    # In parts of one size: one program for all rules.
    parts = [_samples(term, wi, u1[k : k + PART], u2[k : k + PART]) for k in range(0, u1.size, PART)]
    wo = Direction(*(np.concatenate([np.asarray(w[k]) for w, _, _ in parts]) for k in range(3)))
    light, f = (np.concatenate([np.asarray(p[k]).reshape(PART, -1) for p in parts]) for k in (1, 2))
    return LobeSamples(wo, light * weight[:, None], f)


def light_of(brdf: AbstractBRDF, wi: Direction, order: int) -> Iterator[tuple[Direction, np.ndarray]]:
    """Directions (n,) in which each term sends light from wi, and how much of it (n, C or 1)."""
    for term in brdf.terms():
        wo, light, _ = lobe_samples(term, wi, order)
        yield wo, light


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
