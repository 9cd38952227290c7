"""Texts in an HDF5 file's own bytes: the library believes their lengths, and takes as much memory as they claim.

Layout by the HDF5 File Format Specification: III.E (global heap), IV.A.2.m (attribute message).
"""

import mmap
from collections.abc import Iterator, Sequence
from typing import NamedTuple

Content = bytes | mmap.mmap
HEAP, HEAP_HEADER = b"GCOL\x01\x00\x00\x00", 16
SEARCHED = 64 << 20
"""Bytes that are searched first: texts stand at the front, and to look through a large table takes seconds."""
VARIABLE_LENGTH = 9
"""Class of a datatype."""
MESSAGE_VERSION = 3
"""Of attributes whose fields are not padded and whose header ends in a byte for the character set."""


def has_damaged_heap(content: Content) -> bool:
    """Whether the chain of some collection of heap objects does not end where it should.

    The library never returns from such a file.
    """
    start = content.find(HEAP, 0, SEARCHED)
    while start >= 0:
        if heap_objects(content, start) is None:
            return True
        start = content.find(HEAP, start + _number(content, start + 8, 8), SEARCHED)
    return False


class HeapObject(NamedTuple):
    """One object of a collection."""

    length: int
    """Bytes."""
    start: int
    """Of its bytes in the file."""


def heap_objects(content: Content, start: int) -> dict[int, HeapObject] | None:
    """The objects of the collection that begins at `start`, by index; None: there is no whole one.

    Objects are (index, uses, reserved, size, bytes); index 0 is what is left over, and its size counts its own header.
    """
    end, position = start + _number(content, start + 8, 8), start + HEAP_HEADER
    if content[start : start + len(HEAP)] != HEAP or not position <= end <= len(content):
        return None
    objects = {}
    while position + HEAP_HEADER <= end:
        index, length = _number(content, position, 2), _number(content, position + 8, 8)
        if index == 0:
            return objects if position + length == end else None
        objects[index] = HeapObject(length, position + HEAP_HEADER)
        position += HEAP_HEADER + _padded(length)
    return objects if position <= end else None


def heap_text(content: Content, place: int, base: int = 0) -> str | None:
    """The text of variable length whose length, address and index stand at `place`; None where it is damaged.

    `base`: bytes before the HDF5 part, from which addresses count.
    """
    length, address, index = (_number(content, place + skip, size) for skip, size in ((0, 4), (4, 8), (12, 4)))
    if not length:
        return ""
    stored = (heap_objects(content, base + address) or {}).get(index)
    if stored is None or stored.length != length:
        return None
    return content[stored.start : stored.start + length].rstrip(b"\0").decode("utf-8", "replace")


def has_damaged_text(content: Content, name: str, base: int = 0, values: Sequence[tuple[int, int]] = ()) -> bool:
    """Whether an attribute of this name, which the library has found, holds a text of another length than it claims.

    Args:
        content: the file.
        name: of the attribute.
        base: bytes before the HDF5 part, from which addresses count.
        values: ranges (start, stop) of bytes that hold large variables, in order; they are searched last.
    """
    references: list[int] = []
    start = 0
    for low, high in (*values, (SEARCHED, SEARCHED)):
        references += _text_references(content, name, start, min(low, SEARCHED))
        start = max(start, high)
    references = references or list(_text_references(content, name, 0, len(content)))
    for place in references:
        if heap_text(content, place, base) is None:
            return True
    return not references


def _text_references(content: Content, name: str, start: int, stop: int) -> Iterator[int]:
    """Where attributes of this name that hold a text of variable length store its length, address and index."""
    word = name.encode() + b"\0"
    while (start := content.find(word, start, stop)) >= 0:
        packed = start >= MESSAGE_VERSION * 3 and content[start - 9] == MESSAGE_VERSION
        sizes = start - (7 if packed else 6)
        name_size, type_size, space_size = (_number(content, sizes + skip, 2) for skip in (0, 2, 4))
        pad = _padded if content[start - 8] == 1 and not packed else int
        kind = start + pad(name_size)
        place = kind + pad(type_size) + pad(space_size)
        if name_size == len(word) and place + 16 <= len(content) and content[kind] & 15 == VARIABLE_LENGTH:
            yield place
        start += 1


def _number(content: Content, start: int, size: int) -> int:
    return int.from_bytes(content[start : start + size], "little")


def _padded(length: int) -> int:
    return (length + 7) // 8 * 8
