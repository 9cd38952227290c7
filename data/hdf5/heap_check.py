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
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as whole:
        at = whole.find(SIGNATURE, 0, SEARCHED)
        while at >= 0:
            size = int.from_bytes(whole[at + 8 : at + 16], "little")
            if not _whole(whole, at + HEADER, at + size):
                return at
            at = whole.find(SIGNATURE, at + size, SEARCHED)
    return None


def _whole(whole, at: int, end: int) -> bool:
    if not at <= end <= len(whole):
        return False
    while at + HEADER <= end:
        index = int.from_bytes(whole[at : at + 2], "little")
        size = int.from_bytes(whole[at + 8 : at + 16], "little")
        if index == 0:
            return at + size == end
        at += HEADER + (size + 7) // 8 * 8
    return at <= end
