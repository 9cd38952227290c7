"""Global heaps of an HDF5 file, walked before the library does: it never returns from a damaged one."""

import mmap
import os

SIGNATURE = b"GCOL\x01\x00\x00\x00"
HEADER = 16
SEARCHED = 64 << 20
"""Bytes that are searched: texts stand at the front, and to look through all of a large table takes seconds."""


def damaged_heap(path: str | os.PathLike[str]) -> int | None:
    """Offset of the first collection of heap objects whose chain does not end where it should; None if all do.

    Layout by the HDF5 File Format Specification, III.E: objects of (index, uses, reserved, size); index 0 is what is
    left over, and its size counts its own header. The library loops for ever where that size is 0.
    """
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = content.find(SIGNATURE, 0, SEARCHED)
        while start >= 0:
            size = int.from_bytes(content[start + 8 : start + 16], "little")
            if not _ends_where_it_should(content, start + HEADER, start + size):
                return start
            start = content.find(SIGNATURE, start + size, SEARCHED)
    return None


def _ends_where_it_should(file: mmap.mmap, start: int, end: int) -> bool:
    if not start <= end <= len(file):
        return False
    while start + HEADER <= end:
        index = int.from_bytes(file[start : start + 2], "little")
        size = int.from_bytes(file[start + 8 : start + 16], "little")
        if index == 0:
            return start + size == end
        start += HEADER + (size + 7) // 8 * 8
    return start <= end
