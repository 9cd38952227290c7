"""The RGL material database's ``.bsdf`` files [Dupuy 2018]: checked arrays, and the table of the file's own samples."""

import dataclasses
import os
from functools import cached_property

import numpy as np

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.formats.tensor_file import read_tensors
from gonio.data.layouts import HORIZON, spherical_angles
from gonio.data.table import Channels, Table
from gonio.models.errors import GonioError

FLOAT32_HORIZON = 1e-6
"""Cosine up to which an angle that was rounded to float32 is 90 degrees: the last theta_i of a file is 1.57079625."""


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


def read_rgl_data(path: str | os.PathLike) -> RGLData:
    """The arrays of an RGL file. Raises GonioError where the file is damaged or is not of this kind."""
    fields = read_tensors(path)

    def fail(text):
        raise GonioError(f"{path} is no RGL material: {text}; copy it again")

    def take(name, dimensions):
        if name not in fields:
            fail(f"the field {name!r} is missing")
        array = fields[name]
        if array.ndim != dimensions or array.dtype.kind != "f" or min(array.shape) == 0:
            fail(f"the field {name!r} has shape {array.shape} and type {array.dtype}, expected {dimensions} dimensions")
        if not np.isfinite(array).all():
            fail(f"the field {name!r} holds values that are not finite")
        return array.astype(np.float64)

    spectral = "spectra" in fields
    theta_i, phi_i = take("theta_i", 1), take("phi_i", 1)
    ndf, sigma, vndf = take("ndf", 2), take("sigma", 2), take("vndf", 4)
    spectra = take("spectra" if spectral else "rgb", 5)
    wavelengths = take("wavelengths", 1) if spectral else None
    expected = (phi_i.size, theta_i.size)
    if vndf.shape[:2] != expected or spectra.shape[:2] != expected:
        fail(f"{expected} incidences, but vndf has shape {vndf.shape} and the spectra {spectra.shape}")
    if spectra.shape[3] != spectra.shape[4] or spectra.shape[2] != (wavelengths.size if spectral else 3):
        fail(f"the spectra have shape {spectra.shape}, which does not fit their channels or is not square")
    if min(*ndf.shape, *sigma.shape, *vndf.shape[2:], spectra.shape[3]) < 2:
        fail("a map has fewer than two nodes along an axis")
    if not ((np.diff(theta_i) > 0).all() and (np.diff(phi_i) > 0).all()) or theta_i[0] < 0 or theta_i[-1] > 1.58:
        fail("theta_i or phi_i do not increase, or leave the hemisphere")
    if vndf.min() < 0 or not (vndf.sum(axis=(2, 3)) > 0).all() or ndf.min() < 0 or sigma.min() < 0:
        fail("ndf, vndf or sigma hold negative or no densities")
    channels = Channels.of_wavelengths(wavelengths) if spectral else Channels.rgb()
    description = bytes(fields.get("description", np.zeros(0, np.uint8)).astype(np.uint8)).decode(errors="replace")
    jacobian = bool(np.ravel(fields.get("jacobian", np.ones(1)))[:1].any())
    return RGLData(theta_i, phi_i, ndf, sigma, vndf, spectra, channels, description.strip("\0 "), jacobian)


def read_rgl(path: str | os.PathLike) -> Table:
    """The table of an RGL file: its own samples, scattered; f in 1/sr, the files' cosine divided out.

    A sample at or below the horizon (to the files' single precision) is BELOW_HORIZON; negative values are
    kept. The light of an isotropic file stands at phi = 0. `Table.interpolant` is
    `gonio.data.interpolation.rgl_warp.RGLMaterial`. Raises GonioError for a damaged file.
    """
    data = read_rgl_data(path)
    # Two azimuths mark an isotropic file of an older kind: both hold the same.
    phi_count = 1 if data.isotropic else data.phi_i.size
    angles, values = [], []
    for p in range(phi_count):
        for t in range(data.theta_i.size):
            wi, wo, f = _samples(data, p, t)
            theta_i, phi_i = spherical_angles(*wi)
            theta_o, phi_o = spherical_angles(*wo)
            angles.append(
                [np.broadcast_to(theta_i, theta_o.shape), np.broadcast_to(phi_i, theta_o.shape), theta_o, phi_o]
            )
            values.append(f)
    grid = layouts.scattered(*np.concatenate(angles, axis=1))
    f = np.concatenate(values)
    flag = np.zeros(f.shape, np.uint8)
    flag[np.minimum(*grid.cosines()) <= FLOAT32_HORIZON] = Flag.BELOW_HORIZON
    f[flag != Flag.VALID] = np.nan

    def interpolant(coarse: bool = False):
        from gonio.data.interpolation.rgl_warp import RGLMaterial

        return RGLMaterial(coarser(data) if coarse else data)

    provenance = {
        "format": "RGL",
        "source": os.path.basename(path),
        "material": data.description,
        "isotropic": data.isotropic,
        "negative_values_in_file": int((data.spectra < 0).sum()),
        "assumptions": ["the files' values include cos theta_o; it was divided out"],
    }
    name = os.path.splitext(os.path.basename(path))[0]
    return Table(grid, f, flag, data.channels, provenance=provenance, name=name, interpolant=interpolant)


def coarser(data: RGLData) -> RGLData:
    """The file with every second incidence and half the samples: what it misses tells what the file itself misses."""
    count = data.theta_i.size
    kept = sorted({*range(0, count, 2), count - 1})
    half = max(2, (data.spectra.shape[-1] + 1) // 2)
    x, y = np.meshgrid(*2 * (np.linspace(0.0, 1.0, half),))
    spectra = np.stack([[[_bilinear(c, x, y) for c in t] for t in p[kept]] for p in data.spectra])
    return dataclasses.replace(data, theta_i=data.theta_i[kept], vndf=data.vndf[:, kept], spectra=spectra)


def _samples(data: RGLData, p: int, t: int):
    """(wi, wo, f) of the r × r samples of one incidence; f is (r², channels), not finite below the horizon."""
    r = data.spectra.shape[-1]
    y, x = (axis.ravel() for axis in np.meshgrid(*2 * (np.linspace(0.0, 1.0, r),), indexing="ij"))
    u_x, u_y = _warp(data, p, t, x, y)
    theta_i, phi_i = data.theta_i[t], 0.0 if data.isotropic else data.phi_i[p]
    wi = _direction(theta_i, phi_i)
    theta_m, phi_m = u_x**2 * (np.pi / 2), (2 * u_y - 1) * np.pi
    if data.isotropic and theta_i == 0:
        phi_m = phi_m + np.pi  # as `RGLMaterial` reads normal incidence, where the light has no azimuth
    m = _direction(theta_m, phi_m)
    twice = 2 * (wi @ m)
    wo = twice * m - wi[:, None]
    f = data.spectra[p, t].reshape(-1, r * r).T.copy()
    if data.jacobian:
        sigma = _bilinear(data.sigma, np.sqrt(theta_i * 2 / np.pi), (phi_i + np.pi) / (2 * np.pi))
        f *= (_bilinear(data.ndf, u_x, u_y) / (4 * sigma))[:, None]
    return wi, wo, f / np.where(wo[2] > HORIZON, wo[2], np.inf)[:, None]


def _direction(theta, phi):
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0.0 * phi])


def _warp(data: RGLData, p: int, t: int, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def _solve(area, a, b):
    """t in [0, 1] with a·t + (b − a)·t²/2 = area, without cancellation; 0 where there is no density."""
    root = np.sqrt(np.maximum(a**2 + 2 * (b - a) * area, 0.0))
    return np.clip(2 * area / np.where(a + root > 0, a + root, np.inf), 0.0, 1.0)


def _bilinear(values, x, y):
    rows, columns = values.shape
    x, y = np.clip(x, 0, 1) * (columns - 1), np.clip(y, 0, 1) * (rows - 1)
    i, j = np.minimum(np.int64(x), columns - 2), np.minimum(np.int64(y), rows - 2)
    s, t = x - i, y - j
    lower = (1 - s) * values[j, i] + s * values[j, i + 1]
    return (1 - t) * lower + t * ((1 - s) * values[j + 1, i] + s * values[j + 1, i + 1])
