"""The structure of a table's HDF5 file, laid out as netCDF-4 does: made empty here, filled by the writers, read back.

The cells lie in contiguous datasets of reserved room: writing values never touches the file's metadata, so a
killed writer leaves a readable file, and blocks may be written in any order.
"""

import dataclasses
import json
import mmap
import os
import struct
import zlib
from collections.abc import Mapping
from typing import BinaryIO

import h5py
import numpy as np
from numpy.typing import DTypeLike

from gonio.data.channels import Channels
from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.layouts import Layout

GONIO_FORMAT = 1
PROFILE_LAYOUT = "offsets"
"""The layout of a file that holds a profile, `gonio.data.profile.Profile`, and no table."""
RECORD = np.dtype([("done", "<u4"), ("crc", "<u4")])
"""State of one block of an unfinished file, behind its HDF5 part."""
FOOTER = struct.Struct("<32sQ8s")
"""Behind the records: digest of the recipe, number of blocks, `MAGIC`."""
MAGIC = b"GONIOPRT"
METADATA_ROOM = 1 << 16
"""Bytes, more than the metadata take besides axes and texts."""
PROVENANCE_ROOM = 512
"""Spaces after the provenance: what is known only at the end of a measurement is written over them, in place."""


@dataclasses.dataclass(frozen=True)
class TableHeader:
    """All that a table's file holds besides the values of its cells; the fields are those of `Table`."""

    layout: Layout
    channels: Channels
    dtype: DTypeLike = np.float64
    """Of `f` and `u_f`: float32 or float64."""
    provenance: dict = dataclasses.field(default_factory=dict)
    name: str = ""
    source_solid_angle: float | None = None
    receiver_solid_angle: float | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the variables: the layout's dimensions, then the channels."""
        return (*self.layout.shape, len(self.channels))

    def attributes(self) -> dict[str, object]:
        """The root attributes."""
        values = {
            "Conventions": "CF-1.10",
            "gonio_format": np.int32(GONIO_FORMAT),
            "layout": self.layout.name,
            "title": self.name or None,
            "channel_names": json.dumps(list(self.channels.names)),
            "provenance": json.dumps(self.provenance, sort_keys=True) + " " * PROVENANCE_ROOM,
            "source_solid_angle_sr": self.source_solid_angle,
            "receiver_solid_angle_sr": self.receiver_solid_angle,
        }
        return {name: value for name, value in values.items() if value is not None}


@dataclasses.dataclass(frozen=True)
class CellLocations:
    """Where the cells of a file lie: offsets, bytes from its start, of the variables that store a value per cell."""

    offsets: dict[str, int]
    dtypes: dict[str, np.dtype]
    channels: int

    def write(self, file: BinaryIO, start: int, values: Mapping[str, np.ndarray | None]) -> int:
        """Writes values of the cells from `start` on, (cells, channels) each; returns their check sum."""
        crc = 0
        for name, offset in self.offsets.items():
            cells = np.ascontiguousarray(values[name], self.dtypes[name])
            file.seek(offset + start * self.channels * cells.itemsize)
            rest = cells.data.cast("B")
            crc = zlib.crc32(rest, crc)
            while rest:  # an unbuffered file takes as many bytes as the system does at a time
                rest = rest[file.write(rest) :]
        return crc

    def check_sum(self, file: BinaryIO, start: int, stop: int) -> int:
        """The check sum of the cells start..stop as they lie in the file."""
        crc = 0
        for name, offset in self.offsets.items():
            cell = self.channels * self.dtypes[name].itemsize
            file.seek(offset + start * cell)
            crc = zlib.crc32(file.read((stop - start) * cell), crc)
        return crc


def create(path: str | os.PathLike[str], header: TableHeader, u_f: float | None) -> CellLocations:
    """Makes a whole file but for its cells. `u_f`: None keeps room for a value per cell, a number stands for all.

    Raises OSError where it cannot be written.
    """
    dtype = np.dtype(header.dtype).newbyteorder("<")
    attributes = header.attributes()
    if hasattr(os, "posix_fallocate"):
        # The library writes its metadata last, and on a full disk ends in a trace of its insides.
        texts = sum(len(str(value)) for value in attributes.values())
        room = METADATA_ROOM + 4 * texts + sum(axis.nbytes for axis in header.layout.axes.values())
        with open(path, "wb") as reserved:
            os.posix_fallocate(reserved.fileno(), 0, room)
    with h5py.File(path, "w", libver=("earliest", "v110")) as file:
        file.attrs.update(attributes)
        scales = [*_axes(file, header.layout), channel_scale(file, header.channels)]
        nodes = {
            "f": _cells(file, "f", header.shape, dtype, None),
            "u_f": _cells(file, "u_f", header.shape, dtype, u_f),
            "flag": _cells(file, "flag", header.shape, np.dtype(np.uint8), None),
        }
        for node in nodes.values():
            for dimension, scale in zip(node.dims, scales, strict=True):
                dimension.attach_scale(scale)
            if not header.layout.gridded:
                node.attrs["coordinates"] = " ".join(header.layout.axes)
        _describe(**nodes)
    return cell_locations(path)


def cell_locations(path: str | os.PathLike[str]) -> CellLocations:
    """Where the cells of a file made by `create` lie."""
    with h5py.File(path, "r", locking=False) as file:
        nodes = {n: node for n in ("f", "flag", "u_f") if isinstance(node := file[n], h5py.Dataset)}
        offsets = {name: node.id.get_offset() for name, node in nodes.items()}
        stored = {name: offset for name, offset in offsets.items() if offset is not None}
        return CellLocations(stored, {name: nodes[name].dtype for name in stored}, nodes["f"].shape[-1])


def provenance_location(path: str | os.PathLike[str]) -> tuple[int, int]:
    """(offset, length), bytes, of the provenance's text in a file made by `create`."""
    with h5py.File(path, "r", locking=False) as file:
        text = str(file.attrs["provenance"]).encode()
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as whole:
        return whole.find(text), len(text)


def _axes(file: h5py.File, layout: Layout) -> list[h5py.Dataset]:
    scales = []
    long_names = {kind.name: kind.long_name for kind in layout.axis_kinds}
    for name, axis in layout.axes.items():
        node = file.create_dataset(name, data=axis)
        node.attrs["units"] = "radian"
        node.attrs["long_name"] = long_names[name]
        scales.append(node)
    if not layout.gridded:
        # netCDF-4's way to name a dimension that has no coordinate of its own.
        sample = file.create_dataset("sample", shape=(layout.size,), dtype=">f4")
        sample.make_scale(f"This is a netCDF dimension but not a netCDF variable.{layout.size:10d}")
        for node in scales:
            node.dims[0].attach_scale(sample)
        return [sample]
    for node in scales:
        node.make_scale(node.name.lstrip("/"))
    return scales


def channel_scale(file: h5py.File, channels: Channels) -> h5py.Dataset:
    """The dimension of the channels, with their wavelengths where they have some."""
    node = file.create_dataset("channel", data=list(channels.names), dtype=h5py.string_dtype())
    node.make_scale("channel")
    node.attrs["long_name"] = "spectral channel"
    if channels.wavelengths_nm is not None:
        wavelength = file.create_dataset("wavelength", data=np.array(channels.wavelengths_nm))
        wavelength.attrs["units"] = "nm"
        wavelength.attrs["long_name"] = "wavelength of the channel, in vacuum or air as its source says"
        wavelength.dims[0].attach_scale(node)
    return node


def _cells(file: h5py.File, name: str, shape: tuple[int, ...], dtype: np.dtype, constant: float | None) -> h5py.Dataset:
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_layout(h5py.h5d.CONTIGUOUS)
    plist.set_obj_track_times(False)
    if constant is None:
        plist.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        plist.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    else:
        # Room is never taken: the library answers with the fill value.
        plist.set_alloc_time(h5py.h5d.ALLOC_TIME_LATE)
        plist.set_fill_value(np.array(constant, dtype))
    space = h5py.h5s.create_simple(shape)
    kind = h5py.h5t.py_create(dtype)
    return h5py.Dataset(h5py.h5d.create(file.id, name.encode(), kind, space, plist))


def _describe(f: h5py.Dataset, u_f: h5py.Dataset, flag: h5py.Dataset) -> None:
    f.attrs["units"] = u_f.attrs["units"] = "sr-1"
    f.attrs["long_name"] = "BRDF, radiance per irradiance, without the cosine"
    f.attrs["ancillary_variables"] = "u_f flag"
    u_f.attrs["long_name"] = "standard uncertainty of the expected reading; 0 exact, NaN unknown"
    flag.attrs["long_name"] = "why a cell has no value"
    flag.attrs["flag_values"] = np.array([int(v) for v in Flag], np.uint8)
    flag.attrs["flag_meanings"] = " ".join(FLAG_MEANINGS)
