"""The RGL material database's ``.bsdf`` files [Dupuy 2018]: tensor files, and the table of the file's own samples.

Each claim of a tensor file's header is held against the file.
"""

import math
import os
import struct
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem, whole_size
from gonio.data.flags import Flag
from gonio.data.interpolation.rgl_data import RGLData, coarser, projected_area, samples_of
from gonio.data.layouts import spherical_angles
from gonio.data.table import Table
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.models.brdf import AbstractBRDF

MAGIC = b"tensor_file\0"
DTYPES = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<u8", 8: "<i8", 9: "<f2", 10: "<f4", 11: "<f8"}
MAX_DIMENSIONS = 16
LARGEST = 1e30
"""Of the numbers of a map: products of three are still numbers."""
FLOAT32_HORIZON = 1e-6
"""Cosine up to which an angle that was rounded to float32 is 90 degrees: the last theta_i of a file is 1.57079625."""


def read_rgl_data(path: str | os.PathLike[str]) -> RGLData:
    """The arrays of an RGL file. Raises GonioError where the file is damaged or is not of this kind."""
    fields = read_tensors(path)
    if {"M", "phi_d", "theta_d", "theta_h"} <= fields.keys():
        raise GonioError(f"{path} is a polarised BRDF (.pbsdf) of Mueller matrices, which gonio does not read")

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
    jacobian = bool(np.ravel(fields.get("jacobian", np.ones(1)))[:1].any())
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
    if jacobian and not (projected_area(sigma, theta_i, phi_i[:, None]) > 0).all():
        fail("sigma, by which f is divided, is 0 at an incidence")
    if max(float(np.abs(a).max()) for a in (ndf, sigma, vndf, spectra)) > LARGEST:
        fail(f"it holds numbers beyond {LARGEST:g}")
    if phi_i.size > 2 and np.rint(2 * np.pi / np.ptp(phi_i)) not in (1, 2, 4):
        fail(f"phi_i covers {np.degrees(np.ptp(phi_i)):.3g} degrees, expected 90, 180 or 360")
    description = bytes(fields.get("description", np.zeros(0, np.uint8)).astype(np.uint8)).decode(errors="replace")
    mask = fields.get("valid")
    nodes = spectra.size // spectra.shape[2]
    valid = None
    if mask is not None and mask.dtype == np.uint8 and mask.size == -(-nodes // 8):
        valid = np.unpackbits(mask)[:nodes].astype(bool).reshape(*expected, *spectra.shape[-2:])
    return RGLData(theta_i, phi_i, ndf, sigma, vndf, spectra, channels, description.strip("\0 "), jacobian, valid)


def read_rgl(path: str | os.PathLike[str]) -> Table:
    """The table of an RGL file: its own samples, scattered; f in 1/sr, the files' cosine divided out.

    A sample at or below the horizon (to the files' single precision) is BELOW_HORIZON; one above it that the
    file's field `valid` excludes is NOT_MEASURED (a field that excludes all of them means the reverse); negative values
    are kept. The light of an isotropic file stands at phi = 0. `Table.interpolant` is
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
    grid = layouts.front_samples(*np.concatenate(angles, axis=1))
    f = np.concatenate(values)
    flag = np.zeros(f.shape, np.uint8)
    flag[np.minimum(*grid.cosines()) <= FLOAT32_HORIZON] = Flag.BELOW_HORIZON
    if data.valid is not None:
        above, valid = flag == Flag.VALID, data.valid[:phi_count].reshape(-1, 1)
        # Some published files mark what is below the horizon, and nothing above it.
        flag[above & ~(valid if (above & valid).any() else ~valid)] = Flag.NOT_MEASURED
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


def read_tensors(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The arrays of a tensor file by name. Raises GonioError where the header and the file disagree in any way."""
    whole_size(path)
    with open(path, "rb") as file:
        data = file.read()
    return parse_tensors(data, str(path))


def parse_tensors(data: bytes, path: str) -> dict[str, np.ndarray]:
    """`read_tensors` of bytes at hand; `path` is for the messages. Arrays are views of `data`."""
    reader = _Header(data, path)
    if reader.bytes(len(MAGIC)) != MAGIC:
        raise GonioError(f"{path} is no RGL tensor file: it does not start with 'tensor_file'; name another file")
    if (version := reader.unpack("<BB")) != (1, 0):
        raise GonioError(f"{path} has tensor-file version {version[0]}.{version[1]}, expected 1.0; convert it first")
    (count,) = reader.unpack("<I")
    fields = {}
    for _ in range(count):
        name, array = reader.field()
        if name in fields:
            reader.fail(f"names the field {name!r} twice")
        fields[name] = array
    return fields


class _Header:
    def __init__(self, data: bytes, path: str) -> None:
        self.data, self.path, self.position = data, path, 0

    def fail(self, text: str) -> NoReturn:
        raise GonioError(f"{self.path} {text}; the file is damaged, copy it again")

    def bytes(self, count: int) -> bytes:
        part = self.data[self.position : self.position + count]
        if len(part) < count:
            self.fail(f"ends inside its header, at byte {len(self.data)}")
        self.position += count
        return part

    def unpack(self, form: str) -> tuple:
        return struct.unpack(form, self.bytes(struct.calcsize(form)))

    def field(self) -> tuple[str, np.ndarray]:
        (length,) = self.unpack("<H")
        try:
            name = self.bytes(length).decode()
        except UnicodeDecodeError:
            self.fail("has a field whose name is no text")
        dimensions, code, offset = self.unpack("<HBQ")
        if dimensions > MAX_DIMENSIONS or code not in DTYPES:
            self.fail(f"gives field {name!r} {dimensions} dimensions of type {code}, which no tensor file has")
        shape = self.unpack(f"<{dimensions}Q")
        dtype, count = np.dtype(DTYPES[code]), math.prod(shape)
        # Python integers do not overflow: a product of shapes cannot wrap round to something small.
        if offset + count * dtype.itemsize > len(self.data) or max(shape, default=0) > len(self.data):
            self.fail(f"puts field {name!r} ({count} values at byte {offset}) outside its {len(self.data)} bytes")
        return name, np.frombuffer(self.data, dtype, count, offset).reshape(shape)
