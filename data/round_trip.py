"""What a table loses in a file of another format, measured by reading the file again."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from gonio.data.flags import Flag


@dataclasses.dataclass(frozen=True)
class RoundTrip:
    """Differences between a table and what is read back from the file just written, over `compared` readings."""

    compared: int
    max_absolute: float
    """1/sr."""
    max_relative: float
    """Largest |a − b| / |a|, where a is not 0."""
    rms_relative: float
    """Root mean square of a − b over that of a."""
    lost: int
    """Valid readings that the file could not hold."""
    note: str = ""

    def __str__(self) -> str:
        lost = f", {self.lost} readings lost" if self.lost else ""
        note = f" ({self.note})" if self.note else ""
        return (
            f"round trip over {self.compared} readings: largest difference {self.max_absolute:.3g} sr^-1, "
            f"{self.max_relative:.3g} relative, rms {self.rms_relative:.3g} relative{lost}{note}"
        )


def compare(
    written: np.ndarray, read: np.ndarray, was_valid: np.ndarray, is_valid: np.ndarray, note: str = ""
) -> RoundTrip:
    """The round trip of values ``(n, channels)`` with their validity, cell by cell."""
    both = was_valid & is_valid
    a, b = (np.asarray(v, np.float64)[both] for v in (written, read))
    difference, size = np.abs(a - b), np.abs(a)
    nonzero = size > 0
    largest = float(size.max(initial=0.0))
    # In units of the largest value: squares of what a float can hold overflow.
    unit = largest if largest > 0 else 1.0
    rms = float(np.sqrt(np.sum((difference / unit) ** 2) / max(np.sum((size / unit) ** 2), 1e-300)))
    return RoundTrip(
        compared=int(both.sum()),
        max_absolute=float(difference.max(initial=0.0)),
        max_relative=float((difference[nonzero] / size[nonzero]).max(initial=0.0)),
        rms_relative=rms if largest > 0 else 0.0,
        lost=int((was_valid & ~is_valid).sum()),
        note=note,
    )


def compare_cells(written: Mapping[str, np.ndarray], read: Mapping[str, np.ndarray], note: str = "") -> RoundTrip:
    """The round trip of the values of a table (`Table.read_values`) into one with the same cells in the same order."""
    f = np.broadcast_to(written["f"], read["f"].shape)
    valid = np.broadcast_to(written["flag"] == Flag.VALID, f.shape)
    return compare(f, read["f"], valid, read["flag"] == Flag.VALID, note)
