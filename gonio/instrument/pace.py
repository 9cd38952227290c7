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
MOST_CELLS = 1 << 22
"""Cells of a scan whose way is followed; of a larger one the hours are those of its first cells, times their share."""
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
        """Seconds on the way from directions to others, without settling; four angles each, arrays that broadcast."""
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
        angles = [np.asarray(a)[scan_order(layout)] for a in layout.angles()]
        return self.path_seconds(angles, photons / self.count_rate)

    def scan_time(self, layout: Layout, counting: float | np.ndarray) -> ScanTime:
        """What a whole scan takes, in the order of `seconds`; `counting`: seconds of each cell (n,), or of all."""
        stop = min(layout.size, MOST_CELLS)
        order = scan_order(layout) if stop == layout.size else np.arange(stop)
        share = layout.size / stop
        moving = self.path_seconds([np.asarray(a)[order] for a in layout.angles(0, stop)], 0.0)
        count = np.broadcast_to(counting, (layout.size,))[order]
        return ScanTime(round(order.size * share), moving * share, float(np.sum(count)) * share)

    def sentence(self) -> str:
        """The model, for a caption."""
        degrees = "/".join(f"{v:g}" for v in np.degrees(np.ravel(self.axis_speed)))
        return (
            f"Hours of an instrument whose arms turn by {degrees}°/s, settle in "
            f"{self.settling:g} s and count {self.count_rate:g} photons/s off the white diffuser."
        )


def scan_order(layout: Layout) -> np.ndarray:
    """Numbers of the cells above the horizon, every other row of each axis backwards, so that no arm flies back."""
    shape = layout.shape
    index = np.indices(shape).reshape(len(shape), -1)
    turned = [index[0]]
    for k in range(1, len(shape)):
        row = np.ravel_multi_index(tuple(index[:k]), shape[:k])
        turned.append(np.where(row % 2, shape[k] - 1 - index[k], index[k]))
    order = np.asarray(np.ravel_multi_index(tuple(turned), shape))
    return order[layout.readable()[order]]
