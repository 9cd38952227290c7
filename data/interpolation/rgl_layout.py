"""How an RGL file that is to be written is divided: its incidences and samples, for so many bytes of a channel."""

import dataclasses

import numpy as np

from gonio.data.interpolation.rgl_data import direction
from gonio.models.brdf import AbstractBRDF
from gonio.models.catalog import is_ours
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction

CHANNEL_BYTES = 16384
"""Of an isotropic file's channel, as published; of an anisotropic one for each azimuth of the light."""
LEAST_BYTES, MOST_BYTES = 1024, 1 << 26
SIDES_OF_INCIDENCES = 1.5
"""Samples along a side for each incidence: the errors of both interpolations are then alike."""
AZIMUTH_STEP = 15.0
"""Degrees between azimuths of the light of an anisotropic file."""
PAIRS = 2000
"""Of directions, at which a symmetry is looked for."""


@dataclasses.dataclass(frozen=True)
class RGLLayout:
    """The incidences of a file, radians, and the samples along a side of the unit square."""

    theta_i: np.ndarray
    phi_i: np.ndarray
    side: int

    @property
    def isotropic(self) -> bool:
        """Whether azimuths are relative to the light's."""
        return self.phi_i.size == 1

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Of a channel: azimuths and polar angles of the light, rows and columns of samples."""
        return self.phi_i.size, self.theta_i.size, self.side, self.side

    @property
    def nodes(self) -> int:
        """Values of a channel."""
        return int(np.prod(self.shape))

    @classmethod
    def of_bytes(cls, channel_bytes: int, sectors: int | None) -> "RGLLayout":
        """The layout of a channel in single precision.

        Args:
            channel_bytes: of one channel; of an anisotropic file those of one azimuth of the light.
            sectors: how many sectors of azimuth the stored one stands for, see `sectors_of`; None: isotropic.
        """
        if not LEAST_BYTES <= channel_bytes <= MOST_BYTES:
            raise GonioError(f"{channel_bytes} bytes of a channel came; give from {LEAST_BYTES} to {MOST_BYTES}")
        values = channel_bytes // 4
        polar = max(4, round((values / SIDES_OF_INCIDENCES**2) ** (1 / 3)))
        return cls.of_incidences(polar, max(2, int(np.sqrt(values / polar))), np.pi / 2, sectors)

    @classmethod
    def of_incidences(cls, polar: int, side: int, theta_max: float, sectors: int | None) -> "RGLLayout":
        """The layout of so many polar angles of the light from 0 to `theta_max`, radians; else as `of_bytes`."""
        theta_i, phi_i = np.linspace(0.0, theta_max, polar), np.zeros(1)
        if sectors is not None:
            span = 2 * np.pi / sectors
            phi_i = np.linspace(-np.pi, -np.pi + span, round(np.degrees(span) / AZIMUTH_STEP) + 1)
        theta_i, phi_i = (a.astype(np.float32).astype(float) for a in (theta_i, phi_i))  # as the file will hold them
        return cls(theta_i, phi_i, side)


def sectors_of(brdf: AbstractBRDF) -> int | None:
    """How many sectors of azimuth one stands for by the surface's symmetry: 1, 2 or 4; None for an isotropic surface.

    A model of gonio knows whether it is isotropic; symmetry is that of f at random pairs of directions, half of
    them near mirror reflection: 2 for a half-turn, 4 for both mirror images as well.
    """
    if is_ours(brdf) and brdf.isotropic:
        return None
    rng = np.random.default_rng(0)
    z, phi = rng.uniform(0.1, 0.98, (2, PAIRS)), rng.uniform(0, 2 * np.pi, (2, PAIRS))
    near = PAIRS // 2
    z[1, :near], phi[1, :near] = z[0, :near], phi[0, :near] + np.pi + rng.normal(0, 0.05, near)
    turn, mirror = rng.uniform(0.3, 6.0, PAIRS), 1.0
    images = [(0.0, mirror, 1.0), (turn, mirror, 1.0), (np.pi, mirror, 1.0), (0.0, 1.0, -1.0), (0.0, -1.0, 1.0)]
    values = []
    for angle, along, across in images:
        w = [direction(np.arccos(z[k]), phi[k] + angle) for k in (0, 1)]
        wi, wo = (Direction(along * x, across * y, height) for x, y, height in w)
        values.append(np.nan_to_num(evaluate_in_blocks(brdf, wi, wo)))
    itself, turned, half_turn, mirrored, other = values
    scale = 1e-9 * np.abs(itself).max()

    def same(image: np.ndarray) -> bool:
        return bool(np.allclose(image, itself, rtol=1e-3, atol=scale))

    if same(turned) and not is_ours(brdf):
        return None
    return 4 if same(mirrored) and same(other) else 2 if same(half_turn) else 1
