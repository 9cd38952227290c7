"""Writing tabular ``.bsdf`` files of Zemax OpticStudio of tables and models."""

import os

import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import new_file
from gonio.data.flags import Flag
from gonio.data.formats.optics.grid_source import GridSource, mirror_layout
from gonio.data.formats.optics.hemispherical_totals import grid_totals
from gonio.data.formats.optics.zemax import read_zemax
from gonio.data.material import Material
from gonio.data.round_trip import RoundTrip
from gonio.data.table import Table
from gonio.models.errors import GonioError, nearest

PARTS = {"reflection": (1, 1), "transmission": (1, -1)}
STEP = 5.0
LEAST_STEP, LARGEST_STEP = 0.25, 45.0


def write_zemax(
    path: str | os.PathLike[str],
    source: Table | Material,
    force: bool = False,
    part: str | None = None,
    channel: str | None = None,
    step: float | None = None,
) -> RoundTrip:
    """Writes reflection or transmission of light in front as a Zemax BSDF file, and returns what is lost by it.

    A table on a grid about the mirror direction, or straight through, is written node by node; all else is sampled on
    such a grid, fine about its middle. Nodes beyond the horizon are written as 0; TIS is the integral of the values.

    Args:
        path: the file.
        source: a table or a material, of one channel or of X, Y, Z.
        force: replaces an existing file.
        part: "reflection" or "transmission"; where there is one alone, that one, else reflection.
        channel: writes this channel alone.
        step: degrees, of the sampled grid, by default 5.

    Raises:
        GonioError: channels that are neither one nor X, Y, Z, a part that the source does not have, a step out of
            range, a path that cannot be written.
    """
    whole = GridSource.of(source, channel)
    if len(whole.channels) > 1 and whole.channels.names != ("X", "Y", "Z"):
        names = ", ".join(whole.channels.names[:8])
        raise GonioError(f"a Zemax file holds one channel, or X, Y, Z, and there are {names}; name one with --channel")
    name = chosen_part(whole, part)
    layout = mirror_layout(whole, checked_step(step, STEP), name == "transmission")
    table, note = whole.on(layout)
    rest = sorted(k for k, sides in PARTS.items() if sides in whole.sides and k != name)
    notes = [
        note,
        f"{rest[0]} left out: --part {rest[0]}" if rest else "",
        whole.media_note if name == "transmission" else "",
    ]
    with new_file(path, force) as temporary:
        temporary.write_text(_text(table, name), encoding="utf-8")
        written = read_zemax(temporary)
    return whole.compared(written, "; ".join(filter(None, notes)))


def chosen_part(source: GridSource, part: str | None) -> str:
    """The part that is asked, or the first that there is. Raises GonioError for one that there is not."""
    there = [name for name, sides in PARTS.items() if sides in source.sides]
    if part is not None and part not in PARTS:
        raise GonioError(f"part {part[:40]!r} is unknown; {nearest(part[:40], PARTS)}")
    if not there or (part is not None and part not in there):
        what = part or "reflection or transmission"
        raise GonioError(f"{source.source.name or 'the source'} has no {what} of light in front of the sample")
    return part or there[0]


def checked_step(step: float | None, default: float) -> float:
    """The step of a sampled grid, degrees. Raises GonioError for one out of range."""
    if step is not None and not LEAST_STEP <= step <= LARGEST_STEP:
        raise GonioError(f"a step of {step:g} degrees; give one from {LEAST_STEP:g} to {LARGEST_STEP:g}")
    return default if step is None else float(step)


def degrees(radians: np.ndarray) -> np.ndarray:
    """Degrees that give back these radians: the rounded number that a person would write, where that does."""
    exact = np.degrees(radians)
    rounded = np.round(exact, 10) + 0.0
    return np.where(np.radians(rounded) == radians, rounded, exact)


def _text(table: Table, part: str) -> str:
    layout = table.layout
    theta_i, theta_m, phi_m, *turn = layout.axes.values()
    mirrored = bool(layout.mirrored_axes)
    rotation, turns = _closed(np.round(-degrees(turn[0]) % 360, 10) if turn else np.zeros(1), bool(turn))
    azimuth, around = _closed(degrees(phi_m), not mirrored)
    symmetry = "ASymmetrical4D" if turn else "PlaneSymmetrical" if mirrored else "Asymmetrical"
    wavelengths = table.channels.wavelengths_nm
    lists = {
        "SampleRotation": rotation,
        "AngleOfIncidence": degrees(theta_i),
        "ScatterAzimuth": azimuth,
        "ScatterRadial": degrees(theta_m),
    }
    lines = [
        f"# {table.name}, written by gonio",
        *([f"# Wavelength (nm) = {wavelengths[0]!r}"] if wavelengths else []),
        "Source\tMeasured",
        f"Symmetry\t{symmetry}",
        f"SpectralContent\t{'Monochrome' if len(table.channels) == 1 else 'XYZ'}",
        f"ScatterType\t{'BRDF' if part == 'reflection' else 'BTDF'}",
    ]
    for name, angles in lists.items():
        lines += [f"{name}\t{angles.size}", numbers(angles)]
    lines.append("")
    f = np.where(table.flag == Flag.VALID, table.f, np.nan).reshape(*layout.shape[:3], -1, len(table.channels))
    for c, channel in enumerate(_sections(table.channels)):
        lines += [channel, "DataBegin"]
        for r in turns:
            tis = grid_totals(theta_m, phi_m, f[:, :, :, r, c : c + 1], theta_i, mirrored)[:, 0]
            for of_light, total in zip(np.nan_to_num(f[:, :, :, r, c]), tis, strict=True):
                lines += [f"TIS\t{total:.6g}", *(numbers(of_light[:, a]) for a in around)]
        lines.append("DataEnd")
    return "\n".join(lines) + "\n"


def _closed(angles: np.ndarray, whole: bool) -> tuple[np.ndarray, np.ndarray]:
    """(angles in order, the node of each); a whole turn that begins at 0 ends there too, as OpticStudio wants it."""
    order = np.argsort(angles)
    if whole and angles[order[0]] == 0:
        return np.append(angles[order], 360.0), np.append(order, order[0])
    return angles[order], order


def numbers(values: np.ndarray) -> str:
    """Numbers apart by tabulators, so that reading them gives the same."""
    return "\t".join(map(repr, np.asarray(values, float).tolist()))


def _sections(channels: Channels) -> list[str]:
    return ["Monochrome"] if len(channels) == 1 else [f"Tristimulus{name}" for name in channels.names]
