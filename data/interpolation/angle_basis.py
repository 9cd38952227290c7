"""Angle bases of matrices [Klems 1994]: a hemisphere cut into rings, each ring into equal patches of azimuth."""

import dataclasses

import numpy as np

from gonio.models.errors import GonioError

MOST_PATCHES = 4096


@dataclasses.dataclass(frozen=True)
class AngleBasis:
    """Rings by their edges, degrees, from 0 to 90, and the number of patches in each, the first centred on azimuth 0.

    Raises GonioError for edges that do not increase from 0 to 90 and for counts below 1.
    """

    name: str
    edges: tuple[float, ...]
    counts: tuple[int, ...]

    def __post_init__(self) -> None:
        edges = np.asarray(self.edges, float)
        if len(edges) != len(self.counts) + 1 or not self.counts or edges[0] != 0 or not (np.diff(edges) > 0).all():
            raise GonioError(f"the angle basis {self.name!r} has no rings that increase from 0; give theta bounds so")
        if abs(edges[-1] - 90) > 1e-6:
            raise GonioError(f"the angle basis {self.name!r} ends at {edges[-1]:g} degrees; its rings must reach 90")
        if min(self.counts) < 1 or self.size > MOST_PATCHES:
            raise GonioError(
                f"the angle basis {self.name!r} has rings without patches, or above {MOST_PATCHES:,} in all"
            )

    @property
    def size(self) -> int:
        """Number of patches."""
        return sum(self.counts)

    @property
    def first(self) -> np.ndarray:
        """(rings,): the number of the first patch of each ring."""
        return np.concatenate([[0], np.cumsum(self.counts)[:-1]])

    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """(theta, phi) (size,) of the patches' middles, radians; a single patch at the pole has theta 0."""
        edges = np.radians(self.edges)
        middle = np.where((edges[:-1] == 0) & (np.asarray(self.counts) == 1), 0.0, (edges[:-1] + edges[1:]) / 2)
        theta = np.repeat(middle, self.counts)
        return theta, np.concatenate([2 * np.pi * np.arange(n) / n for n in self.counts])

    def patch(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """(n,): the number of the patch that a direction is in, radians."""
        ring = np.searchsorted(np.radians(self.edges[1:-1]), theta, side="right")
        count = np.asarray(self.counts)[ring]
        return self.first[ring] + np.floor(phi / (2 * np.pi) * count + 0.5).astype(int) % count

    def within(self, patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(n, 2): theta and phi, radians, of places in patches by their numbers: u, v in [0, 1), even in cos θ dω."""
        ring = np.searchsorted(self.first, patch, side="right") - 1
        low, high = (np.sin(np.radians(e))[ring] ** 2 for e in (self.edges[:-1], self.edges[1:]))
        turn = (patch - self.first[ring] + v - 0.5) / np.asarray(self.counts)[ring]
        return np.stack([np.arcsin(np.sqrt(low + (high - low) * u)), 2 * np.pi * turn % (2 * np.pi)], axis=-1)

    def projected_solid_angles(self) -> np.ndarray:
        """(size,): ∫ cos θ dω of each patch, sr; they add to π."""
        share = np.diff(np.sin(np.radians(self.edges)) ** 2)
        return np.repeat(np.pi * share / np.asarray(self.counts), self.counts)


KLEMS_BASES = (
    AngleBasis("LBNL/Klems Full", (0, 5, 15, 25, 35, 45, 55, 65, 75, 90), (1, 8, 16, 20, 24, 24, 24, 16, 12)),
    AngleBasis("LBNL/Klems Half", (0, 6.5, 19.5, 32.5, 45.5, 58.5, 71.5, 90), (1, 8, 12, 16, 20, 12, 8)),
    AngleBasis("LBNL/Klems Quarter", (0, 9, 27, 45, 63, 90), (1, 8, 12, 12, 8)),
)
"""The bases that files may name without defining them, as WINDOW has them."""
EARLIER_BASES = (
    AngleBasis("LBNL/Klems Half", (0, 6.5, 19.5, 32.5, 46.5, 61.5, 76.5, 90), (1, 8, 12, 16, 20, 12, 4)),
    AngleBasis("LBNL/Klems Quarter", (0, 9, 27, 46, 66, 90), (1, 8, 12, 12, 8)),
)
"""Those that Radiance's programs took for them before 2024."""
