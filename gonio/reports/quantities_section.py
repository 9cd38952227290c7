"""The quantities that standards name, of a subject in its shown channel, for the page."""

from typing import Any

from gonio.metrology.quantities import Quantities, quantities
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.catalog import GROUPS
from gonio.metrology.standards.colour import COORDINATES
from gonio.reports.subject import ReportSubject

MOST_READINGS = 2_000_000
LISTED = tuple(g for g in GROUPS if g not in ("albedo", "remote sensing", "scatter law"))
"""Groups on the page: albedos have a figure, and remote sensing's names are other names."""
MOST_REASONS = 6


def quantities_of(s: ReportSubject) -> dict[str, Any] | None:
    """The rows of a subject by groups, and what is undecided; None where nothing was read, or too much."""
    if s.empty or (s.table is not None and s.table.layout.size * len(s.table.channels) > MOST_READINGS):
        return None
    if s.table is None:
        made = quantities(s.material)
    else:  # integrals over half vectors take seconds for each channel
        made = quantities(s.table.only([s.channel]) if s.table.layout.in_half_vectors else s.table)
    rows = [q for q in made.quantities if q.group in LISTED and q.channel in (s.channel, "")]
    rows = [q for q in rows if not (q.name in COORDINATES and "D65" not in q.place)]
    groups = [{"name": g, "rows": [_row(q) for q in rows if q.group == g]} for g in LISTED]
    groups = [g for g in groups if g["rows"]]
    elsewhere = [] if s.table is None else s.table.provenance.get("warnings", [])  # on the page
    notes = [note for note in made.notes if note not in elsewhere]
    return (
        {"channel": s.in_channel, "groups": groups, "undecided": _undecided(made), "notes": notes} if groups else None
    )


def _row(q: Quantity) -> dict[str, Any]:
    known = q.decided
    return {
        "name": q.name, "place": q.place, "value": q.value if known else None, "unit": "" if q.unit == "1" else q.unit,
        "expanded_uncertainty": 2 * q.uncertainty, "standard": q.standard, "geometry": q.geometry,
    }  # fmt: skip


def _undecided(made: Quantities) -> list[dict[str, str]]:
    reasons: dict[str, list[str]] = {}
    for u in made.undecided:
        if u.group in LISTED and u.group != "colour":
            reasons.setdefault(u.reason, []).append(f"{u.name} {u.place}".strip())
    listed = list(reasons.items())[:MOST_REASONS]
    return [{"names": ", ".join(names), "why": why} for why, names in listed]
