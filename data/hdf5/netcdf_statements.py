"""What netCDF's own attributes say of a table's variables that changes their values or their order.

gonio writes none of it. Other writers of netCDF do (xarray with an encoding, `transpose`, `isel`), and values read
without it are wrong at the same shape.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import h5py
import numpy as np
from h5py import h5o  # pyright: ignore[reportAttributeAccessIssue]  # the stubs lack it

from gonio.data.formats.csv.header import PER_STERADIAN
from gonio.data.hdf5.stored_texts import Content, heap_text

REFERENCE_BYTES = 8
"""Of an object's address in a list of references, before the number of the dimension."""
LONGEST_LIST = 1000
"""Variables that share an axis, at most."""


def packing(attribute: Callable[[str], Any]) -> str | None:
    """What is wrong with reading a variable's numbers as they are stored; None where nothing is.

    `attribute`: the value of one of its attributes, a number, or None.
    """
    for name, plain in (("scale_factor", 1.0), ("add_offset", 0.0)):
        if (value := attribute(name)) is not None and value != plain:
            return f"is packed ({name} {value:g}); write it unpacked, as floats"
    for name in ("_FillValue", "missing_value"):
        if (value := attribute(name)) is not None and not math.isnan(value):
            return f"writes {value:g} where it has no value ({name}); write NaN there, and no {name}"
    return None


def wrong_unit(unit: str | None) -> str | None:
    """What is wrong with a unit of f; None where it is 1/sr, or not stated."""
    if unit is None or "".join(unit.lower().split()) in PER_STERADIAN:
        return None
    return f"has units {unit[:20]!r}, expected 'sr-1'; convert it first"


def exchanged_dimensions(node: h5py.Dataset, scales: Iterable[tuple[str, h5py.Dataset]]) -> str | None:
    """What is wrong with the order of a variable's dimensions; None where its scales stand for them in this order.

    Args:
        node: the variable.
        scales: the dimensions' (name, scale) in the order that a table has them.
    """
    address = h5o.get_info(node.id).addr
    for k, (name, scale) in enumerate(scales):
        numbers = [dimension for variable, dimension in _uses(scale) if variable == address]
        if numbers and k not in numbers:
            return f"has {name} as dimension {numbers[0] + 1}, expected {k + 1}; transpose it"
    return None


def _uses(scale: h5py.Dataset) -> list[tuple[int, int]]:
    """(address of a variable, number of its dimension) wherever a dimension's scale is said to be used."""
    name = "REFERENCE_LIST"
    if name not in scale.attrs:
        return []
    stored = scale.attrs.get_id(name)
    kind, count = stored.get_type(), math.prod(stored.shape)
    size = kind.get_size()
    if kind.get_class() != h5py.h5t.COMPOUND or not REFERENCE_BYTES < size <= 64 or not 0 < count <= LONGEST_LIST:
        return []
    # The bytes as they are: to follow references of a stranger's file is not needed.
    raw = np.zeros(count, f"V{size}")
    stored.read(raw, mtype=kind)
    rows = raw.view(np.uint8).reshape(count, size)
    addresses = np.ascontiguousarray(rows[:, :REFERENCE_BYTES]).view("<u8").ravel()
    dimensions = np.ascontiguousarray(rows[:, REFERENCE_BYTES : REFERENCE_BYTES + 4]).view("<u4").ravel()
    return list(zip(addresses.tolist(), dimensions.tolist(), strict=True))


def other_names(node: h5py.Dataset, names: Sequence[str], content: Content, base: int) -> str | None:
    """The channels by a file's coordinate where it has `names` in another order; None where not, or not known.

    Args:
        node: the coordinate, texts of variable length.
        names: of the channels, as the table has them.
        content: the file.
        base: bytes before the HDF5 part.
    """
    start = node.id.get_offset()
    if not h5py.check_string_dtype(node.dtype) or node.dtype.kind != "O" or start is None or node.size != len(names):
        return None
    texts = [heap_text(content, start + 16 * k, base) for k in range(len(names))]
    known = [text for text in texts if text is not None]
    return ", ".join(known)[:80] if sorted(known) == sorted(names) and known != list(names) else None
