"""The tensor files of the RGL database [Dupuy 2018]: named arrays, each claim of the header held against the file."""

import math
import os
import struct
from typing import NoReturn

import numpy as np

from gonio.data.files import input_size
from gonio.models.errors import GonioError

MAGIC = b"tensor_file\0"
DTYPES = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<u8", 8: "<i8", 9: "<f2", 10: "<f4", 11: "<f8"}
MAX_DIMENSIONS = 16


def read_tensors(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The arrays of a tensor file by name. Raises GonioError where the header and the file disagree in any way."""
    input_size(path)
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
        if offset + count * dtype.itemsize > len(self.data):
            self.fail(f"puts field {name!r} ({count} values at byte {offset}) outside its {len(self.data)} bytes")
        return name, np.frombuffer(self.data, dtype, count, offset).reshape(shape)
