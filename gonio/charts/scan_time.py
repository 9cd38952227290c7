"""How long a real gonioreflectometer takes for a scan: a stated model of arms that move, settle and count."""

import dataclasses
import math

import numpy as np

from gonio.data.layouts import Layout
from gonio.models.errors import GonioError


@dataclasses.dataclass(frozen=True)
class Pace:
    """The pace of an instrument: all axes move at once, the slowest sets the time; then it settles, then it counts.

    Between two readings: max over the four angles of |change| / `axis_speed`, plus `settling`; azimuths take the
    shorter way round. Counting takes photons / `count_rate`, photons being those expected of the white diffuser at
    normal incidence. Readings are taken row by row, every other row backwards; what is below the horizon is left out.
    Raises GonioError for what is not above 0 (`settling`: below 0).
    """

    axis_speed: float = math.radians(10.0)
    """Radians a second."""
    settling: float = 0.3
    """Seconds from arrival to reading."""
    count_rate: float = 1e6
    """Counts a second of the perfect white diffuser at normal incidence."""

    def __post_init__(self) -> None:
        for name in ("axis_speed", "settling", "count_rate"):
            value = getattr(self, name)
            if not (math.isfinite(value) and (value > 0 or (value == 0 and name == "settling"))):
                raise GonioError(f"{name.replace('_', ' ')} is {value:g}; give a number above 0")

    def seconds(self, layout: Layout, photons: float) -> float:
        """Seconds of a whole scan, at so many photons a reading."""
        order = _there_and_back(layout.shape)
        order = order[layout.above_horizon()[order]]
        if not order.size:
            return 0.0
        angles = [np.asarray(a)[order] for a in layout.angles()]
        steps = [np.abs(np.diff(a)) for a in angles]
        steps = [np.minimum(s, 2 * np.pi - s) if k % 2 else s for k, s in enumerate(steps)]
        moving = float(np.sum(np.max(steps, axis=0))) / self.axis_speed
        return moving + order.size * (self.settling + photons / self.count_rate)

    def sentence(self) -> str:
        """The model, for a caption."""
        return (
            f"Hours of an instrument whose arms turn by {math.degrees(self.axis_speed):g}°/s, settle in "
            f"{self.settling:g} s and count {self.count_rate:g} photons/s off the white diffuser."
        )


def _there_and_back(shape: tuple[int, ...]) -> np.ndarray:
    # C-order numbers of the cells, every other row of each axis backwards, so that no arm ever flies back.
    index = np.indices(shape).reshape(len(shape), -1)
    turned = [index[0]]
    for k in range(1, len(shape)):
        row = np.ravel_multi_index(tuple(index[:k]), shape[:k])
        turned.append(np.where(row % 2, shape[k] - 1 - index[k], index[k]))
    return np.asarray(np.ravel_multi_index(tuple(turned), shape))
