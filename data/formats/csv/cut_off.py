"""Whether a CSV file ends in the middle of a number, or of a scan, as one whose transfer broke off."""

from collections.abc import Sequence

import numpy as np

from gonio.data.formats.csv.columns import CsvText

ROWS = 20
"""Rows above the last one that say how long its last number should be."""
FEWEST_ROWS = 5
FEWEST_RUNS = 2
"""Whole runs of a scan."""
FEWER = 3
"""Characters fewer than any of them."""


def cut_off(text: CsvText) -> list[str]:
    """A sentence, where the last line has no end and its last number fewer characters than those above it."""
    rows = [line for line in text.lines[max(text.first_line, len(text.lines) - ROWS - 1) :] if line.strip()]
    if not text.lines[-1].strip() or len(rows) <= FEWEST_ROWS:
        return []
    *above, last = [len(row.strip().split(text.delimiter or None)[-1]) for row in rows]
    if last > min(above) - FEWER:
        return []
    return [
        "the last line has no end, and its last number fewer digits than those above: the file may be cut off; end the "
        "line, if it is whole"
    ]


def ends_early(columns: Sequence[np.ndarray]) -> list[str]:
    """A sentence, where rows of a scan come in runs that are all alike, but for the last one, which is shorter.

    Args:
        columns: the angles of the rows (n,), and their wavelengths, as the file has them, in the file's order.
    """
    changes = [np.flatnonzero(c[1:] != c[:-1]) for c in columns]
    moving = sorted((k for k, places in enumerate(changes) if places.size), key=lambda k: changes[k].size)
    for depth in range(1, len(moving)):
        starts = np.concatenate([[0], 1 + np.unique(np.concatenate([changes[k] for k in moving[:depth]]))])
        lengths = np.diff(np.concatenate([starts, [columns[0].size]]))
        whole, last = int(lengths[0]), int(lengths[-1])
        if lengths.size <= FEWEST_RUNS or last >= whole or (lengths[:-1] != whole).any():
            continue
        rest = [columns[k] for k in moving[depth:]]
        runs = [c[: starts[-1]].reshape(-1, whole) for c in rest]
        pairs = zip(runs, rest, strict=True)
        if all((r == r[0]).all() and (c[starts[-1] :] == r[0, :last]).all() for r, c in pairs):
            return [
                f"its rows come in {lengths.size} runs of {whole} over the same angles, and the last one ends after "
                f"{last}: the file may be cut off; the rest counts as not read"
            ]
    return []
