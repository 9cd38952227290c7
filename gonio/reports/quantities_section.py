"""The quantities that standards name, of a subject in its shown channel, for the page."""

from typing import Any

import numpy as np

from gonio.data.profile import Profile
from gonio.metrology.azimuths import fewer_azimuths
from gonio.metrology.profile_quantities import BY_READINGS, quantities_of_fits
from gonio.metrology.quantities import Quantities, quantities
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.catalog import GROUPS
from gonio.metrology.standards.colour import COORDINATES
from gonio.metrology.subsurface_quantities import BY_MODEL
from gonio.reports.subject import ReportSubject

MOST_READINGS = 2_000_000
LISTED = tuple(g for g in GROUPS if g not in ("albedo", "remote sensing", "scatter law"))
"""Groups on the page: albedos have a figure, and remote sensing's names are other names."""
COMPUTED = tuple(g for g in GROUPS if g != "scatter law")
"""Groups that are listed or that decide what is said: laws of scatter have a figure, of one channel."""
MOST_REASONS = 6
MOST_CHANNELS = 3
"""Of a profile, whose quantities are listed in several."""
NO_FIT = "Coefficients and the edge loss are a fit's: give one (gonio fit PROFILE -o FIT.toml, then --fit FIT.toml)."


def quantities_of(s: ReportSubject) -> dict[str, Any] | None:
    """The rows of a subject by groups, and what is undecided; None where nothing was read, or too much."""
    if s.empty or (s.table is not None and s.table.layout.size * len(s.table.channels) > MOST_READINGS):
        return None
    if s.profile is not None:
        return _of_profile(s, s.profile)
    only = COMPUTED if len(s.channels) > 1 else ()  # one channel has no colour, which needs no remark
    if s.table is None:
        made = quantities(s.material, only=only)
    else:  # integrals over half vectors take seconds for each channel
        made = quantities(s.table.only([s.channel]) if s.table.layout.in_half_vectors else s.table, only=only)
    rows = [q for q in made.quantities if q.group in LISTED and q.channel in (s.channel, "")]
    rows = fewer_azimuths([q for q in rows if not (q.name in COORDINATES and "D65" not in q.place)])
    groups = [{"name": g, "rows": [_row(q) for q in rows if q.group == g]} for g in LISTED]
    groups = [g for g in groups if g["rows"]]
    elsewhere = [] if s.table is None else s.table.provenance.get("warnings", [])  # on the page
    notes = [note for note in made.notes if note not in elsewhere]
    return (
        {"channel": s.in_channel, "groups": groups, "undecided": _undecided(made), "notes": notes} if groups else None
    )


def _of_profile(s: ReportSubject, profile: Profile) -> dict[str, Any]:
    """By the readings and by each fit, in all channels that fit on a page."""
    made = quantities(profile)
    count = len(s.channels)
    index = np.unique(np.linspace(0, count - 1, min(count, MOST_CHANNELS)).astype(int))
    shown = [s.channels.names[k] for k in index]
    groups = [("by the readings alone", made.quantities)]
    groups += [(s.fit_name(k), quantities_of_fits(profile, [fit])) for k, fit in enumerate(s.fits)]
    listed = []
    for name, every in groups:
        rows = [_row(q) | {"place": _place(q, count)} for q in every if q.channel in shown]
        listed.append({"name": name, "rows": rows})
    reasons = [{"names": u.name, "why": u.reason} for u in made.undecided]
    some = "" if count == len(shown) else f"{len(shown)} of "
    groups = [g for g in listed if g["rows"]]
    channels = f"{some}{count} channels" if count > 1 else s.in_channel
    return {"channel": channels, "groups": groups, "undecided": reasons, "notes": [] if s.fits else [NO_FIT]}


def _place(q: Quantity, channels: int) -> str:
    """Where a quantity of a profile is, but for what the heading says."""
    of_channel = [q.channel] if channels > 1 else []
    return ", ".join([*of_channel, *([q.place] if q.place not in ("", BY_READINGS, BY_MODEL) else [])])


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
