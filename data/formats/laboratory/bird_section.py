"""What gonio adds to a BiRD file, where its schema has room for it: the grid, the flags and the unknown uncertainties.

Each row names its cell in the variable `cell`; the section `gonio` of the metadata holds layout and channels, and the
readings without a value as lists.
"""

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.formats.laboratory.json_text import JsonPart
from gonio.data.layouts import Layout
from gonio.data.table import Table
from gonio.models.errors import GonioError

SECTION = "gonio"
MOST_READINGS = 1 << 24
DIRECTIONS = ("theta_i", "phi_i", "theta_r", "phi_r")


def section_of(table: Table, cells: np.ndarray, valid: np.ndarray, degrees: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The section of a table.

    Args:
        table: the table.
        cells: numbers of the cells that can be read, (n,).
        valid: which of their readings have rows, (n, channels).
        degrees: their angles by `DIRECTIONS`, (n,).
    """
    row, channel = np.nonzero(~valid)
    axes = {name: axis.tolist() for name, axis in table.layout.axes.items()} if table.layout.gridded else {}
    u_f = table.values_at(cells)["u_f"][valid]
    gaps = {"cell": row if not table.layout.gridded else cells[row], "channel": channel}
    gaps |= {"flag": table.values_at(cells)["flag"][row, channel]} | {k: a[row] for k, a in degrees.items()}
    content: dict[str, Any] = {"layout": {"name": table.layout.name, "axes": axes}, "channels": table.channels.names}
    if table.channels.wavelengths_nm is not None:
        content["wavelengths_nm"] = table.channels.wavelengths_nm
    content["not_read"] = {k: v.tolist() for k, v in gaps.items()}
    content["unknown_uncertainty"] = np.flatnonzero(np.isnan(u_f)).tolist() if table.u_f is not None else []
    return content


def stored_table(file: JsonPart, f: np.ndarray, u_f: np.ndarray | None, angles: np.ndarray) -> Table | None:
    """The table that gonio wrote, cell by cell; None for other files, and where the section does not fit the rows.

    Args:
        file: the whole file.
        f, u_f: readings and uncertainties of its rows, (n,).
        angles: theta_i, phi_i, theta_o, phi_o of its rows, radians, (4, n).
    """
    metadata = file.data.get("metadata")
    adhoc = metadata.get("adhoc_section") if isinstance(metadata, dict) else None
    if not isinstance(adhoc, dict) or SECTION not in adhoc:
        return None
    with contextlib.suppress(GonioError):
        return _table(file, JsonPart(file.path, adhoc[SECTION], SECTION), f, u_f, angles)
    return None


def _table(
    file: JsonPart, section: JsonPart, f: np.ndarray, u_f: np.ndarray | None, angles: np.ndarray
) -> Table | None:
    variables = file.part("data").part("adhoc_variables")
    gaps = section.part("not_read")
    lost = _whole(gaps.numbers("cell"))
    rows = _whole(variables.part("cell").numbers("values", count=f.size))
    channels = _channels(section)
    names = [str(name) for name in variables.part("channel").entries("values")]
    numbers = {name: k for k, name in enumerate(channels.names)}
    if len(names) != f.size or not set(names) <= set(numbers):
        return None
    channel = np.array([numbers[name] for name in names], np.intp)
    where = np.radians([gaps.numbers(name, count=lost.size) for name in DIRECTIONS])
    layout = _layout(section, np.concatenate([rows, lost]), np.concatenate([angles, where], axis=1))
    missing, flags = _whole(gaps.numbers("channel", count=lost.size)), _whole(gaps.numbers("flag", count=lost.size))
    shape = layout.size, len(channels)
    if max(rows.max(initial=0), lost.max(initial=0)) >= layout.size or missing.max(initial=0) >= len(channels):
        return None
    flag = np.full(shape, np.uint8(Flag.BELOW_HORIZON))
    flag[layout.readable()] = Flag.NOT_MEASURED
    flag[rows, channel], flag[lost, missing] = Flag.VALID, np.minimum(flags, max(Flag))
    values = np.full((2, *shape), np.nan)
    values[0][rows, channel] = f
    if u_f is not None:
        u_f[_whole(section.numbers("unknown_uncertainty"), f.size)] = np.nan
        values[1][rows, channel] = u_f
    flag, f, u = (a.reshape(*layout.shape, -1) for a in (flag, *values))
    return Table(layout, f, flag, channels, None if u_f is None else u)


def _whole(numbers: np.ndarray, below: int = MOST_READINGS) -> np.ndarray:
    """Numbers of cells, channels or rows. Raises GonioError for others."""
    if not ((numbers >= 0) & (numbers < below)).all():
        raise GonioError("a number of a cell is out of range")
    return numbers.astype(np.intp)


def _channels(section: JsonPart) -> Channels:
    wavelengths = tuple(section.numbers("wavelengths_nm")) if "wavelengths_nm" in section else None
    return Channels(tuple(str(name) for name in section.entries("channels")), wavelengths)


def _layout(section: JsonPart, cells: np.ndarray, angles: np.ndarray) -> Layout:
    """The stated grid, or the scattered directions of all cells."""
    stated = section.part("layout")
    kind = layouts.LAYOUTS.get(stated.text("name"))
    if kind is None or not kind.gridded:
        if cells.max(initial=0) >= cells.size:
            raise GonioError("some cells have no row")
        four = np.zeros((4, int(cells.max(initial=0)) + 1))
        four[:, cells] = angles % (2 * np.pi)
        return layouts.scattered(*four)
    axes = stated.part("axes")
    sizes = [len(axes.entries(name)) for name in axes.data]
    if np.prod(np.array(sizes, float)) * len(section.entries("channels")) > MOST_READINGS:
        raise GonioError("the grid is too large")
    return kind({name: axes.numbers(name) for name in axes.data})
