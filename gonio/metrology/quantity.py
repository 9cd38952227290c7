"""One number that is reported: what it is, its value, and how well it is known."""

import dataclasses
import math
from typing import Any


@dataclasses.dataclass(frozen=True)
class Quantity:
    """One number: what it is, where (in words and as angles in degrees), of which channel, and its value.

    Attributes:
        bound: how far it may be off by computing it (of a table: by what lies between and beyond the readings);
            infinite where there is no such bound.
        standard, geometry: who names it so, and what is integrated, in words.
        group: of those that are printed together.
        u: standard uncertainty by the readings' stored noise, or by the covariance of the fit.
        least: an uncertainty of this size leaves it known even where the value is smaller.
    """

    name: str
    place: str
    channel: str
    value: float
    bound: float
    angles: dict[str, float] = dataclasses.field(default_factory=dict)
    unit: str = "1"
    standard: str = ""
    geometry: str = ""
    group: str = "albedo"
    u: float = 0.0
    least: float = 0.0

    @property
    def uncertainty(self) -> float:
        """Combined standard uncertainty of noise and bound, the latter as half the width of a rectangle."""
        return math.hypot(self.u, self.bound / math.sqrt(3.0))

    @property
    def decided(self) -> bool:
        """Whether the expanded uncertainty (k = 2) leaves something of it."""
        return math.isfinite(self.value) and 2 * self.uncertainty < max(abs(self.value), self.least, 1e-300)

    def text(self, u: float) -> str:
        """The value to two digits of an uncertainty u, or that this leaves nothing of it."""
        if not u > 0:
            return f"{self.value:.6g}"
        if u >= max(abs(self.value), self.least):
            return "not known"
        return f"{round(self.value, 1 - math.floor(math.log10(u))):.6g}"


def to_row(quantity: Quantity) -> dict[str, Any]:
    """A quantity as plain data."""
    angles = {f"{name}_deg": angle for name, angle in quantity.angles.items()}
    row = {"name": quantity.name, "place": quantity.place, "channel": quantity.channel, **angles}
    named = {k: v for k, v in (("standard", quantity.standard), ("geometry", quantity.geometry)) if v}
    values = {"value": quantity.value, "bound": quantity.bound, "unit": quantity.unit}
    return row | named | values | {"group": quantity.group, "standard_uncertainty": quantity.uncertainty}
