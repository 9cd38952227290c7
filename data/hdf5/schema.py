"""The bones of a table's HDF5 file, laid out as netCDF-4 does: made empty here, filled by the writers, read
back.

The cells lie in contiguous datasets of reserved room: writing values never touches the file's metadata, so a
killed writer leaves a readable file, and blocks may be written in any order.
"""

import dataclasses
import json
import mmap
import os

import h5py
import numpy as np

from gonio.data.channels import Channels
from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.layouts import Layout

GONIO_FORMAT = 1
PROVENANCE_ROOM = 512
"""Spaces after the provenance: what is known only at the end of a measurement is written over them, in place."""


@dataclasses.dataclass(frozen=True)
class Places:
    """Where the cells of a file lie: bytes from its start, `u_f` None where the file stores one value for all."""

    f: int
    u_f: int | None
    flag: int
    dtype: np.dtype
    channels: int

    def of(self, what: str) -> tuple[int, np.dtype]:
        """(offset, dtype) of f, u_f or flag."""
        return getattr(self, what), np.dtype(np.uint8) if what == "flag" else self.dtype


def create(
    path: str | os.PathLike,
    layout: Layout,
    channels: Channels,
    dtype: np.dtype,
    u_f: float | None,
    attributes: dict,
) -> Places:
    """Makes a whole file but for its cells. `u_f`: None keeps room for a value per cell, a number stands for all."""
    dtype = np.dtype(dtype).newbyteorder("<")
    with h5py.File(path, "w", libver=("earliest", "v110")) as file:
        for name, value in attributes.items():
            if value is not None:
                file.attrs[name] = value
        scales = [*_axes(file, layout), _channels(file, channels)]
        shape = (*layout.shape, len(channels))
        for name, kind in (("f", dtype), ("u_f", dtype), ("flag", np.dtype(np.uint8))):
            node = _cells(file, name, shape, kind, u_f if name == "u_f" else None)
            for dimension, scale in zip(node.dims, scales, strict=True):
                dimension.attach_scale(scale)
            if not layout.gridded:
                node.attrs["coordinates"] = " ".join(layout.axes)
        _describe(file)
    return places(path)


def places(path: str | os.PathLike) -> Places:
    """Where the cells of a file made by `create` lie."""
    with h5py.File(path, "r", locking=False) as file:
        offset = {name: file[name].id.get_offset() for name in ("f", "u_f", "flag")}
        return Places(**offset, dtype=file["f"].dtype, channels=file["f"].shape[-1])


def provenance_place(path: str | os.PathLike) -> tuple[int, int]:
    """(offset, length), bytes, of the provenance's text in a file made by `create`."""
    with h5py.File(path, "r", locking=False) as file:
        text = file.attrs["provenance"].encode()
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as whole:
        return whole.find(text), len(text)


def attributes_of(layout: Layout, channels: Channels, provenance: dict, source, receiver, name: str) -> dict:
    """The root attributes of a table's file; None is left out."""
    return {
        "Conventions": "CF-1.10",
        "gonio_format": np.int32(GONIO_FORMAT),
        "layout": layout.name,
        "title": name or None,
        "channel_names": json.dumps(list(channels.names)),
        "provenance": json.dumps(provenance, sort_keys=True) + " " * PROVENANCE_ROOM,
        "source_solid_angle_sr": source,
        "receiver_solid_angle_sr": receiver,
    }


def _axes(file, layout):
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


def _channels(file, channels):
    node = file.create_dataset("channel", data=list(channels.names), dtype=h5py.string_dtype())
    node.make_scale("channel")
    node.attrs["long_name"] = "spectral channel"
    if channels.wavelengths_nm is not None:
        wavelength = file.create_dataset("wavelength", data=np.array(channels.wavelengths_nm))
        wavelength.attrs["units"] = "nm"
        wavelength.attrs["long_name"] = "wavelength of the channel, in vacuum or air as its source says"
        wavelength.dims[0].attach_scale(node)
    return node


def _cells(file, name, shape, dtype, constant):
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


def _describe(file):
    f, u_f, flag = file["f"], file["u_f"], file["flag"]
    f.attrs["units"] = u_f.attrs["units"] = "sr-1"
    f.attrs["long_name"] = "BRDF, radiance per irradiance, without the cosine"
    f.attrs["ancillary_variables"] = "u_f flag"
    u_f.attrs["long_name"] = "standard uncertainty of the expected reading; 0 exact, NaN unknown"
    flag.attrs["long_name"] = "why a cell has no value"
    flag.attrs["flag_values"] = np.array([int(v) for v in Flag], np.uint8)
    flag.attrs["flag_meanings"] = " ".join(FLAG_MEANINGS)
