"""The atlas as a result: its cells, their counts, and the CSV."""

import csv
import dataclasses
import io
from collections import Counter
from typing import NamedTuple

from gonio.stability.outcome import METHODS, SILENT, VERDICTS, Cell, worst

FIELDS = ("method", "model", "setting", "regime", "precision", "verdict", "error", "allowed", "detail", "recipe")


class VerdictGrid(NamedTuple):
    """The worst verdict of each model (a row) in each regime, and the regimes' names in order."""

    verdicts: dict[str, dict[str, str]]
    columns: list[str]


@dataclasses.dataclass(frozen=True)
class Atlas:
    """The cells of a stability atlas and the seconds that they took."""

    cells: tuple[Cell, ...]
    quick: bool
    seconds: float

    def of_method(self, method: str) -> list[Cell]:
        """The cells of one method."""
        return [c for c in self.cells if c.method == method]

    def counts(self, method: str | None = None) -> dict[str, int]:
        """The number of cells with each verdict."""
        numbers = Counter(c.verdict for c in self.cells if method in (None, c.method))
        return {v: numbers[v] for v in VERDICTS}

    @property
    def silent(self) -> list[Cell]:
        """The cells that are wrong and do not say so."""
        return [c for c in self.cells if c.verdict == SILENT]

    @property
    def exit_status(self) -> int:
        """0 where nothing fails silently, else 1."""
        return 1 if self.silent else 0

    def last_line(self) -> str:
        """The number of silent failures in words."""
        n = len(self.silent)
        return f"{n} silent failure{'s' * (n != 1)}"

    def summary(self) -> list[list[str]]:
        """Rows of (method, number of cells, right, says so, silently wrong)."""
        rows = {method: list(self.counts(method).values()) for method in METHODS}
        return [[method, *(f"{n:,}" for n in (sum(row), *row))] for method, row in rows.items() if any(row)]

    def verdict_grid(self, method: str) -> VerdictGrid:
        """The verdicts of one method by model and regime: the worst over the settings of each model."""
        cells = self.of_method(method)
        several = len({c.precision for c in cells}) > 1
        title = {c: f"{c.column} {c.precision[-2:]} bit" if several else c.column for c in cells}
        columns = list(dict.fromkeys(title[c] for c in sorted(cells, key=lambda c: c.precision, reverse=True)))
        grid: dict[str, dict[str, list[str]]] = {}
        for c in cells:
            grid.setdefault(c.model, {}).setdefault(title[c], []).append(c.verdict)
        return VerdictGrid({m: {k: worst(v) for k, v in row.items()} for m, row in grid.items()}, columns)

    def to_csv(self) -> str:
        """The cells as CSV, a header first."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(FIELDS)
        for c in self.cells:
            regime = (c.method, c.model, c.row, c.column, c.precision)
            errors = f"{c.error:.3g}", f"{c.allowed:.3g}"
            writer.writerow([*regime, c.verdict, *errors, c.detail, c.recipe(self.quick)])
        return text.getvalue()
