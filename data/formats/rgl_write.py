"""Writing RGL ``.bsdf`` tensor files [Dupuy 2018] of tables and models, as Mitsuba's `measured` plugin reads them."""

import os
import struct
from collections.abc import Mapping

import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import new_file
from gonio.data.flags import Flag
from gonio.data.formats.rgl_file import DTYPES, MAGIC, read_rgl_data
from gonio.data.interpolation.coverage import covered
from gonio.data.interpolation.multilinear import as_material
from gonio.data.interpolation.rgl_data import RGLData
from gonio.data.interpolation.rgl_fit import RGLFit, fit_rgl
from gonio.data.interpolation.rgl_layout import CHANNEL_BYTES, RGLLayout, sectors_of
from gonio.data.interpolation.rgl_pairs import spread_pairs
from gonio.data.interpolation.rgl_warp import RGLMaterial
from gonio.data.material import Material
from gonio.data.reflection_only import require_reflection
from gonio.data.round_trip import RoundTrip, compare
from gonio.data.table import Table
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate, evaluate_in_blocks
from gonio.models.geometry.directions import Direction

CODES = {np.dtype(name): code for code, name in DTYPES.items()}
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
COMPARED = 40_000
"""Pairs at which a file is compared with its model, both directions within `COMPARED_WITHIN` of the normal."""
COMPARED_WITHIN = np.radians(80.0)


def write_rgl(
    path: str | os.PathLike[str],
    source: Table | Material,
    force: bool = False,
    channel_bytes: int = CHANNEL_BYTES,
) -> RoundTrip:
    """Writes a table or a model as an RGL file, and returns what reading it again shows to be lost.

    The file holds R, G, B, or a spectrum where the channels have wavelengths; one channel without is repeated. Its
    arrays are those for which the file's interpolant is nearest to the source (see
    `gonio.data.interpolation.rgl_fit`), and negative nowhere. A table is interpolated; the field `valid` marks the
    samples for which it has readings.

    Args:
        path: the file.
        source: a table, or a material.
        force: replaces an existing file.
        channel_bytes: of the samples of one channel in single precision: of an anisotropic surface those of each
            azimuth of the light. 16384 as published.

    Raises:
        GonioError: for channels that are neither one, nor R, G, B, nor wavelengths; for a table without readings for
            half of the directions; where `path` cannot be written.
    """
    require_reflection(source if isinstance(source, Table) else source.brdf, source.name, "an RGL file")
    channels = rgl_channels(source.channels)
    brdf = as_material(source) if isinstance(source, Table) else source.brdf
    layout = RGLLayout.of_bytes(channel_bytes, sectors_of(brdf))

    def covers(wi: Direction, wo: Direction) -> np.ndarray:
        return covered(source, wi, wo) if isinstance(source, Table) else np.ones(np.shape(wi.z), bool)

    fit = fit_rgl(brdf, channels, layout, covers, source.name)
    return _compared(source, RGLMaterial(write_arrays(path, fit, force)), fit)


def write_arrays(path: str | os.PathLike[str], fit: RGLFit, force: bool = False) -> RGLData:
    """Writes a file of these arrays, whole or not at all, and returns what is read again."""
    with new_file(path, force) as temporary:
        temporary.write_bytes(tensor_bytes(rgl_fields(fit)))
        return read_rgl_data(temporary)


def rgl_fields(fit: RGLFit) -> dict[str, np.ndarray]:
    """The fields of a file, in the order and of the types that published ones have."""
    data = fit.data
    fields = {
        "version": np.array([1, 0], "<u4"),
        "description": np.frombuffer(data.description.encode() or b" ", np.uint8),
        "phi_i": data.phi_i, "theta_i": data.theta_i, "sigma": data.sigma, "ndf": data.ndf, "vndf": data.vndf,
        "luminance": fit.luminance,
    }  # fmt: skip
    if data.channels.wavelengths_nm is None:
        spectra = data.spectra if data.spectra.shape[2] == 3 else np.repeat(data.spectra, 3, axis=2)
        fields["rgb"] = spectra
    else:
        order = np.argsort(data.channels.wavelengths_nm)
        fields["wavelengths"] = np.array(data.channels.wavelengths_nm)[order]
        fields["spectra"] = data.spectra[:, :, order]
    fields |= {"jacobian": np.array([data.jacobian], np.uint8), "valid": np.packbits(fit.valid)}
    return {name: a.astype("<f4") if a.dtype.kind == "f" else a for name, a in fields.items()}


def tensor_bytes(fields: Mapping[str, np.ndarray]) -> bytes:
    """A tensor file of arrays by name; each begins at a multiple of eight bytes."""
    names = {name: name.encode() for name in fields}
    position = len(MAGIC) + 6 + sum(len(names[k]) + 13 + 8 * a.ndim for k, a in fields.items())
    head, body = MAGIC + struct.pack("<BBI", 1, 0, len(fields)), []
    for name, array in fields.items():
        gap = -position % 8
        body += [bytes(gap), np.ascontiguousarray(array).tobytes()]
        head += struct.pack("<H", len(names[name])) + names[name]
        head += struct.pack(f"<HBQ{array.ndim}Q", array.ndim, CODES[array.dtype], position + gap, *array.shape)
        position += gap + array.nbytes
    return head + b"".join(body)


def rgl_channels(channels: Channels) -> Channels:
    """The channels themselves, where an RGL file can hold them. Raises GonioError for others."""
    if channels.wavelengths_nm is not None:
        if len(set(channels.wavelengths_nm)) < len(channels):
            raise GonioError("two channels have one wavelength; an RGL file holds one value for each")
        return channels
    if len(channels) not in (1, 3):
        raise GonioError(
            f"an RGL file holds R, G, B or wavelengths, but there are {len(channels)} channels without wavelengths; "
            "choose one or three"
        )
    return channels


def _compared(source: Table | Material, written: RGLMaterial, fit: RGLFit) -> RoundTrip:
    """The file against the readings of a table, or against a model at random pairs of directions."""
    if isinstance(source, Table):
        block = source.samples(limit=COMPARED)
        wi, wo, f, valid = block.wi, block.wo, block.f, block.flag == Flag.VALID
    else:
        pairs = spread_pairs(fit.data, 2 * COMPARED, np.random.default_rng(1))
        pairs = pairs.part(np.minimum(pairs.wi.z, pairs.wo.z) > np.cos(COMPARED_WITHIN))
        wi, wo = pairs.wi, pairs.wo
        f = evaluate_in_blocks(source.brdf, wi, wo)
        valid = np.isfinite(f)
    read = np.asarray(evaluate(written, wi, wo))
    if (wavelengths := source.channels.wavelengths_nm) is not None:
        read = read[:, np.argsort(np.argsort(wavelengths))]  # which the file has in ascending order
    f, valid = (np.broadcast_to(a, read.shape) for a in (f, valid))
    usable = valid & (f > 0)
    error = np.abs(read[usable] / f[usable] - 1)
    spread = (
        f"median {np.median(error):.2g}, 95 % below {np.quantile(error, 0.95):.2g} relative" if usable.any() else ""
    )
    p, t, r, _ = fit.data.vndf.shape[:2] + fit.data.spectra.shape[-2:]
    note = f"{p} × {t} incidences of {r} × {r} samples; {spread}"
    if fit.covered < 1:
        note += f"; {percent(1 - fit.covered)} of the directions have no reading: continued, and marked in 'valid'"
    return compare(f, read, valid, np.isfinite(read), note)
