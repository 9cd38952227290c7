"""Where pairs of directions are: their angles, and the regions of polar angles and azimuth difference around them."""

from typing import NamedTuple

import numpy as np

from gonio.data.angles import SLACK
from gonio.data.layouts import Layout, spherical_angles
from gonio.models.geometry.directions import Direction

BAND, SECTOR = 10.0, 30.0
"""Size of a region of pairs, degrees: of both polar angles, and of the azimuth difference."""
SIDE = int(180 // BAND)
SAME_POLAR = 1e-6
"""Difference, radians, of polar angles that are one."""
BLOCK = 1 << 18
"""Pairs of directions that are looked at together."""


class Place(NamedTuple):
    """Numbers of the regions of pairs, (n,) each, from the finest to the coarsest; and the square of polar angles."""

    sector: np.ndarray
    square: np.ndarray
    band: np.ndarray


def bands(angles: np.ndarray) -> np.ndarray:
    """The bands of both polar angles of pairs of directions, (n, 4) radians, the lower first: (n, 2)."""
    return np.concatenate([_bands(angles[k : k + BLOCK]) for k in range(0, max(len(angles), 1), BLOCK)])


def _bands(angles: np.ndarray) -> np.ndarray:
    polar = angles[:, [0, 2]]
    number = (np.degrees(polar + SLACK) / BAND).astype(np.int16)
    number = np.minimum(number, np.where(polar < np.pi / 2, SIDE // 2, SIDE).astype(np.int16) - 1)
    return np.stack([number.min(axis=1), number.max(axis=1)], axis=1)


def places(angles: np.ndarray) -> Place:
    """The regions of pairs of directions, (n, 4) radians; the same for an exchanged pair."""
    every = [_places(angles[k : k + BLOCK]) for k in range(0, max(len(angles), 1), BLOCK)]
    return Place(*(np.concatenate(numbers) for numbers in zip(*every, strict=True)))


def _places(angles: np.ndarray) -> Place:
    low, high = _bands(angles).T
    turn = np.abs(np.mod(angles[:, 3] - angles[:, 1] + np.pi, 2 * np.pi) - np.pi)
    square = high * SIDE + low
    return Place(square * 100 + (np.degrees(turn) / SECTOR - 1e-9).astype(np.int32), square, high)


def angles_of(layout: Layout, cells: np.ndarray) -> np.ndarray:
    """theta_i, phi_i, theta_o, phi_o, radians, of some cells: shape (n, 4)."""
    return pair_angles(*layout.directions_at(cells))


def pair_angles(wi: Direction, wo: Direction) -> np.ndarray:
    """theta_i, phi_i, theta_o, phi_o, radians, of pairs of directions: shape (n, 4)."""
    return np.stack([*spherical_angles(*wi), *spherical_angles(*wo)], axis=-1)
