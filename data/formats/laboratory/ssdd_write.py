"""Writing SSDD 0.3: a table on its grid, or a table without one and a model on a grid about the mirror direction."""

import math
import os
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import new_file
from gonio.data.flags import Flag
from gonio.data.formats.csv.table_file import rounded_degrees
from gonio.data.formats.laboratory.matched import matched, sampled_error
from gonio.data.formats.laboratory.ssdd import read_ssdd
from gonio.data.formats.laboratory.ssdd_text import MARK, MOST_BYTES
from gonio.data.layouts import Layout
from gonio.data.material import Material
from gonio.data.reflection_only import require_reflection
from gonio.data.round_trip import RoundTrip
from gonio.data.table import Table, whole_table_of_values
from gonio.models.errors import GonioError

PARAMETERS = {
    "isotropic": "spherical", "in_plane": "spherical", "spherical": "spherical", "mirror": "specular",
    "straight": "specular", "half_difference": "half_difference",
}  # fmt: skip
"""The file's coordinates, by the layouts that have them."""
THETA_I = np.arange(0.0, 86.0, 5.0)
"""Degrees, of a table without a grid and of a model."""
THETA_M = np.concatenate([np.arange(0, 2, 0.25), np.arange(2, 5, 0.5), np.arange(5, 20, 1), np.arange(20, 181, 5)])
PHI_M = np.arange(0.0, 181.0, 15.0)
PHI_I = np.arange(0.0, 360.0, 15.0)
FLOAT32 = float(np.finfo(np.float32).max)


class _Part(NamedTuple):
    """A block to be written."""

    kind: str
    parameters: str
    reductions: list[str]
    lists: list[np.ndarray]
    """Degrees, of four parameters."""
    values: np.ndarray
    """(parameter 0, 1, 2, 3, channel)."""
    flags: np.ndarray


def write_ssdd(
    path: str | os.PathLike[str], source: Table | Material, force: bool = False, ascii: bool = False
) -> RoundTrip:
    """Writes a table or a model, and returns what reading the file again shows to be lost.

    Cells without a value get that of the nearest, as other readers need numbers there, and their flags stand in a
    comment, which gonio reads. The format has no uncertainties.

    Args:
        path: the file.
        source: a table, or a material.
        force: replaces an existing file.
        ascii: numbers as text, at full precision; else binary, in single precision.

    Raises:
        GonioError: light from behind the sample, a table without valid readings or on no grid of the format's and with
            readings about less than half of the directions, channels that are neither one nor
            R, G, B, X, Y, Z nor wavelengths, and where `path` cannot be written.
    """
    table, continued = _of_own_grid(source), ""
    if table is None:
        table, continued = _on_mirror_grid(source)
    if any(light < 0 for light, _ in table.sides):
        raise GonioError("an SSDD file has light from the front alone; convert those readings to .h5 or .csv")
    colour = _colour(table.channels)
    parts = [_part(*item) for item in sorted(_filled(table).items(), reverse=True)]
    head = ["VERSION 0.3", "SOFTWARE gonio", f"DATE {datetime.now(UTC).date().isoformat()}"]
    data = ("\n".join(head) + "\n").encode() + b"".join(_block(p, colour, table, ascii) for p in parts)
    if len(data) > MOST_BYTES:
        raise GonioError(
            f"the file would have {len(data) >> 20} MiB, and at most {MOST_BYTES >> 20} are read; reduce it"
        )
    with new_file(path, force) as temporary:
        temporary.write_bytes(data)
        again = read_ssdd(temporary)
    notes = ["text" if ascii else "single precision"]
    notes += ["without the uncertainties"] if isinstance(source, Table) and source.u_f is not None else []
    notes += ["without the channels' names"] if table.channels.names != again.channels.names else []
    if table.layout.name != "mirror" or table is source:
        return matched(table, again, ", ".join(notes))
    notes.append(f"on a grid about the mirror direction, {table.layout.size} cells")
    return sampled_error(source, again, ", ".join([*notes, continued] if continued else notes))


def _of_own_grid(source: Table | Material) -> Table | None:
    """A table on a grid that the format has; None for others, and for models."""
    if not isinstance(source, Table) or source.layout.name != "turned" or source.layout.mirrored_axes:
        return source if isinstance(source, Table) and source.layout.name in PARAMETERS else None
    axes = source.layout.axes
    azimuths = [np.round(np.degrees(phi_i + axes["delta_phi"]), 9) % 360 for phi_i in axes["phi_i"]]
    orders = [np.argsort(a) for a in azimuths]
    nodes = np.sort(azimuths[0])
    if not all(np.array_equal(a[o], nodes) for a, o in zip(azimuths, orders, strict=True)):
        return None  # turned by an angle that its nodes do not have
    f, flag = (
        np.stack([np.asarray(values[...])[:, k][:, :, o] for k, o in enumerate(orders)], axis=1)
        for values in (source.f, source.flag)
    )
    layout = layouts.spherical(axes["theta_i"], axes["phi_i"], axes["theta_o"], np.radians(nodes))
    return Table(layout, f, flag, source.channels, provenance=source.provenance, name=source.name)


def _colour(channels: Channels) -> list[str]:
    if channels.wavelengths_nm is not None:
        if any(b <= a for a, b in zip(channels.wavelengths_nm, channels.wavelengths_nm[1:], strict=False)):
            raise GonioError("an SSDD file has wavelengths in ascending order, each once; choose such channels")
        return ["COLOR_MODEL spectrum", "WAVELENGTH_LIST " + " ".join(map(repr, channels.wavelengths_nm))]
    if channels.names == ("X", "Y", "Z"):
        return ["COLOR_MODEL xyz"]
    if len(channels) not in (1, 3):
        raise GonioError(
            f"an SSDD file holds one channel, R, G, B or wavelengths, but there are {len(channels)} channels without "
            "wavelengths; choose one or three"
        )
    return ["COLOR_MODEL monochrome" if len(channels) == 1 else "COLOR_MODEL rgb"]


def _filled(table: Table) -> dict[tuple[int, int], tuple[Table, np.ndarray]]:
    """Of each side the table with numbers in all cells, and its flags: 0 below the horizon, else the nearest cell's."""
    if not table.valid_cells().size:
        raise GonioError("the table holds no valid reading; there is nothing to write")
    result: dict[tuple[int, int], tuple[Table, np.ndarray]] = {}
    for sides, part in table.parts().items():
        f, flag = np.array(part.f[...], np.float64), np.asarray(part.flag[...])
        for channel in range(f.shape[-1]):
            unread = flag[..., channel] != Flag.VALID
            if unread.all():
                f[..., channel] = 0.0
            elif unread.any():
                nearest = np.asarray(distance_transform_edt(unread, return_distances=False, return_indices=True))
                f[..., channel] = f[..., channel][tuple(nearest)]
        f[flag == Flag.BELOW_HORIZON] = 0.0
        if (flag == Flag.VALID).any():
            result[sides] = Table(part.layout, f, flag, part.channels), flag
    return result


def _part(sides: tuple[int, int], filled: tuple[Table, np.ndarray]) -> _Part:
    table, flag = filled
    layout = table.layout
    arrays = [np.asarray(table.f), flag]
    if layout.name == "in_plane":
        layout, arrays = _isotropic(layout, arrays)
    a, reductions = {k: rounded_degrees(v) for k, v in layout.axes.items()}, list[str]()
    zero = np.zeros(1)
    if layout.name == "spherical":
        lists = [a["theta_i"], a["phi_i"], a["theta_o"], a["phi_o"]]
    elif layout.name == "isotropic":
        lists, arrays = [a["theta_i"], zero, a["theta_o"], a["delta_phi"]], [x[:, None] for x in arrays]
    else:
        names = list(a)
        lists = [a[names[0]], a[names[3]] if len(names) > 3 else zero, a[names[1]], a[names[2]]]
        arrays = [np.moveaxis(x, 3, 1) if len(names) > 3 else x[:, None] for x in arrays]
    period = 180.0 if layout.reciprocal_by_construction else 360.0
    if layout.reciprocal_by_construction:
        reductions.append("reciprocity")
    elif layout.mirrored_axes:
        reductions.append("bilateral_symmetry")
    for k in (1, 3):
        whole = (
            lists[k].size > 1 and lists[k][0] == 0 and lists[k][-1] < period and not (k == 3 and layout.mirrored_axes)
        )
        if whole:  # readers of the field interpolate no further than the last azimuth
            lists[k] = np.append(lists[k], period if k == 3 else 360.0)
            arrays = [np.concatenate([x, np.take(x, [0], axis=k)], axis=k) for x in arrays]
    kind = "brdf" if sides == (1, 1) else "btdf"
    return _Part(kind, PARAMETERS[layout.name], reductions, lists, arrays[0], arrays[1])


def _isotropic(layout: Layout, arrays: list[np.ndarray]) -> tuple[Layout, list[np.ndarray]]:
    """An in-plane grid over polar angles and the azimuths 0 and 180°; what it has on one side alone is not measured."""
    signed = layout.axes["theta_o"]
    polar = np.unique(np.abs(signed))
    result = []
    for array, empty in zip(arrays, (0.0, Flag.NOT_MEASURED), strict=True):
        both = np.full((array.shape[0], polar.size, 2, array.shape[-1]), empty, array.dtype)
        for side, there in ((0, signed <= 0), (1, signed >= 0)):
            both[:, np.searchsorted(polar, np.abs(signed[there])), side] = array[:, there]
        result.append(both)
    return layouts.isotropic(layout.axes["theta_i"], polar, [0.0, math.pi]), result


def _block(part: _Part, colour: list[str], table: Table, ascii: bool) -> bytes:
    lines = ["", f"DATA_TYPE {part.kind}", *colour, f"PARAM_TYPE {part.parameters}_coordinate_system"]
    lines += [f"REDUCTION_TYPE {' '.join(part.reductions)}"] if part.reductions else []
    for k, angles in enumerate(part.lists):
        if k != 1 or angles.size > 1 or angles[0] != 0:
            lines.append(f"PARAM{k}_LIST {' '.join(map(repr, angles.tolist()))}")
    lines += [f"NAME {table.name}"] if table.name.strip() else []
    lines.append(f"SOURCE_TYPE {'generated' if 'instrument' in table.provenance else 'measured'}")
    order = (3, 2, 1, 0, 4)
    if part.flags.any():
        flags = np.transpose(part.flags, order).reshape(-1)
        starts = np.flatnonzero(np.diff(flags, prepend=255))
        runs = zip(flags[starts].tolist(), np.diff(starts, append=flags.size).tolist(), strict=True)
        lines += [f"# {MARK} {' '.join(words)}" for words in [[f"{a}*{b}" for a, b in runs]]]
    lines.append(f"DATA {'ascii' if ascii else 'binary'}")
    values = np.transpose(part.values, order).reshape(-1, part.values.shape[-1])
    if ascii:
        body = "\n".join(" ".join(map(repr, row)) for row in values.tolist()).encode()
    else:
        body = np.clip(values, -FLOAT32, FLOAT32).astype("<f4").tobytes()
    return ("\n".join(lines) + "\n").encode() + body + b"\n"


def _on_mirror_grid(source: Table | Material) -> tuple[Table, str]:
    """(a model, or a table without one of the format's grids, on a grid about the mirror direction; what is continued).

    Raises GonioError for a table with readings about less than half of that grid.
    """
    from gonio.data.interpolation.coverage import require_readings_on
    from gonio.data.interpolation.multilinear import as_material
    from gonio.data.interpolation.rgl_layout import sectors_of
    from gonio.data.tabulate import grid_values

    brdf = as_material(source) if isinstance(source, Table) else source.brdf
    require_reflection(source if isinstance(source, Table) else brdf, source.name or "the table", "this SSDD grid")
    isotropic = sectors_of(brdf) is None
    phi_i = None if isotropic else np.radians(PHI_I)
    phi_m = PHI_M if isotropic else np.arange(0.0, 360.0, 30.0)
    theta_m = THETA_M if isotropic else np.concatenate([THETA_M[THETA_M < 20][::2], THETA_M[THETA_M >= 20][::2]])
    grid = layouts.mirror(np.radians(THETA_I), np.radians(theta_m), np.radians(phi_m), phi_i)
    continued = require_readings_on(source, grid) if isinstance(source, Table) else ""
    return whole_table_of_values(grid, grid_values(brdf, grid), source.channels, name=source.name), continued
