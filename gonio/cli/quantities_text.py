"""What `gonio quantities` prints of values: one row a quantity, channels beside each other, colours in a table."""

from typing import TYPE_CHECKING

from gonio.text import columns

if TYPE_CHECKING:
    from gonio.metrology.quantities import Quantities
    from gonio.metrology.quantity import Quantity

DEFAULT = ("albedo", "reflectance", "transmission", "gloss", "colour", "subsurface", "fit")
"""Groups that one screen shows; the others by name."""
MOST_CHANNELS = 3
"""Of more channels the terminal shows the first, the middle and the last."""
INCIDENCES = (0.0, 30.0, 60.0)
"""Degrees: of more incidences it shows those near these, and the last."""
NEGLIGIBLE = 1e-5
"""Of a value: a smaller uncertainty is not printed."""
EVERYTHING = "all"


def shown_groups(result: "Quantities", only: list[str]) -> list[str]:
    """The groups to print, in their order."""
    from gonio.metrology.standards.catalog import GROUPS

    if only:
        return [g for g in (*GROUPS, "fit") if g in only or EVERYTHING in only]
    polished = {q.group for q in result.quantities if q.name == "specular reflectance"}
    return [g for g in (*GROUPS, "fit") if g in DEFAULT or g in polished]


def shown_channels(result: "Quantities") -> list[str]:
    """Names of few channels."""
    channels = list(dict.fromkeys(q.channel for q in result.quantities if q.channel))
    if len(channels) > MOST_CHANNELS:
        channels = [channels[0], channels[len(channels) // 2], channels[-1]]
    return channels


def shown_rows(result: "Quantities", groups: list[str]) -> list[int]:
    """Numbers of the quantities of few channels and incidences in these groups."""
    from gonio.metrology.measurands import DIRECTIONAL

    channels, every = shown_channels(result), result.quantities
    angles = sorted({q.angles.get("theta_i", 0.0) for q in every if q.name in DIRECTIONAL})
    if len(angles) > len(INCIDENCES) + 1:
        angles = sorted({min(angles, key=lambda t: abs(t - wanted)) for wanted in (*INCIDENCES, angles[-1])})
    return [
        k
        for k, q in enumerate(every)
        if q.group in groups
        and q.channel in (*channels, "")
        and (q.name not in DIRECTIONAL or q.angles["theta_i"] in angles)
    ]


def plain_list(result: "Quantities", groups: list[str], geometry: bool) -> list[str]:
    """The quantities as lines; `geometry`: with what is integrated, else with the standard's name alone."""
    from gonio.metrology.azimuths import fewer_azimuths
    from gonio.metrology.standards.colour import COORDINATES

    rows = fewer_azimuths([result.quantities[k] for k in shown_rows(result, groups)])
    channels = shown_channels(result)
    by_name: dict[tuple[str, str], list[Quantity]] = {}
    for q in rows:
        if not (q.name in COORDINATES and not q.channel):
            by_name.setdefault((q.name, q.place), []).append(q)
    cells: list[list[str]] = []
    for (name, place), of in by_name.items():
        values = {q.channel: valued(q) for q in of}
        row = [values.get(c, values.get("", "")) for c in channels] if channels else [values[""]]
        source = of[0].standard + (f"; {of[0].geometry}" if geometry and of[0].geometry else "")
        cells.append([name, place, *row, source])
    heading = ["quantity", "at", *(channels if len(channels) > 1 else ["value ± U (k = 2)"]), "standard"]
    colours = _colours([q for q in rows if q.name in COORDINATES and not q.channel])
    tables = [*([columns(cells, heading)] if cells else []), *([colours] if colours else [])]
    return ["\n\n".join(tables)] if tables else []


def valued(q: "Quantity") -> str:
    """The value with its expanded uncertainty, in the quantity's unit."""
    u = 2 * q.uncertainty
    unit = "" if q.unit == "1" else f" {q.unit}"
    known = q.text(u)
    return f"{known}{unit}" if known == "not known" or u <= NEGLIGIBLE * abs(q.value) else f"{known} ± {u:.2g}{unit}"


def _colours(rows: "list[Quantity]") -> str:
    """One row a geometry and illuminant, one column a coordinate."""
    if not rows:
        return ""
    by_place: dict[str, dict[str, str]] = {}
    for q in rows:
        by_place.setdefault(q.place, {})[q.name] = valued(q)
    names = list(dict.fromkeys(q.name for q in rows))
    return columns([[p, *(of.get(n, "–") for n in names)] for p, of in by_place.items()], ["colour", *names])


def undecided_lines(result: "Quantities", groups: list[str]) -> list[str]:
    """What the data do not reach, by the reason."""
    reasons: dict[str, list[str]] = {}
    for u in result.undecided:
        if u.group in groups:
            name = u.group if u.group == "colour" else u.name
            reasons.setdefault(u.reason, []).append(f"{name} {u.place}".strip())
    lines: list[str] = []
    for reason, every in reasons.items():
        names = list(dict.fromkeys(every))
        listed = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
        lines.append(f"undecided: {listed}: {reason}")
    return lines


def other_groups(result: "Quantities", groups: list[str]) -> list[str]:
    """One line that names the groups that are not printed."""
    every = dict.fromkeys(q.group for q in (*result.quantities, *result.undecided))
    others = [g for g in every if g not in groups]
    return [f"also: {', '.join(others)} (--only NAME,... or --only all)"] if others else []
