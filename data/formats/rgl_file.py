"""The RGL material database's ``.bsdf`` files [Dupuy 2018]: checked arrays, and the table of the file's own samples."""

import os
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.flags import Flag
from gonio.data.formats.tensor_file import read_tensors
from gonio.data.interpolation.rgl_data import RGLData, coarser, samples_of
from gonio.data.layouts import spherical_angles
from gonio.data.table import Table
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.models.brdf import AbstractBRDF

FLOAT32_HORIZON = 1e-6
"""Cosine up to which an angle that was rounded to float32 is 90 degrees: the last theta_i of a file is 1.57079625."""


def read_rgl_data(path: str | os.PathLike[str]) -> RGLData:
    """The arrays of an RGL file. Raises GonioError where the file is damaged or is not of this kind."""
    fields = read_tensors(path)

    def fail(text: str) -> NoReturn:
        raise GonioError(f"{path} is no RGL material: {text}; copy it again")

    def take(name: str, dimensions: int) -> np.ndarray:
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
    channels = Channels.of_wavelengths(take("wavelengths", 1)) if spectral else Channels.rgb()
    expected = (phi_i.size, theta_i.size)
    if vndf.shape[:2] != expected or spectra.shape[:2] != expected:
        fail(f"{expected} incidences, but vndf has shape {vndf.shape} and the spectra {spectra.shape}")
    if spectra.shape[3] != spectra.shape[4] or spectra.shape[2] != len(channels):
        fail(f"the spectra have shape {spectra.shape}, which does not fit their channels or is not square")
    if min(*ndf.shape, *sigma.shape, *vndf.shape[2:], spectra.shape[3]) < 2:
        fail("a map has fewer than two nodes along an axis")
    if not ((np.diff(theta_i) > 0).all() and (np.diff(phi_i) > 0).all()) or theta_i[0] < 0 or theta_i[-1] > 1.58:
        fail("theta_i or phi_i do not increase, or leave the hemisphere")
    if vndf.min() < 0 or not (vndf.sum(axis=(2, 3)) > 0).all() or ndf.min() < 0 or sigma.min() < 0:
        fail("ndf, vndf or sigma hold negative or no densities")
    description = bytes(fields.get("description", np.zeros(0, np.uint8)).astype(np.uint8)).decode(errors="replace")
    jacobian = bool(np.ravel(fields.get("jacobian", np.ones(1)))[:1].any())
    return RGLData(theta_i, phi_i, ndf, sigma, vndf, spectra, channels, description.strip("\0 "), jacobian)


def read_rgl(path: str | os.PathLike[str]) -> Table:
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
            wi, wo, f = samples_of(data, p, t)
            angles.append(np.broadcast_arrays(*spherical_angles(*wi), *spherical_angles(*wo)))
            values.append(f)
    grid = layouts.scattered(*np.concatenate(angles, axis=1))
    f = np.concatenate(values)
    flag = np.zeros(f.shape, np.uint8)
    flag[np.minimum(*grid.cosines()) <= FLOAT32_HORIZON] = Flag.BELOW_HORIZON
    f[flag != Flag.VALID] = np.nan

    def interpolant(coarse: bool = False) -> "AbstractBRDF":
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
    return Table(grid, f, flag, data.channels, provenance=provenance, name=stem(path), interpolant=interpolant)
