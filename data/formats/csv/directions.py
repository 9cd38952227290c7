"""The directions of a CSV file: which columns they are in, their unit, and what had to be understood."""

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gonio.data.formats.csv.columns import CsvText
from gonio.data.formats.csv.conventions import convention
from gonio.data.formats.csv.header import ANGLE_UNITS, ANGLES, HALF_DIFFERENCE, NO_UNIT, VECTORS, Column, shown
from gonio.data.formats.csv.statements import Statements
from gonio.data.layouts import spherical_angles
from gonio.data.layouts.recognition import LARGEST_ROUNDING, Angles
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import side

UNITS = ("degrees", "radians")
UNIT_TOLERANCE = 1e-3
"""A vector whose length is off by more is no direction; a smaller error is divided out."""
IN_PLANE = ("theta_i", "theta_o")
"""Angles of a file of readings in the plane of incidence, which are signed."""
POLAR = ("theta_i", "theta_o")
"""Angles that go on behind the sample."""
MOST_DIGITS = 10
HALF_TURN = {"degrees": 180.0, "radians": math.pi}
SINGLE = 2.0**-22
"""Share of an angle by which single precision, or the last of many digits, may have moved it."""


class Directions(NamedTuple):
    """The directions of the rows of a file."""

    angles: Angles
    """Azimuths in [0, 2π)."""
    rounding: float
    """Radians by which printing may have moved an angle."""
    unit: str
    """Of the file's angles, and who says so."""
    understood: list[str]
    unit_known: bool
    """Whether the file or the caller says the unit."""
    below: np.ndarray | None = None
    """Rows (n,) of half and difference angles, which hold reflection alone, with a direction below the horizon."""


def direction_columns(text: CsvText) -> dict[str, Column]:
    """The columns of directions by their roles: components, or angles of which the four can be made.

    Raises GonioError, naming the columns that are missing, for others.
    """
    every = {role: text.sole(role) for role in (*VECTORS, *ANGLES, *HALF_DIFFERENCE, "delta_phi", "phi_h")}
    there = {role: column for role, column in every.items() if column is not None}
    one_azimuth, lone = ("theta_i", "theta_o", "delta_phi"), _lone_azimuth(text)
    if lone is not None and not any("phi" in role for role in there):
        there["delta_phi"] = lone._replace(role="delta_phi")
    sets = (
        VECTORS, ANGLES, ("phi_i", *one_azimuth), ("phi_o", *one_azimuth), one_azimuth, ("phi_o", *IN_PLANE),
        HALF_DIFFERENCE,
    )  # fmt: skip
    for roles in sets:
        if set(roles) <= there.keys():
            extra = {"phi_h": there["phi_h"]} if roles == HALF_DIFFERENCE and "phi_h" in there else {}
            return {role: there[role] for role in roles} | extra
    if {"theta_i", "theta_o"} <= there.keys() and not any("phi" in role for role in there) and not _unknown(text):
        return {role: there[role] for role in IN_PLANE}
    missing = [n for n in ANGLES if n not in there]
    ambiguous = _unknown(text)
    hint = f"; {ambiguous[0][:40]} may be either side's:" if ambiguous else ""
    if elevations := [n for n in text.names if re.match(r"(?i)elev|altitude|grazing", n)]:
        hint = f"; {elevations[0][:40]} counts from the surface: give 90° less it,"
    azimuths = " (or delta_phi, 180 at the mirror side, for the azimuths)" if "phi_o" in missing else ""
    raise GonioError(
        f"{text.path} has the columns {shown(text.names)}, but not {', '.join(missing)}{hint or ';'} "
        f"expected {', '.join(ANGLES)} in degrees{azimuths}, or {VECTORS[0]}, ..., {VECTORS[-1]}"
    )


def _lone_azimuth(text: CsvText) -> Column | None:
    """The one column that is an azimuth of neither side: that of the detector from the light's."""
    unknown = _unknown(text)
    azimuths = [c for c in text.columns if c.name in unknown and c.name.lower().startswith(("phi", "azimuth"))]
    return azimuths[0] if len(azimuths) == len(unknown) == 1 else None


def _unknown(text: CsvText) -> list[str]:
    """Names of columns that may be angles of either side."""
    names = ("thetas", "phis", "phi", "theta", "azimuth")
    return [n for n in text.names if re.sub(r"[\s_]+|[\[(].*", "", n.lower()) in names]


def read_angles(
    text: CsvText,
    statements: Statements,
    numbers: Mapping[str, np.ndarray],
    unit: str | None,
    mirror_azimuth: float | None = None,
) -> Directions:
    """The directions of all rows.

    Args:
        text: the file.
        statements: its comments.
        numbers: its columns of directions, by their names.
        unit: "degrees" or "radians", where the caller states it.
        mirror_azimuth: by how much azimuths differ at the mirror side, degrees, where the caller states it.

    Raises:
        GonioError: an unknown or contradictory unit; with the line, what is no direction.
    """
    columns = direction_columns(text)
    values = {role: numbers[column.name] for role, column in columns.items()}
    turned = convention(None, mirror_azimuth).mirror_azimuth == 0
    if mirror_azimuth is not None and not {"phi_o", "delta_phi"} & values.keys():
        text.refuse("it has no azimuths of light and detector, which --mirror-azimuth is of; leave it out")
    understood = [f"{c.name[:40]} is {role}" for role, c in columns.items() if c.name != role]
    if set(VECTORS) <= columns.keys():
        # Near the normal and the horizon an angle moves by more than the components do.
        rounding = min(20 * printed_rounding(list(values.values())), LARGEST_ROUNDING)
        four = _of_vectors(text, values)
        return Directions(four, rounding, "none: components of unit vectors", understood + _behind(four), True)
    units, who = _units(text, statements, columns, unit)
    rounding = printed_rounding(list(values.values())) * (math.radians(1.0) if "degrees" in units.values() else 1.0)
    for role, angle in values.items():
        values[role] = _inside(text, columns[role].name, role, angle, units[role])
    radians = {role: np.radians(v) if units[role] == "degrees" else v for role, v in values.items()}
    if set(columns) == set(IN_PLANE):
        return _in_plane(
            text, columns, radians, rounding, (f"{' and '.join(sorted(set(units.values())))} ({who})", who)
        )
    negative = [role for role in ("theta_i", "theta_o") if role in radians and (radians[role] < 0).any()]
    for role in negative:
        count = int((radians[role] < 0).sum())
        understood.append(f"{columns[role].name[:40]} below 0 ({count} rows) is read as its size with phi + 180°")
    if "phi_i" not in columns and {"phi_o", "delta_phi"} & columns.keys():
        understood.append("azimuths are counted from the light's" + ("" if turned else ", 180° at the mirror side"))
    names = " and ".join(sorted(set(units.values())))
    if turned:
        side_of = "delta_phi" if "delta_phi" in radians else "phi_o"
        radians[side_of] = radians[side_of] + math.pi
        understood.append(f"azimuths differ by 0 at the mirror side: 180° is added to {columns[side_of].name[:40]}")
    four, source = _four_angles(radians), f"{names} ({who})"
    if "theta_h" in columns:
        below = np.logical_or(*(side(np.cos(a)) < 0 for a in (four[0], four[2])))
        return Directions(four, rounding, source, understood, who != "not stated", below)
    return Directions(four, rounding, source, understood + _behind(four), who != "not stated")


def _in_plane(
    text: CsvText,
    columns: Mapping[str, Column],
    radians: Mapping[str, np.ndarray],
    rounding: float,
    source: tuple[str, str],
) -> Directions:
    """The directions of signed polar angles in the plane of incidence; refuses those whose signs say no sides."""
    theta_i, theta_o = (radians[role] for role in IN_PLANE)
    light, detector = (columns[role].name[:40] for role in IN_PLANE)
    if not (theta_o < 0).any() and not (theta_i < 0).any() and (theta_o > 0).any() and (theta_i > 0).any():
        text.refuse(
            f"it has {light} and {detector} above 0 and no azimuth; give phi_i and phi_o, or delta_phi, or signs: "
            f"{detector} above 0 on the mirror side, below it on the light's"
        )
    frame = bool((theta_i < 0).any())
    one = "both have the sign of one side" if frame else f"{detector} is above 0 on the mirror side"
    zero = np.zeros_like(theta_i)
    pairs = _unsigned(theta_i, zero), _unsigned(theta_o, zero if frame else zero + math.pi)
    four = (*pairs[0], *pairs[1])
    understood = [f"{c.name[:40]} is {role}" for role, c in columns.items() if c.name != role]
    understood.append(f"without azimuths they are in the plane of incidence: {one}")
    return Directions(four, rounding, source[0], understood + _behind(four), source[1] != "not stated")


def _behind(angles: Angles) -> list[str]:
    """What is understood of directions behind the sample."""
    rows = {name: int((side(np.cos(a)) < 0).sum()) for name, a in (("light", angles[0]), ("detector", angles[2]))}
    return [
        f"the {name} is behind the sample, beyond 90° from its normal, in {n} rows" for name, n in rows.items() if n
    ]


def _units(
    text: CsvText, statements: Statements, columns: Mapping[str, Column], stated: str | None
) -> tuple[dict[str, str], str]:
    """(unit of each column by its role, who says so)."""
    if stated is not None and stated not in UNITS:
        raise GonioError(f"angles={stated!r} is no unit of angles; give degrees or radians")
    written = {}
    for role, c in columns.items():
        if c.unit not in ANGLE_UNITS and c.unit not in NO_UNIT:
            text.refuse(f"the column {c.name[:40]!r} has the unit {c.unit[:20]!r}; convert it to deg or rad")
        if c.unit in ANGLE_UNITS:
            written[role] = ANGLE_UNITS[c.unit]
    contradictory = [columns[role].name for role, unit in written.items() if stated not in (None, unit)]
    if contradictory:
        text.refuse(f"the column {contradictory[0][:40]!r} says its unit, not {stated}; leave --angles out")
    comment = "degrees" if statements.by_gonio else statements.angle_unit(stated is not None)
    if stated is not None and comment not in (None, stated):
        text.refuse(
            f"a comment says that angles are in {comment}, not {stated}; leave --angles out, or mend the comment"
        )
    rest = stated or comment
    if rest is None and written:
        rest = next(iter(written.values()))
    if comment is not None and set(written.values()) - {comment}:
        text.refuse("header and comments name different units of angles; state --angles degrees or radians")
    who = (
        "stated by the caller"
        if stated
        else "the header says so"
        if written
        else "a comment says so"
        if rest
        else "not stated"
    )
    return {role: written.get(role, rest or "degrees") for role in columns}, who


def _of_vectors(text: CsvText, values: Mapping[str, np.ndarray]) -> Angles:
    angles: list[np.ndarray] = []
    for which in ("wi", "wo"):
        x, y, z = (values[f"{which}_{c}"] for c in "xyz")
        off = np.abs(np.sqrt(x**2 + y**2 + z**2) - 1.0)
        if (off > UNIT_TOLERANCE).any():
            text.fail(int(np.argmax(off > UNIT_TOLERANCE)), f"{which} is no unit vector; divide it by its length")
        angles += spherical_angles(x, y, z)
    theta_i, phi_i, theta_o, phi_o = angles
    return theta_i, phi_i, theta_o, phi_o


def _inside(text: CsvText, name: str, role: str, angle: np.ndarray, unit: str) -> np.ndarray:
    """Angles of a column in their domain, those on the horizon exactly; refuses others with the line."""
    half = HALF_TURN[unit]
    polar = role in POLAR
    # What is printed with few digits may lie beyond a quarter, a half or a whole turn by half of the last one.
    slack = min(max(printed_rounding([angle]), half * SINGLE), half * 1e-3)
    limit = half / 2 if role.startswith("theta") and not polar else half if polar else 2 * half
    outside = np.abs(angle) > limit + slack
    if outside.any():
        domain = f"0 to {limit:.6g} {unit} from the normal" if polar else f"-{limit:.6g} to {limit:.6g} {unit}"
        remedy = "; are these degrees? state --angles degrees" if unit == "radians" and np.abs(angle).max() > 7 else ""
        row = int(np.argmax(outside))
        text.fail(row, f"{name[:40]} = {angle[row]:g}; expected {domain}{remedy}")
    if not polar:
        return angle
    size = np.minimum(np.abs(angle), half)
    on_horizon = (size > half / 2) & (size <= half / 2 + slack)
    return np.copysign(np.where(on_horizon, half / 2, size), angle)


def _four_angles(a: Mapping[str, np.ndarray]) -> Angles:
    """theta_i, phi_i, theta_o, phi_o of the angles that a file has, radians."""
    if "theta_h" in a:
        return _of_half_difference(a)
    zero = np.zeros_like(a["theta_i"])
    phi_i = a.get("phi_i", zero)
    if "phi_i" not in a and {"phi_o", "delta_phi"} <= a.keys():
        phi_i = a["phi_o"] - a["delta_phi"]
    phi_o = a["phi_o"] if "phi_o" in a else phi_i + a["delta_phi"]
    theta_i, phi_i, theta_o, phi_o = *_unsigned(a["theta_i"], phi_i), *_unsigned(a["theta_o"], phi_o)
    return theta_i, phi_i, theta_o, phi_o


def _unsigned(theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(theta in [0, π], phi in [0, 2π)) of a signed polar angle and its azimuth."""
    turned = np.where(theta < 0, phi + math.pi, phi) % (2 * math.pi)
    return np.abs(theta), np.where(turned >= 2 * math.pi, 0.0, turned)


def _of_half_difference(a: Mapping[str, np.ndarray]) -> Angles:
    from gonio.models.geometry.directions import pair_from_half_difference_trig, rotate_z

    trig = [f(a[name]) for name in HALF_DIFFERENCE for f in (np.cos, np.sin)]
    pair = pair_from_half_difference_trig(*trig)
    turn = a.get("phi_h", np.zeros(1))
    (theta_i, phi_i), (theta_o, phi_o) = (spherical_angles(*rotate_z(w, np.cos(turn), np.sin(turn))) for w in pair)
    return theta_i, phi_i, theta_o, phi_o


def printed_rounding(columns: list[np.ndarray]) -> float:
    """Half of the last printed digit, in the unit of the numbers, of the larger ones: %g prints more of the smaller."""
    values = np.abs(np.concatenate(columns))
    values = np.unique(values[values >= 0.3 * values.max()])
    for digits in range(MOST_DIGITS):
        scaled = values * 10.0**digits
        if (np.abs(scaled - np.round(scaled)) < 1e-4).all():
            return 0.5 * 10.0**-digits
    return 0.0
