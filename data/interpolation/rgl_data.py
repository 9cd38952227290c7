"""The arrays of an RGL material [Dupuy 2018] and their warp: from a sample of the unit square to its directions."""

import dataclasses
from functools import cached_property
from typing import Any

import numpy as np

from gonio.data.channels import Channels


@dataclasses.dataclass(frozen=True)
class RGLData:
    """The arrays of one file, float64, their shapes checked against each other. Angles in radians."""

    theta_i: np.ndarray
    phi_i: np.ndarray
    ndf: np.ndarray
    sigma: np.ndarray
    vndf: np.ndarray
    """(phi, theta, h, w): density of visible normals over u = (φ, θ) of the half vector, not normalised."""
    spectra: np.ndarray
    """(phi, theta, channel, r, r): f·cosθ_o·4σ/D."""
    channels: Channels
    description: str
    jacobian: bool
    valid: np.ndarray | None = None
    """(phi, theta, r, r): which samples are values; None where the file does not say it."""

    @property
    def isotropic(self) -> bool:
        """Whether azimuths are relative to the light's."""
        return self.phi_i.size <= 2

    @property
    def reduction(self) -> int:
        """How many sectors of azimuth the stored one stands for by symmetry: 1, 2 or 4."""
        return 1 if self.isotropic else int(np.rint(2 * np.pi / np.ptp(self.phi_i)))

    @cached_property
    def warp(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(density, conditional over columns, marginal over rows) of `vndf`, in units of a cell, of total 1."""
        conditional = np.zeros_like(self.vndf)
        np.cumsum(0.5 * (self.vndf[..., 1:] + self.vndf[..., :-1]), axis=-1, out=conditional[..., 1:])
        marginal = np.zeros_like(conditional[..., -1])
        np.cumsum(0.5 * (conditional[..., 1:, -1] + conditional[..., :-1, -1]), axis=-1, out=marginal[..., 1:])
        total = marginal[..., -1:]
        return self.vndf / total[..., None], conditional / total[..., None], marginal / total


def coarser(data: RGLData) -> RGLData:
    """The file with every second incidence and half the samples: what it misses tells what the file itself misses."""
    count = data.theta_i.size
    kept = sorted({*range(0, count, 2), count - 1})
    half = max(2, (data.spectra.shape[-1] + 1) // 2)
    x, y = np.meshgrid(*2 * (np.linspace(0.0, 1.0, half),))
    spectra = np.stack([[[bilinear(c, x, y) for c in t] for t in p[kept]] for p in data.spectra])
    return dataclasses.replace(data, theta_i=data.theta_i[kept], vndf=data.vndf[:, kept], spectra=spectra)


def samples_of(data: RGLData, p: int, t: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(wi, wo, f) of the r × r samples of one incidence; f is (r², channels), not finite below the horizon."""
    r = data.spectra.shape[-1]
    y, x = (axis.ravel() for axis in np.meshgrid(*2 * (np.linspace(0.0, 1.0, r),), indexing="ij"))
    u_x, u_y = warped(data, p, t, x, y)
    theta_i, phi_i = data.theta_i[t], 0.0 if data.isotropic else data.phi_i[p]
    wi = direction(theta_i, phi_i)
    # `RGLMaterial` reads normal incidence, where the light has no azimuth, turned by π.
    m = half_vector_at(u_x, u_y, np.pi if data.isotropic and theta_i == 0 else 0.0)
    twice = 2 * (wi @ m)
    wo = twice * m - wi[:, None]
    f = data.spectra[p, t].reshape(-1, r * r).T.copy()
    if data.jacobian:
        sigma = projected_area(data.sigma, theta_i, phi_i)
        f *= (bilinear(data.ndf, u_x, u_y) / (4 * sigma))[:, None]
    from gonio.models.geometry.horizon import HORIZON

    return wi, wo, f / np.where(wo[2] > HORIZON, wo[2], np.inf)[:, None]


def projected_area(sigma: np.ndarray, theta_i: Any, phi_i: Any) -> np.ndarray:
    """Projected area of the facets, σ, of a file's map at the directions of the light, radians, which broadcast."""
    return bilinear(sigma, np.sqrt(theta_i * 2 / np.pi), (phi_i + np.pi) / (2 * np.pi))


def half_vector_at(u_x: np.ndarray, u_y: np.ndarray, turn: float = 0.0) -> np.ndarray:
    """Half vectors (3, n) at positions of the maps, turned about the normal."""
    return direction(u_x**2 * (np.pi / 2), (2 * u_y - 1) * np.pi + turn)


def direction(theta: Any, phi: Any) -> np.ndarray:
    """Unit vectors (3, ...) of angles, radians."""
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0.0 * phi])


def warped(data: RGLData, p: int, t: int, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (u_x, u_y) to which the samples (x, y) of one incidence are warped: row first, then column."""
    density, conditional, marginal = (a[p, t] for a in data.warp)
    h, w = density.shape
    row = np.clip(np.searchsorted(marginal, y, side="left") - 1, 0, h - 2)
    r0, r1 = conditional[row, -1], conditional[row + 1, -1]
    t_y = _solve(y - marginal[row], r0, r1)
    cdf = (1 - t_y)[:, None] * conditional[row] + t_y[:, None] * conditional[row + 1]
    along = x * cdf[:, -1]
    column = np.clip((cdf < along[:, None]).sum(axis=1) - 1, 0, w - 2)
    each = np.arange(x.size)
    c0, c1 = ((1 - t_y) * density[row, column + k] + t_y * density[row + 1, column + k] for k in (0, 1))
    t_x = _solve(along - cdf[each, column], c0, c1)
    return (column + t_x) / (w - 1), (row + t_y) / (h - 1)


def _solve(area: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """t in [0, 1] with a·t + (b − a)·t²/2 = area, without cancellation; 0 where there is no density."""
    root = np.sqrt(np.maximum(a**2 + 2 * (b - a) * area, 0.0))
    return np.clip(2 * area / np.where(a + root > 0, a + root, np.inf), 0.0, 1.0)


def bilinear(values: np.ndarray, x: Any, y: Any) -> np.ndarray:
    """A map (rows, columns) at positions (x, y) of the unit square."""
    rows, columns = values.shape
    x, y = np.clip(x, 0, 1) * (columns - 1), np.clip(y, 0, 1) * (rows - 1)
    i, j = np.minimum(np.int64(x), columns - 2), np.minimum(np.int64(y), rows - 2)
    s, t = x - i, y - j
    lower = (1 - s) * values[j, i] + s * values[j, i + 1]
    return (1 - t) * lower + t * ((1 - s) * values[j + 1, i] + s * values[j + 1, i + 1])
