"""Whether a CSV file ends in the middle of a number, as one whose transfer broke off."""

from gonio.data.formats.csv.columns import CsvText

ROWS = 20
"""Rows above the last one that say how long its last number should be."""
FEWEST_ROWS = 5
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
