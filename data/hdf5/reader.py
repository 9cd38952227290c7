"""Opening a table's HDF5 file: what a stranger's file claims is held against the file before it is believed."""

import functools
import json
import math
import mmap
import os
from collections.abc import Callable, Mapping
from types import UnionType
from typing import Any, NoReturn, TypeVar

import h5py
import numpy as np

from gonio.data.channels import LONGEST_NAME, Channels
from gonio.data.files import input_size
from gonio.data.hdf5.netcdf_statements import exchanged_dimensions, other_names, packing, wrong_unit
from gonio.data.hdf5.schema import FOOTER, GONIO_FORMAT, MAGIC, PROFILE_LAYOUT, RECORD
from gonio.data.hdf5.stored_texts import has_damaged_heap, has_damaged_text
from gonio.data.layouts import LAYOUTS, Layout
from gonio.data.plausibility.consistency import check_readings
from gonio.data.profile import Profile
from gonio.data.serialise import deepest, encodable, require_kind
from gonio.data.table import Table
from gonio.models.errors import GonioError, one_line

LAZY_BYTES = 256 << 20
"""Values beyond this stay in the file and are read block by block."""
BLOCKWISE_BYTES = 16 << 20
"""The same for what goes through a table block by block anyway; values that are packed are unpacked once all the same.
"""
LEAST_SKIPPED = 1 << 20
"""Bytes of a variable from which no text is looked for in its values, but where there is none elsewhere."""
MOST_UNPACKED = 100
"""Bytes beyond `LAZY_BYTES` that may come out of one packed byte: readings, unlike a bomb, do not pack better."""
MAX_DEFLATE = 1100
"""Deflate packs at most 1032 bytes into one: a dataset that claims more than this lies about its size."""
DEEPEST = 32
"""Lists and objects inside one another in a JSON attribute."""
MOST_WARNINGS = 20
LONGEST_JSON = 16 << 20
"""Characters of a JSON attribute."""
REPACK = "write it unpacked (h5repack -f NONE -l CONTI)"
RADIANS = {"radian": 1.0, "radians": 1.0, "rad": 1.0, "degree": math.pi / 180, "degrees": math.pi / 180}

SIGNATURE = b"\x89HDF\r\n\x1a\n"

T = TypeVar("T")


def holds_profile(path: str | os.PathLike[str]) -> bool:
    """Whether a file is one of a profile; False for any other, and for what is no file."""
    try:
        input_size(path)  # no pipe is waited for
        with open(path, "rb") as start:
            if start.read(len(SIGNATURE)) != SIGNATURE:
                return False
        return _opened(path, lambda reader: reader.attribute("layout", str)) == PROFILE_LAYOUT
    except (GonioError, OSError):
        return False


def open_profile(path: str | os.PathLike[str]) -> Profile:
    """The profile of an HDF5 file. Raises GonioError, naming the file and what is wrong, for anything else."""
    return _opened(path, lambda reader: reader.profile())


def open_table(path: str | os.PathLike[str], lazy_bytes: int = LAZY_BYTES, packed_bytes: int = LAZY_BYTES) -> Table:
    """The table of an HDF5 file that gonio wrote (format 1 or older).

    Values stay in the file beyond `lazy_bytes`, those that are packed beyond `packed_bytes` if that is more. Raises
    GonioError, naming the file and what is wrong, for anything else: truncated, foreign, newer, inconsistent.
    """
    return _opened(path, lambda reader: reader.table(lazy_bytes, packed_bytes), keep=True)


def _opened(path: str | os.PathLike[str], read: "Callable[[_Reader], T]", keep: bool = False) -> T:
    """What `read` makes of a file; `keep`: it stays open."""
    input_size(path)
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if progress := _unfinished(content):
            raise GonioError(
                f"{path} is an unfinished measurement ({progress} blocks); run the same command again to go on with it"
            )
        if has_damaged_heap(content):
            raise GonioError(f"{path} is a damaged table (its texts run into each other); measure or copy it again")
        return _checked(path, content, read, keep)


def _checked(path: str | os.PathLike[str], content: mmap.mmap, read: "Callable[[_Reader], T]", keep: bool) -> T:
    try:
        file = h5py.File(path, "r")
    except OSError:
        message = f"{path} is not a whole HDF5 file (truncated, or another format); measure or copy it again"
        raise GonioError(message) from None
    try:
        result = read(_Reader(file, content))
        if not keep:
            file.close()
        return result
    except GonioError as error:
        file.close()
        raise GonioError(f"{path}: {error}") from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError) as error:
        file.close()
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise GonioError(f"{path} is a damaged table ({text}); measure or copy it again") from None


def _unfinished(content: mmap.mmap) -> str | None:
    """Progress of a writer, '3 of 4', by the file's tail; None for a file without one, or with all blocks written."""
    tail = content[-FOOTER.size :]
    if len(tail) < FOOTER.size or not tail.endswith(MAGIC):
        return None
    count = FOOTER.unpack(tail)[1]
    start = len(content) - FOOTER.size - count * RECORD.itemsize
    if start < 0:
        return None
    done = np.count_nonzero(np.frombuffer(content[start : -FOOTER.size], RECORD)["done"])
    return None if done == count else f"{done} of {count}"


def _plain(kind: h5py.h5t.TypeID) -> bool:
    """Whether an attribute's type is one that the library reads safely: it crashes on a damaged text type."""
    if kind.committed():
        return False
    if kind.get_class() in (h5py.h5t.INTEGER, h5py.h5t.FLOAT):
        return True
    if kind.get_class() != h5py.h5t.STRING or not kind.is_variable_str():
        return kind.get_class() == h5py.h5t.STRING
    return any(kind.equal(h5py.h5t.py_create(h5py.string_dtype(code), logical=True)) for code in ("utf-8", "ascii"))


def _fail(text: str) -> NoReturn:
    raise GonioError(text)


class _Reader:
    def __init__(self, file: h5py.File, content: mmap.mmap) -> None:
        self.file, self.content, self.bytes = file, content, len(content)

    def require_version(self) -> None:
        version = self.attribute("gonio_format", int | float | str)
        if version is None:
            _fail("an HDF5 file, but no table of gonio (no attribute gonio_format); see gonio convert")
        if not isinstance(version, int) or not 1 <= version <= GONIO_FORMAT:
            _fail(f"its format is gonio_format {version}, this gonio reads up to {GONIO_FORMAT}; install a newer one")

    @functools.cached_property
    def values(self) -> list[tuple[int, int]]:
        """Ranges of bytes of the file that hold nothing but the values of large variables, in order."""
        ranges = []
        for name in ("f", "u_f", "flag"):
            if isinstance(self.file.get(name, getlink=True), h5py.HardLink) and isinstance(
                node := self.file[name], h5py.Dataset
            ):
                start, size = node.id.get_offset(), node.id.get_storage_size()
                if start is not None and size >= LEAST_SKIPPED:
                    ranges.append((start, start + size))
        return sorted(ranges)

    def table(self, lazy_bytes: int, packed_bytes: int) -> Table:
        self.require_version()
        if self.attribute("layout", str) == PROFILE_LAYOUT:
            _fail("it is a profile of light below a surface, and no table; fit, check, quantities and report take it")
        f, flag, u_f = (self.node(name) for name in ("f", "flag", "u_f"))
        if f.dtype.kind != "f" or f.dtype.itemsize not in (4, 8) or u_f.dtype != f.dtype or flag.dtype != np.uint8:
            _fail(f"f, u_f and flag have types {f.dtype}, {u_f.dtype}, {flag.dtype}; expected floats and uint8")
        names, count = self.json("channel_names", list), f.shape[-1] if f.shape else 0
        if len(names) != count:
            _fail(f"it names {len(names)} channels but holds {count}; copy it again")
        wavelengths, (kind, axes) = self.wavelengths(count), self.axes()
        fields: dict[str, Any] = {
            "provenance": self.provenance(),
            "source_solid_angle": self.solid_angle("source_solid_angle_sr"),
            "receiver_solid_angle": self.solid_angle("receiver_solid_angle_sr"),
            "name": one_line(self.attribute("title", str) or "", LONGEST_NAME),
        }
        layout, channels = kind(axes), Channels(tuple(names), wavelengths)
        shape, nodes = (*layout.shape, len(channels)), {"f": f, "flag": flag, "u_f": u_f}
        self.require_plain(nodes, layout, channels)
        for name, node in nodes.items():
            if node.shape != shape:
                _fail(f"{name} has shape {node.shape}, but its axes and channels make {shape}")
            if self.stored(node):
                # JAX takes numbers of this machine's byte order only.
                most = max(lazy_bytes, packed_bytes) if node.chunks else lazy_bytes
                fields[name] = node if f.nbytes > most else node[...].astype(node.dtype.newbyteorder("="), copy=False)
            elif name != "u_f":
                _fail("f or flag hold no values; measure it again")
            elif not np.isnan(value := self.value_of_all(node)):
                fields[name] = np.broadcast_to(value, shape)
        table = Table(layout=layout, channels=channels, **fields)
        check_readings(table)
        return table

    def profile(self) -> Profile:
        self.require_version()
        if self.attribute("layout", str) != PROFILE_LAYOUT:
            _fail("it is no profile of light below a surface; measure one with gonio measure MATERIAL --scan offsets")
        nodes = {name: self.node(name) for name in ("offset", "R", "u_R", "flag")}
        for name, node in nodes.items():
            if not self.stored(node) or node.nbytes > LAZY_BYTES:
                _fail(f"variable {name} holds no values or far too many ({node.shape}); measure or copy it again")
        units = [self.attribute("units", str, nodes[name]) for name in ("offset", "R")]
        if units != ["mm", "mm-2"]:
            _fail(
                f"offset and R have units {units[0]!r} and {units[1]!r}, expected 'mm' and 'mm-2'; convert them first"
            )
        names = self.json("channel_names", list)
        offset, value, u, flag = (
            np.asarray(n[...], np.uint8 if name == "flag" else float) for name, n in nodes.items()
        )
        radii = [self.attribute(f"{spot}_radius_mm", int | float) for spot in ("illuminated", "viewed")]
        if None in radii:
            _fail("the radii of its spots are missing; measure or copy it again")
        channels = Channels(tuple(names), self.wavelengths(len(names)))
        name = one_line(self.attribute("title", str) or "", LONGEST_NAME)
        return Profile(offset, value, u, flag, channels, radii[0], radii[1], self.provenance(), name)

    def node(self, name: str) -> h5py.Dataset:
        link = self.file.get(name, getlink=True)
        if link is None:
            _fail(f"variable {name} is missing; measure or copy it again")
        # A link or a virtual dataset could lead to another file of whoever opens this one.
        node = self.file[name] if isinstance(link, h5py.HardLink) else None
        if not isinstance(node, h5py.Dataset) or node.is_virtual or node.external:
            _fail(f"variable {name} is not stored in the file itself; copy the values into it")
        if node.dtype.kind not in "fiu":
            _fail(f"variable {name} has type {node.dtype}; expected numbers")
        size = node.id.get_storage_size()
        limit = MAX_DEFLATE * size if node.chunks else self.bytes
        if self.stored(node) and (size > self.bytes or node.nbytes > limit):
            _fail(f"variable {name} claims {node.nbytes} bytes, more than the file can hold; copy it again")
        if node.chunks and math.prod(node.chunks) * node.dtype.itemsize > LAZY_BYTES:
            _fail(f"variable {name} is packed in blocks of more than {LAZY_BYTES >> 20} MiB; {REPACK}")
        if node.nbytes > max(LAZY_BYTES, MOST_UNPACKED * self.bytes):
            _fail(f"variable {name} unpacks to {node.nbytes >> 20} MiB, of a file of {self.bytes} bytes; {REPACK}")
        return node

    def require_plain(self, nodes: Mapping[str, h5py.Dataset], layout: Layout, channels: Channels) -> None:
        """Refuses variables that netCDF's attributes say to be packed, of another unit or in another order."""
        names = [*layout.dims, "channel"]
        scales = [(name, self.node(name)) for name in names if name != "channel" and self.has(name)]
        for name, node in nodes.items():
            unit = None if name == "flag" else self.attribute("units", str, node)
            wrong = packing(lambda a, node=node: self.attribute(a, int | float, node)) or wrong_unit(unit)
            wrong = wrong or (exchanged_dimensions(node, scales) if layout.gridded else None)
            if wrong:
                _fail(f"variable {name} {wrong}")
        if isinstance(self.file.get("channel", getlink=True), h5py.HardLink):
            node = self.file["channel"]
            base = self.file.userblock_size
            if isinstance(node, h5py.Dataset) and (other := other_names(node, channels.names, self.content, base)):
                _fail(
                    f"its channels are {other} by the coordinate channel, but {', '.join(channels.names)[:80]} by the "
                    "attribute channel_names; write the attribute anew"
                )

    @staticmethod
    def value_of_all(node: h5py.Dataset) -> float:
        """The value of a variable without stored ones; ValueError where it is damaged, of which h5py itself crashes."""
        defined = node.id.get_create_plist().fill_value_defined()
        return node.fillvalue if defined == h5py.h5d.FILL_VALUE_USER_DEFINED else math.nan

    def has(self, name: str) -> bool:
        """Whether there is a variable, or a link, of this name; no link is followed."""
        return self.file.get(name, getlink=True) is not None

    @staticmethod
    def stored(node: h5py.Dataset) -> bool:
        return node.id.get_storage_size() > 0

    def axes(self) -> tuple[type[Layout], dict[str, np.ndarray]]:
        """The kind of the layout, and its axes in radians."""
        name = self.attribute("layout", str)
        if name not in LAYOUTS:
            _fail(f"layout {name!r} is unknown; expected one of {', '.join(LAYOUTS)}")
        kind, axes = LAYOUTS[name], {}
        for axis in (k.name for k in kind.axis_kinds if k.name not in kind.optional_axes or self.has(k.name)):
            node = self.node(axis)
            unit = self.attribute("units", str, node)
            if unit not in RADIANS:
                _fail(f"axis {axis} has units {unit!r}, expected 'radian' or 'degree'; convert it first")
            if not self.stored(node) or node.nbytes > LAZY_BYTES:
                _fail(f"axis {axis} holds no values or far too many ({node.shape}); measure or copy it again")
            axes[axis] = node[...] * RADIANS[unit]
        return kind, axes

    def wavelengths(self, count: int) -> tuple[float, ...] | None:
        if not self.has("wavelength"):
            return None
        node = self.node("wavelength")
        unit = self.attribute("units", str, node)
        if node.shape != (count,) or unit != "nm":
            _fail(f"wavelength has shape {node.shape} and units {unit!r}, expected one each in nm")
        return tuple(node[...])

    def solid_angle(self, name: str) -> float | None:
        value = self.attribute(name, int | float)
        if value is not None and not 0 <= value <= 2 * math.pi * (1 + 1e-9):
            _fail(f"attribute {name} is {value:g} sr; expected a solid angle from 0 to 2π")
        return value

    def attribute(self, name: str, kind: type | UnionType, node: h5py.Dataset | None = None) -> Any:
        """A Python value of this kind, or None; netCDF writers wrap a single number in an array."""
        attributes = (self.file if node is None else node).attrs
        if name not in attributes:
            return None
        stored = attributes.get_id(name)
        if stored.shape not in ((), (1,)) or not _plain(stored.get_type()):
            _fail(f"attribute {name} is neither a text nor a number; copy the file again")
        if stored.dtype.kind == "O" and has_damaged_text(self.content, name, self.file.userblock_size, self.values):
            _fail(f"attribute {name} does not hold the text that it claims; measure or copy it again")
        value = attributes[name]
        value = value.item() if isinstance(value, np.generic | np.ndarray) and value.size == 1 else value
        value = value.decode() if isinstance(value, bytes) else value
        if not isinstance(value, kind):
            _fail(f"attribute {name} is {value!r}, expected a {'text' if kind is str else 'number'}")
        return value

    def provenance(self) -> dict[str, Any]:
        """The provenance; the warnings in it, which every verb repeats, are short lines."""
        about = self.json("provenance", dict)
        require_kind(about, {"warnings": [str]}, "provenance")
        if "warnings" in about:
            about["warnings"] = [one_line(warning) for warning in about["warnings"][:MOST_WARNINGS]]
        return about

    def json(self, name: str, kind: type[T]) -> T:
        text = self.attribute(name, str) or "null"
        try:
            if len(text) > LONGEST_JSON or deepest(text) > DEEPEST:
                _fail(f"attribute {name} is longer or deeper than any text that gonio writes; copy the file again")
            value = json.loads(text)
        except ValueError as error:
            if isinstance(error, GonioError):
                raise
            value = None
        if not isinstance(value, kind):
            _fail(f"attribute {name} is no JSON {kind.__name__}; copy the file again")
        return encodable(value)
