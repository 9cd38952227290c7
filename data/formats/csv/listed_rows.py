"""Rows of directions and readings out of any file: converted once, and put on the grid that they are."""

import math
import os
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.flags import Flag
from gonio.data.formats.csv.conventions import Convention
from gonio.data.formats.csv.directions import printed_rounding
from gonio.data.formats.csv.readings import Readings, Repeats, on_grid
from gonio.data.layouts.recognition import LARGEST_ROUNDING, Angles, Placement, recognised
from gonio.data.plausibility.suspicions import suspicions
from gonio.data.quantities import QUANTITIES, brdf_of
from gonio.data.table import COPIED, Table
from gonio.models.errors import GonioError

SAME_DIRECTION = 1e-9
"""Radians by which the rows of gonio's own file may be off the cells that it names."""
SLACK = 1e-5
"""Radians by which what was printed or rounded may lie beyond a right angle or half a turn."""


class Listing(NamedTuple):
    """The rows of a file as it has them."""

    angles: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    """theta_i, phi_i, theta_o, phi_o, radians, (n,); a polar angle below 0 has its azimuth turned by half a circle."""
    f: np.ndarray
    """(n, channels), of the file's quantity."""
    channels: Channels
    u_f: np.ndarray | None = None
    """Standard uncertainties of `f`, of the same quantity."""
    flag: np.ndarray | None = None
    """uint8; None: valid where `f` is a number."""
    rounding: float = 0.0
    """Radians by which printing may have moved an angle."""


def rounding_of(columns: Iterable[np.ndarray], radians: float = 1.0) -> float:
    """Radians by which printing may have moved the angles of any column; 0 where they are taken as exact.

    `radians`: one unit of the columns.
    """
    with np.errstate(all="ignore"):  # numbers that are no angles are refused later
        largest = max((printed_rounding([c]) * radians for c in columns if c.any()), default=0.0)
    return largest if largest <= LARGEST_ROUNDING else 0.0


def table_of_listing(
    path: str | os.PathLike[str], listing: Listing, how: Convention, about: dict[str, Any], name: str = ""
) -> Table:
    """The table of a file's rows: on the grid that they are, else scattered.

    Args:
        path: the file, for messages.
        listing: its rows.
        how: what the file leaves open.
        about: provenance; sentences are added to its `understood` and `warnings`.
        name: of the table, where the file says one.

    Raises:
        GonioError: no rows, or angles that are none.
    """
    if not listing.f.size:
        raise GonioError(f"{path} has no rows of readings; expected at least one")
    angles, understood = _directions(path, listing, how.mirror_azimuth == 0.0)
    cosines = np.abs(np.cos(angles[0])), np.abs(np.cos(angles[2]))
    with np.errstate(over="ignore"):  # what is beyond all numbers becomes INVALID
        f, u_f = (None if v is None else brdf_of(v, how.quantity, *cosines) for v in (listing.f, listing.u_f))
    assert f is not None
    flag = np.zeros(f.shape, np.uint8) if listing.flag is None else listing.flag.copy()
    flag[~np.isfinite(f) & (flag == Flag.VALID)] = Flag.INVALID
    if how.quantity == "brdf":
        understood.append(
            "the values are f, 1/sr" + ("" if how.quantity_known else "; if they are not, state --quantity")
        )
    else:
        understood.append(f"the values are {QUANTITIES[how.quantity].meaning}, and divided by what f lacks of that")
    placed = recognised(angles, listing.rounding)
    table = table_of_rows(angles, Readings(f, u_f, flag), listing.channels, placed, understood)
    table.name = name or stem(path)
    provenance = {"source": os.path.basename(path), **about, "understood": [*about.get("understood", []), *understood]}
    earlier = [*about.get("warnings", []), *table.provenance.get("warnings", [])]
    if warnings := [*earlier, *suspicions(table, quantity_unknown=not how.quantity_known)]:
        provenance["warnings"] = warnings
    table.provenance |= provenance
    return table


def _directions(path: str | os.PathLike[str], listing: Listing, along: bool) -> tuple[Angles, list[str]]:
    """(theta_i, phi_i, theta_o, phi_o) in [0, π] and [0, 2π), and what was understood of them."""
    result, understood = [], []
    for k, (name, side) in enumerate((("theta_i", "light"), ("theta_o", "detector"))):
        theta, phi = listing.angles[2 * k : 2 * k + 2]
        wrong = ~(np.abs(theta) <= math.pi + SLACK) | ~np.isfinite(phi)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise GonioError(
                f"{path}: row {row + 1} of its readings has {name} {np.degrees(theta[row]):.6g}° and azimuth "
                f"{np.degrees(phi[row]):.6g}°; expected polar angles from 0 to 180°, in the unit of the format"
            )
        size = np.minimum(np.abs(theta), math.pi)
        # A right angle of few digits lies on either side of it.
        size = np.where(np.abs(size - math.pi / 2) <= max(listing.rounding, SAME_DIRECTION), math.pi / 2, size)
        turn = np.where(theta < 0, math.pi, 0.0) + (math.pi if along and k else 0.0)
        azimuth = (phi + turn) % (2 * math.pi)
        result += [size, np.where(azimuth >= 2 * math.pi, 0.0, azimuth)]
        if negative := int((theta < 0).sum()):
            understood.append(f"{name} below 0 ({negative} rows) is read as its size with the azimuth + 180°")
        if behind := int((np.cos(size) < -1e-6).sum()):
            understood.append(f"the {side} is behind the sample, beyond 90° from its normal, in {behind} rows")
    mirror = "0: as the file has the mirror side there, 180° is added to the detector's azimuth" if along else "180°"
    understood.append(f"the mirror side is where the azimuths differ by {mirror}")
    return (result[0], result[1], result[2], result[3]), understood


def table_of_rows(
    angles: Angles, rows: Readings, channels: Channels, placed: Placement | None, understood: list[str]
) -> Table:
    """The table of rows of readings, on a grid where they have places in one; adds to `understood` what became of them.

    Args:
        angles: theta_i, phi_i, theta_o, phi_o of the rows, radians; azimuths in [0, 2π).
        rows: their readings of f.
        channels: of the readings.
        placed: the grid whose cells the rows are; None: they are scattered.
        understood: sentences.
    """
    grid = None if placed is None else on_grid(placed, rows)
    warnings: list[str] = []
    if placed is None or grid is None:
        layout, readings = layouts.scattered(*angles), rows
    else:
        layout, (readings, repeats) = placed.layout, grid
        understood += _of_grid(placed, repeats)
        warnings = repeats.warnings() if repeats else []
    flag = readings.flag.copy()
    flag[~layout.readable()] = Flag.BELOW_HORIZON
    f = np.where(flag == Flag.VALID, readings.f, np.nan)
    if missing := int((flag == Flag.NOT_MEASURED).sum()):
        understood.append(f"{missing} readings of {flag.size} are missing")
    f, u_f, flag = (None if a is None else a.reshape(*layout.shape, -1) for a in (f, readings.u_f, flag))
    copied = placed is not None and grid is not None and (placed.origins != np.arange(layout.size)).any()
    about = ({COPIED: True} if copied else {}) | ({"warnings": warnings} if warnings else {})
    return Table(layout, f, flag, channels, u_f, about)


def _of_grid(placed: Placement, repeats: Repeats | None) -> list[str]:
    layout = placed.layout
    sizes = " × ".join(f"{axis.size} {name}" for name, axis in layout.axes.items())
    sentences = [f"the rows are a grid ({layout.name}: {sizes})"]
    copied = int((placed.origins != np.arange(layout.size)).sum())
    if copied:
        sentences.append(
            f"at the pole, where azimuth has no meaning, one reading stands for all azimuths ({copied} cells)"
        )
    if repeats:
        sentences.append(repeats.sentence())
    if layout.mirrored_axes:
        sentences.append("azimuths are of one side only: the other is taken as its mirror image")
    if layout.in_half_vectors:
        sentences.append(
            "half and difference angles without the half vector's azimuth: the surface is taken as isotropic"
        )
    if placed.turned > SAME_DIRECTION:
        sentences.append(f"the light's azimuth, {np.degrees(placed.turned):.6g}° in all rows, is 0 in the grid")
    return sentences
