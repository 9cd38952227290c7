"""Quantities of standards of a table, which can be read out again of the same cells with other readings."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from gonio.data.table import Table
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.evaluation import Spread, Undecided, distinct, evaluated, slopes
from gonio.metrology.standards.of_tables import SidedAlbedos, TableIntegrals
from gonio.metrology.standards.standard import Integral, StandardQuantity


@dataclasses.dataclass(frozen=True)
class TableStandards:
    """Those that the readings reach, in `rows` (of each channel), and those that they do not."""

    entries: list[StandardQuantity]
    integrals: list[Integral]
    sums: TableIntegrals
    rows: list[Quantity]
    undecided: list[Undecided]

    @classmethod
    def of(
        cls,
        table: Table,
        entries: Sequence[StandardQuantity],
        albedos: SidedAlbedos,
        feature_width: float = 0.0,
        turned: float | None = None,
    ) -> "TableStandards":
        """Those of a table whose directional albedos are known; no lobe is narrower than `feature_width`, radians.

        `turned`: see `azimuth_dependence`.
        """
        integrals = distinct(entries)
        made = cls([], integrals, TableIntegrals.of(table, integrals, albedos, feature_width, turned), [], [])
        known = made.sums.known(table, albedos)
        rows, of, undecided = evaluated(entries, table.channels, known, made._spread(table, albedos))
        return dataclasses.replace(made, entries=list(dict.fromkeys(of)), rows=rows, undecided=undecided)

    def with_reasons(self, more: Mapping[str, str]) -> "TableStandards":
        """The same with more to say, by their place, of those that are undecided."""
        undecided = [
            u._replace(reason=f"{u.reason}; {more[u.place]}") if u.place in more else u for u in self.undecided
        ]
        return dataclasses.replace(self, undecided=undecided)

    def read_out(self, table: Table, albedos: SidedAlbedos) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(values, bounds, noise) of the rows, of the same table with other f or u_f; bounds are those of before."""
        known = self.sums.known(table, albedos)
        spread, values, noise = self._spread(table, albedos), [], []
        for entry in self.entries:
            of = known.values[[self.integrals.index(i) for i in entry.integrals]]
            size = 1 if entry.whole else of.shape[1]
            values.append(np.broadcast_to(entry.combine(of), size))
            noise.append(np.broadcast_to(spread(entry, slopes(entry, of)), size))
        bounds = np.array([q.bound for q in self.rows])
        nothing = np.zeros(0)
        return np.concatenate([nothing, *values]), bounds, np.concatenate([nothing, *noise])

    def _spread(self, table: Table, albedos: SidedAlbedos) -> Spread:
        def spread(entry: StandardQuantity, by: np.ndarray) -> np.ndarray:
            numbers = [self.integrals.index(i) for i in entry.integrals]
            u = self.sums.noise(table, albedos, numbers, by)
            return np.sqrt(np.sum(u**2)) if entry.whole else u

        return spread
