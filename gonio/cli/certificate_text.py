"""A certificate on a terminal: a table of the properties, and a sentence for each."""

import math
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gonio.text import columns, show

if TYPE_CHECKING:
    from gonio.checks.certificate import Certificate

COLOURS = {"pass": "green", "fail": "red", "undecided": "yellow", "not applicable": "dim"}
HEADINGS = ("property", "verdict", "residual", "bound", "tolerance", "worst at")
ANGLES = {"theta_i": "θi", "phi_i": "φi", "theta_o": "θo", "phi_o": "φo"}


def print_certificate(certificate: "Certificate") -> None:
    """Prints a certificate; verdicts are coloured on a terminal."""
    title = f"{certificate.subject} ({certificate.kind}): {certificate.overall.upper()}"
    rows = [
        (p.name, p.verdict, *(_number(v) for v in (p.residual, p.bound, p.tolerance)), _place(p.where))
        for p in certificate.properties
    ]
    if sys.stdout.isatty():
        _print_coloured(title, rows)
    else:
        show(f"{title}\n\n{columns(rows, HEADINGS)}\n")
    for p in certificate.properties:
        show(f"{p.name}: {p.detail}")
    counted = "reciprocity and energy"
    if certificate.strict:
        counted = "all properties but isotropy"
    elif any(p.name == "agreement" for p in certificate.properties):
        counted = "reciprocity, energy and agreement"
    show(f"The overall verdict is the worst of {counted}.")


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


def _place(where: Mapping[str, Any]) -> str:
    words = [f"{ANGLES[k]} {v:.4g}°" for k, v in where.items() if k in ANGLES]
    if "theta_from" in where:
        words = [f"θ {where['theta_from']:g}–{where['theta_to']:g}°"]
    if "channel" in where:
        words.append(f"channel {where['channel']}")
    return " ".join(words) or "-"
