"""The pace of a real instrument: how long its axes move between two directions, and the seconds of a whole scan."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.layouts import Layout
from gonio.models.errors import GonioError

Angles = Sequence[np.ndarray] | np.ndarray
"""Arrays of theta_i, phi_i, theta_o and phi_o, radians."""
PART_CELLS = 1 << 18
"""Cells of a scan whose way is followed at once: what that takes of memory does not grow with the scan."""
MOST_PARTS = 16
"""Parts of a scan whose way is followed; of a larger one so many, evenly spread, stand for the others."""
AXES = ("theta_i", "phi_i", "theta_o", "phi_o")


class ScanTime(NamedTuple):
    """What a scan takes on a real instrument: readings, seconds of moving and settling, and of counting."""

    readings: int
    moving: float
    counting: float

    @property
    def seconds(self) -> float:
        """Of all."""
        return self.moving + self.counting


@dataclasses.dataclass(frozen=True)
class Pace:
    """The pace of an instrument: all axes move at once, the slowest sets the time; then it settles, then it counts.

    Between two readings: max over the four angles of |change| / `axis_speed`, plus `settling`; azimuths take the
    shorter way round. Counting takes photons / `count_rate`, photons being those expected of the white diffuser at
    normal incidence. Raises GonioError for what is not above 0 (`settling`: below 0).
    """

    axis_speed: float | tuple[float, ...] = math.radians(10.0)
    """Radians a second: of all axes, or of theta_i, phi_i, theta_o and phi_o."""
    settling: float = 0.3
    """Seconds from arrival to reading."""
    count_rate: float = 1e6
    """Counts a second of the perfect white diffuser at normal incidence."""

    def __post_init__(self) -> None:
        if np.size(self.axis_speed) not in (1, len(AXES)):
            raise GonioError(f"axis speed has {np.size(self.axis_speed)} numbers; give one, or one for each of {AXES}")
        for name in ("axis_speed", "settling", "count_rate"):
            for value in np.ravel(getattr(self, name)).tolist():
                if not (math.isfinite(value) and (value > 0 or (value == 0 and name == "settling"))):
                    raise GonioError(f"{name.replace('_', ' ')} is {value:g}; give a number above 0")

    def moving(self, start: Angles, end: Angles) -> np.ndarray:
        """Seconds on the way from directions to others, without settling.

        Args:
            start: theta_i, phi_i, theta_o, phi_o, radians: arrays that broadcast.
            end: the same of where the arms go.

        Returns:
            Seconds of the slowest axis, of the angles' broadcast shape; azimuths go the shorter way round.
        """
        steps = [np.abs(np.asarray(a) - np.asarray(b)) for a, b in zip(start, end, strict=True)]
        steps = [np.minimum(s, 2 * np.pi - s) if k % 2 else s for k, s in enumerate(steps)]
        speeds = np.broadcast_to(np.asarray(self.axis_speed), len(AXES))
        return np.max(np.stack(np.broadcast_arrays(*(s / v for s, v in zip(steps, speeds, strict=True)))), axis=0)

    def path_seconds(self, angles: Angles, counting: float | np.ndarray) -> float:
        """Seconds of readings one after another: four angles (n,), counting seconds of each."""
        count = np.size(angles[0])
        moving = np.sum(self.moving([a[:-1] for a in angles], [a[1:] for a in angles])) if count else 0.0
        return float(moving) + count * self.settling + float(np.sum(np.broadcast_to(counting, (count,))))

    def seconds(self, layout: Layout, photons: float) -> float:
        """Seconds of a whole scan, at so many photons a reading: row by row, every other row backwards.

        What is below the horizon is left out.
        """
        return self.scan_time(layout, photons / self.count_rate).seconds

    def scan_time(self, layout: Layout, counting: float | np.ndarray) -> ScanTime:
        """What a whole scan takes, in the order of `seconds`; `counting`: seconds of each cell (n,), or of all."""
        times = np.broadcast_to(counting, (layout.size,))
        readings, moving, count, followed, last = 0, 0.0, 0.0, 0, None
        for start, stop in _parts(layout.size):
            cells, angles = _on_the_way(layout, start, stop)
            count += float(np.sum(times[cells]))
            moving += self.path_seconds(angles, 0.0)
            if start == followed and last is not None and cells.size:
                moving += float(self.moving(last, [a[0] for a in angles]))
            last = [a[-1] for a in angles] if cells.size else last
            readings, followed = readings + cells.size, followed + stop - start
        share = layout.size / followed
        return ScanTime(round(readings * share), moving * share, count * share)

    def sentence(self) -> str:
        """The model, for a caption."""
        degrees = "/".join(f"{v:g}" for v in np.degrees(np.ravel(self.axis_speed)))
        return (
            f"Hours of an instrument whose arms turn by {degrees}°/s, settle in "
            f"{self.settling:g} s and count {self.count_rate:g} photons/s off the white diffuser."
        )


def scan_order(layout: Layout) -> np.ndarray:
    """Numbers of the cells above the horizon, every other row of each axis backwards, so that no arm flies back."""
    order = _turned(layout, 0, layout.size)
    return order[layout.readable()[order]]


def _parts(size: int) -> list[tuple[int, int]]:
    """Ranges of a way of so many cells: all of it, or evenly spread parts."""
    if size <= MOST_PARTS * PART_CELLS:
        return [(start, min(start + PART_CELLS, size)) for start in range(0, size, PART_CELLS)]
    starts = [k * (size - PART_CELLS) // (MOST_PARTS - 1) for k in range(MOST_PARTS)]
    return [(start, start + PART_CELLS) for start in starts]


def _on_the_way(layout: Layout, start: int, stop: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Numbers and angles of the cells above the horizon from place `start` to `stop` of the way through all cells."""
    cells = _turned(layout, start, stop)
    wi, wo = layout.directions_at(cells)
    readable = layout.are_readable(np.asarray(wi.z), np.asarray(wo.z))
    return cells[readable], [a[readable] for a in layout.angles_at(cells)]


def _turned(layout: Layout, start: int, stop: int) -> np.ndarray:
    """Numbers of the cells from place `start` to `stop` of the way, those below the horizon too."""
    shape = layout.shape
    index = np.unravel_index(np.arange(start, stop), shape)
    turned = [index[0]]
    for k in range(1, len(shape)):
        row = np.ravel_multi_index(index[:k], shape[:k])
        turned.append(np.where(row % 2, shape[k] - 1 - index[k], index[k]))
    return np.asarray(np.ravel_multi_index(tuple(turned), shape))
