"""What the checks of a table are given, gathered in one pass: the readings that should be equal, pair by pair."""

import dataclasses
import functools
from typing import Self

from gonio.checks.table.pairs import FEWEST, Pairs, exchanged_pairs, mirrored_pairs, pole_pairs, turned_pairs
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF

LEVEL = 0.01
"""Chance that an honest table is called significantly wrong, by each family of tests against stored uncertainties."""


@dataclasses.dataclass(frozen=True)
class TableEvidence:
    """A table, its pairs of readings that should be equal (or why there are none), and the options of `gonio.check`."""

    table: Table
    level: float = LEVEL
    feature_width: float = 0.0
    reference: AbstractBRDF | None = None

    @functools.cached_property
    def exchanged(self) -> Pairs | str:
        return reciprocal_pairs(self.table)

    @functools.cached_property
    def mirrored(self) -> Pairs | str:
        return mirrored_pairs(self.table)

    @functools.cached_property
    def turned(self) -> Pairs | str:
        return turned_pairs(self.table)

    @functools.cached_property
    def at_pole(self) -> Pairs | str:
        return pole_pairs(self.table)

    def gathered(self) -> Self:
        """The evidence with all of its pairs read."""
        for name in ("exchanged", "mirrored", "turned", "at_pole"):
            getattr(self, name)
        return self

    def channel(self, number: int) -> str | None:
        """What a place calls a channel: its name, or None for the only one."""
        return self.table.channels.names[number] if len(self.table.channels) > 1 else None


def reciprocal_pairs(table: Table) -> Pairs | str:
    """Readings with those of the exchanged directions: measured, near, interpolated or by the format's own warp."""
    if table.interpolant is None and table.layout.gridded:
        pairs = exchanged_pairs(table)
        if isinstance(pairs, str) or table.layout.in_one_plane or len(pairs.a) >= max(FEWEST, 0.01 * pairs.eligible):
            return pairs
    from gonio.checks.table.scattered_pairs import interpolated_pairs, scattered_pairs, warped_pairs

    if table.interpolant is not None:
        return warped_pairs(table)
    return interpolated_pairs(table) if table.layout.gridded else scattered_pairs(table)
