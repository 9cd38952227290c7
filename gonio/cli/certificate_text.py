"""A certificate on a terminal: a table of the properties, and a sentence for each."""

import math
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gonio.text import columns, show

if TYPE_CHECKING:
    from gonio.checks.certificate import Certificate

COLOURS = {"pass": "green", "fail": "red", "undecided": "yellow", "not applicable": "dim"}
HEADINGS = ("property", "verdict", "residual", "bound", "tolerance", "worst at")


def print_certificate(certificate: "Certificate") -> None:
    """Prints a certificate; verdicts are coloured on a terminal."""
    from gonio.checks.certificate import place_in_words

    title = f"{certificate.subject} ({certificate.kind}): {certificate.overall.upper()}"
    rows = [
        (p.name, p.verdict, *(_number(v) for v in (p.residual, p.bound, p.tolerance)), place_in_words(p.where) or "-")
        for p in certificate.properties
    ]
    if sys.stdout.isatty():
        _print_coloured(title, rows)
    else:
        show(f"{title}\n\n{columns(rows, HEADINGS)}\n")
    for p in certificate.properties:
        show(f"{p.name}: {p.detail}")
    show(f"The overall verdict is the worst of {certificate.basis}.")


def _print_coloured(title: str, rows: Sequence[tuple[str, ...]]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(*HEADINGS, title=Text(title), title_justify="left")
    for name, verdict, *rest in rows:
        table.add_row(name, Text(verdict, style=COLOURS[verdict]), *rest)
    Console().print(table)


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return "no bound" if math.isinf(value) else f"{value:.3g}"
