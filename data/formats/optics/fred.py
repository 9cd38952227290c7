"""FRED's text files of readings: blocks of a specular direction and of scattered directions with their values.

The header has "type bsdf_data" and "format angles=deg bsdf=value scale=1"; a line of two numbers is the specular
direction, theta and phi, a line of three a scattered direction and its value. Without the header, after lines that
begin with "!!", as VIAVI's files are.
"""

import os
import re
from typing import NamedTuple

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.flags import Flag
from gonio.data.formats.csv.readings import Readings, on_grid
from gonio.data.formats.optics.text_lines import MOST_VALUES, TextLines
from gonio.data.layouts.recognition import recognised
from gonio.data.table import COPIED, Table
from gonio.models.errors import one_line

KIND = "a FRED BSDF file"
REMARKS = ("!", "#", "//")


class _Rows(NamedTuple):
    """The readings of a file, (n,), and what stands before them."""

    specular: np.ndarray
    """(n, 2): theta and phi, degrees."""
    scattered: np.ndarray
    """(n, 2)."""
    values: np.ndarray
    """As in the file."""
    words: dict[str, str]
    remarks: list[str]


def read_fred(path: str | os.PathLike[str]) -> Table:
    """The table of a FRED file: on the grid that its rows are, else scattered.

    Raises GonioError, with the line, for a damaged file, and for angles that are given as sines.
    """
    rows = _rows(TextLines(path, KIND, comment=""))
    transmits = bool((np.abs(rows.scattered[:, 0]) > 90).any()) or any(
        re.search(r"(?i)\bbtdf\b", r) for r in rows.remarks
    )
    theta_i, phi_i = _direction(rows.specular[:, 0], rows.specular[:, 1] + 180)
    theta_o, phi_o = _direction(*rows.scattered.T)
    if transmits:
        theta_o = np.where(theta_o <= np.pi / 2, np.pi - theta_o, theta_o)
    values = rows.values
    if rows.words["bsdf"] == "log":
        with np.errstate(over="ignore"):
            values = 10.0**values
    with np.errstate(over="ignore"):
        f = values[:, None] * float(rows.words["scale"])
    flag = np.where(np.isfinite(f), np.uint8(Flag.VALID), np.uint8(Flag.INVALID))
    understood = _understood(rows, transmits)
    table = _placed((theta_i, phi_i, theta_o, phi_o), f, flag, understood)
    table.name = stem(path)
    table.provenance |= {
        "format": "FRED BSDF",
        "source": os.path.basename(path),
        "comments": [one_line(r) for r in rows.remarks[:200]],
        "understood": understood,
    }
    return table


def _rows(text: TextLines) -> _Rows:
    words, remarks = _header(text)
    specular: np.ndarray | None = None
    rows: list[tuple[float, ...]] = []
    while text.peek():
        line = text.next("its readings")
        if line.startswith(REMARKS):
            remarks.append(line.strip("!#/ "))
            continue
        numbers = text.parsed(line, "a direction")
        if numbers.size not in (2, 3) or not np.isfinite(numbers[:2]).all() or np.abs(numbers[0]) > 180:
            text.fail(f"{one_line(line, 40)!r}; expected theta and phi in degrees, or these and a value")
        if numbers.size == 2:
            if np.abs(numbers[0]) >= 90:
                text.fail(f"the specular direction has theta {numbers[0]:g}; expected less than 90 degrees")
            specular = numbers
        elif specular is None:
            text.fail("a value comes before any specular direction (a line of theta and phi alone)")
        elif len(rows) >= MOST_VALUES >> 2:
            text.fail(f"it has above {MOST_VALUES >> 2:,} readings; split the file")
        else:
            rows.append((*specular, *numbers))
    if not rows:
        text.refuse("it has no reading; copy it again")
    table = np.array(rows)
    return _Rows(table[:, :2], table[:, 2:4], table[:, 4], words, remarks)


def _header(text: TextLines) -> tuple[dict[str, str], list[str]]:
    words, remarks = {"angles": "deg", "bsdf": "value", "scale": "1"}, []
    while (line := text.peek()) and re.match(r"[^-+.\d]", line):
        text.next("its header")
        if line.startswith(REMARKS):
            remarks.append(line.strip("!#/ "))
        elif line.lower().split()[0] == "format":
            words_of_line = "=".join(part.strip() for part in line.split("=")).split()[1:]
            given = dict(w.split("=", 1) for w in words_of_line if "=" in w)
            words |= {k.lower(): v.strip("[]").lower() for k, v in given.items() if k.lower() in words}
        elif line.lower().split() != ["type", "bsdf_data"]:
            text.fail(f"{one_line(line, 40)!r} is no line of {KIND}; expected 'type bsdf_data' and 'format ...'")
    if words["angles"] != "deg":
        text.refuse(f"its angles are {one_line(words['angles'], 20)!r}, whose order nobody states; write angles=deg")
    if words["bsdf"] not in ("value", "log"):
        text.refuse(f"its bsdf is {one_line(words['bsdf'], 20)!r}; expected 'value' or 'log'")
    if not re.fullmatch(r"[-+]?(?:\d{1,15}\.?\d{0,15}|\.\d{1,15})(?:[eE][-+]?\d{1,3})?", words["scale"], re.ASCII):
        text.refuse(f"its scale is {one_line(words['scale'], 20)!r}; expected a number, with a decimal point")
    return words, remarks


def _direction(theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Polar angle and azimuth in [0, 2π), radians, of degrees with a sign."""
    turn = np.round((phi + np.where(theta < 0, 180.0, 0.0)) % 360.0, 9)
    return np.radians(np.abs(theta)), np.radians(np.where(turn >= 360.0, 0.0, turn))


def _placed(angles: tuple[np.ndarray, ...], f: np.ndarray, flag: np.ndarray, understood: list[str]) -> Table:
    theta_i, phi_i, theta_o, phi_o = angles
    placed = recognised((theta_i, phi_i, theta_o, phi_o))
    grid = None if placed is None else on_grid(placed, Readings(f, None, flag))
    layout, copied = layouts.scattered(*angles), False
    if placed is not None and grid is not None:
        layout, (readings, repeats) = placed.layout, grid
        f, flag = readings.f, readings.flag
        copied = bool((placed.origins != np.arange(layout.size)).any())
        understood.append(f"its directions are a grid ({layout.name})")
        understood += [repeats.sentence()] if repeats else []
        understood += ["azimuths are of one side only: the other is taken as its mirror image"] * bool(
            layout.mirrored_axes
        )
    flag = flag.copy()
    flag[~layout.readable()] = Flag.BELOW_HORIZON
    f = np.where(flag == Flag.VALID, f, np.nan)
    f, flag = (a.reshape(*layout.shape, -1) for a in (f, flag))
    return Table(layout, f, flag, Channels.grey(), provenance={COPIED: True} if copied else {})


def _understood(rows: _Rows, transmits: bool) -> list[str]:
    sentences = ["the light comes from the side opposite to the stated specular direction; angles are degrees"]
    if (rows.scattered[:, 0] < 0).any():
        sentences.append("a negative theta of a scattered direction stands for the other side of the normal")
    sentences.append(
        "values are f, 1/sr"
        + (", by their common logarithm" if rows.words["bsdf"] == "log" else "")
        + (f", times {float(rows.words['scale']):g}" if float(rows.words["scale"]) != 1 else "")
    )
    if transmits:
        sentences.append("transmission, by its angles or a remark: directions are taken behind the sample")
    else:
        sentences.append("the format does not say reflection or transmission: taken as reflection")
    return sentences
