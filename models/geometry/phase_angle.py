"""The phase angle g between the directions of light and detector, by |wi − wo| and |wi + wo| instead of its cosine."""

from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction, add, norm


class PhaseChords(NamedTuple):
    """2 sin(g/2) and 2 cos(g/2): neither loses digits where the other is nearly 2."""

    apart: Scalar
    together: Scalar


def phase_chords(wi: Direction, wo: Direction) -> PhaseChords:
    """The chords of two unit vectors; their gradients are 0 at the tip of each cone."""
    return PhaseChords(norm(Direction(wi.x - wo.x, wi.y - wo.y, wi.z - wo.z)), norm(add(wi, wo)))


def henyey_greenstein(chord: Scalar, g_1: Scalar) -> Scalar:
    """(1 − g₁²)/((1 − g₁)² + g₁ chord²)^1.5 for g₁ in [0, 1): the peak is where the chord is 0; mean 1 over the sphere.

    [Henyey & Greenstein 1941], 1 − 2g₁ cosΘ + g₁² with cosΘ = 1 − chord²/2.
    """
    d = (1.0 - g_1) ** 2 + g_1 * chord**2
    return (1.0 - g_1) * (1.0 + g_1) / (d * jnp.sqrt(d))
