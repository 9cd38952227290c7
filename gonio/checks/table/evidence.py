"""What the checks of a table are given: the table, its readings that should be equal, and the options."""

import dataclasses
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gonio.checks.table.pairs.equal_pairs import (
    cells_without_partner,
    exchanged_pairs,
    mirrored_pairs,
    pole_pairs,
    squares_of,
    turned_pairs,
)
from gonio.checks.table.pairs.normal_incidence import normal_incidence_pairs
from gonio.checks.table.pairs.pairs import Pairs, joined, without_radiance_factor
from gonio.checks.table.pairs.places import places
from gonio.checks.table.pairs.scattered_pairs import scattered_pairs
from gonio.data.channels import Channels
from gonio.data.interpolation.sheets import sheet_of
from gonio.data.plausibility.copies import repeated, with_noise_of_copies
from gonio.data.table import Table
from gonio.models.geometry.sides import FRONT

if TYPE_CHECKING:
    from gonio.checks.albedos import Albedos
    from gonio.fitting.result import FitResult
    from gonio.models.brdf import AbstractBRDF

LEVEL = 0.01
"""Chance that an honest table is called significantly wrong, by each family of tests against stored uncertainties."""


def reciprocal_pairs(table: Table) -> Pairs | str:
    """Readings with those of the exchanged directions: measured, interpolated, or by the format's own warp.

    Through the sample they are what is equal between media of the table's stated indices.
    """
    pairs = _exchanged(table)
    return pairs if isinstance(pairs, str) or table.sides == FRONT else without_radiance_factor(pairs, table.media)


def _exchanged(table: Table) -> Pairs | str:
    if (sheet := sheet_of(table)) is not None:
        from gonio.checks.table.sheet import sheet_pairs

        return sheet_pairs(sheet)
    if table.interpolant is not None:
        from gonio.checks.table.pairs.warped_pairs import warped_pairs

        return warped_pairs(table)
    if not table.layout.gridded:
        return scattered_pairs(table)
    pairs = exchanged_pairs(table)
    if isinstance(pairs, str) or table.layout.in_one_plane:
        return pairs
    alone = cells_without_partner(table)
    # Interpolation is for what the measured pairs leave open.
    if alone.size:
        alone = alone[~np.isin(squares_of(table.layout, alone), places(pairs.angles).square)]
    if not alone.size:
        return pairs
    from gonio.checks.table.pairs.interpolated_pairs import interpolated_pairs

    return joined(pairs, interpolated_pairs(table, alone))


PAIRS: dict[str, Callable[[Table], Pairs | str]] = {
    "exchanged": reciprocal_pairs,
    "mirrored": mirrored_pairs,
    "turned": turned_pairs,
    "pole": pole_pairs,
    "normal incidence": normal_incidence_pairs,
}
"""What makes the pairs of readings that should be equal, or says why a table has none."""


@dataclasses.dataclass(frozen=True)
class TableEvidence:
    """A table, its pairs of readings that should be equal, and the options of `gonio.check`."""

    table: Table
    level: float = LEVEL
    feature_width: float = 0.0
    reference: "AbstractBRDF | Table | None" = None
    """What the table is compared with: the truth, or readings of the same surface."""
    reference_channels: Channels | None = None
    """Those of the reference, by which the same ones are compared; None: by place."""
    model: str | None = None
    further: Table | None = None
    """Readings of the same surface beside those of the table, which energy takes into account."""
    made: "FitResult | None" = None
    """The fit of the model to the table, where it was made before."""
    polarised: Channels | None = None
    """The polarised channels of which those of the table are sums, by the state of the light; None: the table's are
    those that were read."""
    albedos: "Albedos | str | None" = None
    """What `table_albedos` of energy gives, where that was integrated before."""

    @functools.cached_property
    def fitted(self) -> "FitResult | None":
        """The fit of the stated model to the table, made where a check asks for it; None without a model."""
        from gonio.fitting.fit_table import fit

        if self.model is None or self.made is not None:
            return self.made
        return fit(self._read, None if self.model == "auto" else self.model)

    @functools.cached_property
    def refitted(self) -> "FitResult | None":
        """The fit of a selected model with lobes of families that the selection leaves out; of a stated one itself."""
        if self.model != "auto" or self.made is not None or self.fitted is None:
            return self.fitted
        from gonio.fitting.further_families import in_further_families

        return in_further_families(self._read, self.fitted)

    @property
    def _read(self) -> Table:
        from gonio.checks.table.further_readings import joined

        return self.table if self.further is None else joined(self.table, self.further)

    def pairs(self, kind: str) -> Pairs | str:
        """Pairs of one of the kinds of `PAIRS`; or why there are none."""
        return PAIRS[kind](self.with_copies_as_one)

    @functools.cached_property
    def with_copies_as_one(self) -> Table:
        """The table with so much larger uncertainties of readings that repeat others that sums know no more by them."""
        return with_noise_of_copies(self.table, repeated(self.table))

    def channel(self, number: int) -> str | None:
        """What a place calls a channel: its name, or None for the only one."""
        return self.table.channels.names[number] if len(self.table.channels) > 1 else None
