"""Opening a table's HDF5 file: what a stranger's file claims is held against the file before it is believed."""

import json
import math
import os
from collections.abc import Callable
from typing import Any, NoReturn, TypeVar

import h5py
import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import input_size
from gonio.data.hdf5.block_writer import FOOTER, MAGIC, RECORD
from gonio.data.hdf5.heap_check import damaged_heap
from gonio.data.hdf5.schema import GONIO_FORMAT
from gonio.data.layouts import LAYOUTS, Layout
from gonio.data.table import Table
from gonio.models.errors import GonioError

LAZY_BYTES = 256 << 20
"""Values beyond this stay in the file and are read block by block."""
MAX_DEFLATE = 1100
"""Deflate packs at most 1032 bytes into one: a dataset that claims more than this lies about its size."""
RADIANS = {"radian": 1.0, "radians": 1.0, "rad": 1.0, "degree": math.pi / 180, "degrees": math.pi / 180}

Kind = TypeVar("Kind", dict, list)


def open_table(path: str | os.PathLike[str], lazy_bytes: int = LAZY_BYTES) -> Table:
    """The table of an HDF5 file that gonio wrote (format 1 or older); values stay in the file beyond
    `lazy_bytes`.

    Raises GonioError, naming the file and what is wrong, for anything else: truncated, foreign, newer,
    inconsistent.
    """
    if done := _unfinished(path, input_size(path)):
        raise GonioError(
            f"{path} is an unfinished measurement ({done} blocks); run the same command again to go on with it"
        )
    if damaged_heap(path) is not None:
        raise GonioError(f"{path} is a damaged table (its texts run into each other); measure or copy it again")
    try:
        file = h5py.File(path, "r")
    except OSError:
        message = f"{path} is not a whole HDF5 file (truncated, or another format); measure or copy it again"
        raise GonioError(message) from None
    try:
        return _Reader(file, str(path)).table(lazy_bytes)
    except GonioError:
        file.close()
        raise
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError) as error:
        file.close()
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise GonioError(f"{path} is a damaged table ({text}); measure or copy it again") from None


def _unfinished(path: str | os.PathLike[str], size: int) -> str | None:
    """Progress of a writer, '3 of 4', by the file's tail; None for a file without one, or with all blocks written."""
    with open(path, "rb") as file:
        file.seek(max(size - FOOTER.size, 0))
        tail = file.read()
        if len(tail) < FOOTER.size or not tail.endswith(MAGIC):
            return None
        count = FOOTER.unpack(tail)[1]
        start = size - FOOTER.size - count * RECORD.itemsize
        if start < 0:
            return None
        file.seek(start)
        done = np.count_nonzero(np.frombuffer(file.read(count * RECORD.itemsize), RECORD)["done"])
    return None if done == count else f"{done} of {count}"


def _plain(kind: h5py.h5t.TypeID) -> bool:
    """Whether an attribute's type is one that the library reads safely: it crashes on a damaged text type."""
    if kind.get_class() in (h5py.h5t.INTEGER, h5py.h5t.FLOAT):
        return True
    if kind.get_class() != h5py.h5t.STRING or not kind.is_variable_str():
        return kind.get_class() == h5py.h5t.STRING
    return any(kind.equal(h5py.h5t.py_create(h5py.string_dtype(code), logical=True)) for code in ("utf-8", "ascii"))


class _Reader:
    def __init__(self, file: h5py.File, path: str) -> None:
        self.file, self.path, self.bytes = file, path, os.path.getsize(path)

    def fail(self, text: str) -> NoReturn:
        raise GonioError(f"{self.path}: {text}")

    def table(self, lazy_bytes: int) -> Table:
        version = self.attribute("gonio_format")
        if version is None:
            self.fail("an HDF5 file, but no table of gonio (no attribute gonio_format); see gonio convert")
        if not isinstance(version, int) or not 1 <= version <= GONIO_FORMAT:
            self.fail(
                f"its format is gonio_format {version}, this gonio reads up to {GONIO_FORMAT}; install a newer one"
            )
        layout = self.layout()
        f, flag, u_f = (self.node(name) for name in ("f", "flag", "u_f"))
        if f.dtype.kind != "f" or f.dtype.itemsize not in (4, 8) or u_f.dtype != f.dtype or flag.dtype != np.uint8:
            self.fail(f"f, u_f and flag have types {f.dtype}, {u_f.dtype}, {flag.dtype}; expected floats and uint8")
        channels = self.channels(f.shape[-1] if f.shape else 0)
        shape = (*layout.shape, len(channels))
        for node in (f, u_f, flag):
            if node.shape != shape:
                self.fail(f"{node.name} has shape {node.shape}, but its axes and channels make {shape}")
        if self.unstored(f) or self.unstored(flag):
            self.fail("f or flag hold no values; measure it again")

        def load(node: h5py.Dataset) -> Any:
            return node if f.nbytes > lazy_bytes else node[...]

        return Table(
            layout=layout,
            f=load(f),
            flag=load(flag),
            u_f=self.uncertainty(u_f, load),
            channels=channels,
            provenance=self.json("provenance", dict),
            source_solid_angle=self.number("source_solid_angle_sr"),
            receiver_solid_angle=self.number("receiver_solid_angle_sr"),
            name=self.text("title") or "",
        )

    def node(self, name: str) -> h5py.Dataset:
        link = self.file.get(name, getlink=True)
        if link is None:
            self.fail(f"variable {name} is missing; measure or copy it again")
        # A link or a virtual dataset could lead to another file of whoever opens this one.
        node = self.file[name] if isinstance(link, h5py.HardLink) else None
        if not isinstance(node, h5py.Dataset) or node.is_virtual or node.external:
            self.fail(f"variable {name} is not stored in the file itself; copy the values into it")
        if node.dtype.kind not in "fiu":
            self.fail(f"variable {name} has type {node.dtype}; expected numbers")
        stored = node.id.get_storage_size()
        limit = MAX_DEFLATE * stored if node.chunks else self.bytes
        if not self.unstored(node) and (stored > self.bytes or node.nbytes > limit):
            self.fail(f"variable {name} claims {node.nbytes} bytes, more than the file can hold; copy it again")
        return node

    @staticmethod
    def unstored(node: h5py.Dataset) -> bool:
        return node.id.get_storage_size() == 0

    def layout(self) -> Layout:
        name = self.text("layout")
        if name not in LAYOUTS:
            self.fail(f"layout {name!r} is unknown; expected one of {', '.join(LAYOUTS)}")
        kind = LAYOUTS[name]
        names = [k.name for k in kind.axis_kinds if k.name not in kind.optional_axes or k.name in self.file]
        return kind({axis: self.axis(axis) for axis in names})

    def axis(self, name: str) -> np.ndarray:
        node = self.node(name)
        unit = self.text("units", node)
        if unit not in RADIANS:
            self.fail(f"axis {name} has units {unit!r}, expected 'radian' or 'degree'; convert it first")
        if self.unstored(node) or node.nbytes > LAZY_BYTES:
            self.fail(f"axis {name} holds no values or far too many ({node.shape}); measure or copy it again")
        return node[...] * RADIANS[unit]

    def channels(self, count: int) -> Channels:
        names = self.json("channel_names", list)
        if len(names) != count:
            self.fail(f"it names {len(names)} channels but holds {count}; copy it again")
        if "wavelength" not in self.file:
            return Channels(tuple(names))
        node = self.node("wavelength")
        if node.shape != (count,) or self.text("units", node) != "nm":
            self.fail(
                f"wavelength has shape {node.shape} and units {self.text('units', node)!r}, expected one each in nm"
            )
        return Channels(tuple(names), tuple(node[...]))

    def uncertainty(self, node: h5py.Dataset, load: Callable[[h5py.Dataset], Any]) -> Any:
        if not self.unstored(node):
            return load(node)
        return None if np.isnan(node.fillvalue) else np.broadcast_to(node.fillvalue, node.shape)

    def attribute(self, name: str, node: h5py.Dataset | None = None) -> Any:
        """A Python value, or None; netCDF writers wrap a single number in an array."""
        attributes = (self.file if node is None else node).attrs
        if name not in attributes:
            return None
        stored = attributes.get_id(name)
        if stored.shape not in ((), (1,)) or not _plain(stored.get_type()):
            self.fail(f"attribute {name} is neither a text nor a number; copy the file again")
        value = attributes[name]
        return value.item() if isinstance(value, np.generic | np.ndarray) and value.size == 1 else value

    def text(self, name: str, node: h5py.Dataset | None = None) -> str | None:
        value = self.attribute(name, node)
        if isinstance(value, bytes):
            value = value.decode()
        if value is not None and not isinstance(value, str):
            self.fail(f"attribute {name} is {value!r}, expected a text")
        return value

    def json(self, name: str, kind: type[Kind]) -> Kind:
        text = self.text(name)
        try:
            value = json.loads(text or "null")
        except (json.JSONDecodeError, RecursionError):
            value = None
        if not isinstance(value, kind):
            self.fail(f"attribute {name} is no JSON {kind.__name__}; copy the file again")
        return value

    def number(self, name: str) -> float | None:
        value = self.attribute(name)
        if value is None:
            return None
        if not isinstance(value, int | float):
            self.fail(f"attribute {name} is {value!r}, expected a number")
        return float(value)
