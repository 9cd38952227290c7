"""SSDD files of libbsdf: BRDF and BTDF over spherical, specular, half-difference or distorted coordinates.

Azimuths are those of vectors: the mirror side is where they differ by 180°. Specular reflectance and transmittance,
deltas beside f, are told and left out.
"""

import math
import os
import re

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.flags import Flag
from gonio.data.formats.laboratory.ssdd_text import Block, read_blocks
from gonio.data.layouts import Layout, spherical_angles
from gonio.data.plausibility.suspicions import suspicions
from gonio.data.table import Table
from gonio.models.errors import GonioError

SIGNATURE = re.compile(rb"(?:\xef\xbb\xbf)?(?:[ \t\r\n]|#[^\n]*\n)*VERSION[ \t]+\d+\.\d+\s")
"""How such a file is known."""
SAME = 1e-6
"""Degrees between angles that are one."""
MOST_LISTED = 1 << 22
"""Cells of coordinates that are no grid of gonio's, at most."""


def is_ssdd(start: bytes) -> bool:
    """Whether a file begins as an SSDD file does."""
    return SIGNATURE.match(start) is not None and b"DATA_TYPE" in start


def read_ssdd(path: str | os.PathLike[str]) -> Table:
    """The table of an SSDD file, on the file's own grid where gonio has such a one, else scattered.

    Raises GonioError, in one sentence, for a damaged file.
    """
    blocks, header = read_blocks(path)
    scattering = [b for b in blocks if not b.kind.startswith("specular")]
    understood = [f"{b.kind} over {b.parameters.replace('_', ' ')}" for b in scattering]
    understood += [
        f"left out: {b.kind}, a delta beside f, {b.values.min():.4g} to {b.values.max():.4g}"
        for b in blocks
        if b.kind.startswith("specular")
    ]
    try:
        if len(scattering) == 2 and _on_one_grid(*scattering):
            scattering = [_joined(*scattering)]
        tables = [_table(b, understood) for b in scattering]
    except GonioError as error:
        raise GonioError(f"{path}: {error}") from None
    table = tables[0] if len(tables) == 1 else _listed(tables)
    stated = header | {k: v for b in blocks for k, v in b.stated.items()}
    table.name = stated.pop("NAME", "") or stem(path)
    header = dict(list(stated.items())[:100])
    source = os.path.basename(path)
    table.provenance |= {"format": "SSDD", "source": source, "header": header, "understood": understood}
    if warnings := suspicions(table):
        table.provenance["warnings"] = warnings
    return table


def _on_one_grid(a: Block, b: Block) -> bool:
    """Whether two blocks are one grid over both hemispheres."""
    same = (a.parameters, a.reductions, a.channels) == (b.parameters, b.reductions, b.channels)
    same &= a.parameters.startswith("spherical")
    return same and all(np.array_equal(x, y) for k, (x, y) in enumerate(zip(a.lists, b.lists, strict=True)) if k != 2)


def _joined(a: Block, b: Block) -> Block:
    """BRDF and BTDF over polar angles from 0 to 180°."""
    front, behind = (a, b) if a.kind == "brdf" else (b, a)
    polar = 180.0 - behind.lists[2][::-1]
    kept = slice(int(front.lists[2][-1] >= polar[0] - SAME), None)
    lists = list(front.lists)
    lists[2] = np.concatenate([lists[2], polar[kept]])
    values = np.concatenate([front.values, behind.values[:, :, ::-1][:, :, kept]], axis=2)
    flags = [np.zeros(x.values.shape, np.uint8) if x.flags is None else x.flags for x in (front, behind)]
    flags = np.concatenate([flags[0], flags[1][:, :, ::-1][:, :, kept]], axis=2)
    return front._replace(lists=tuple(lists), values=values, flags=flags)


def _table(block: Block, understood: list[str]) -> Table:
    """The table of one block."""
    flags = np.zeros(block.values.shape, np.uint8) if block.flags is None else block.flags
    layout, values, flags = _placed(block, block.values, flags, understood)
    shape = (*layout.shape, values.shape[-1])
    f, flag = np.ascontiguousarray(values).reshape(shape), np.ascontiguousarray(flags).reshape(shape)
    flag[(flag == Flag.VALID) & ~np.isfinite(f)] = Flag.INVALID
    flag[~layout.readable().reshape(layout.shape)] = Flag.BELOW_HORIZON
    return Table(layout, np.where(flag == Flag.VALID, f, np.asarray(np.nan, f.dtype)), flag, block.channels)


def _placed(
    block: Block, values: np.ndarray, flags: np.ndarray, understood: list[str]
) -> tuple[Layout, np.ndarray, np.ndarray]:
    """(layout, values, flags) in the order of the layout's axes."""
    p0, p1, p2, p3 = block.lists[:4]
    high = (180.0 if p2[-1] > 90 + SAME else 90.0) if block.parameters.startswith(("spher", "half")) else 180.0
    for angles, limit in ((p0, 90.0), (p1, 360.0), (p2, high), (p3, 360.0)):
        if angles[0] < -SAME or angles[-1] > limit + SAME:
            raise GonioError(f"a list has angles from {angles[0]:g} to {angles[-1]:g}°, expected 0 to {limit:g}°")
    reciprocal = "reciprocity" in block.reductions and block.parameters.startswith("half")
    p1, p3, (values, flags) = _closed(p1, p3, [values, flags], 180.0 if reciprocal else 360.0, understood)
    if block.parameters.startswith("half"):
        p3, (values, flags) = _unfolded(p3, [values, flags], block.reductions)
    offset = block.lists[4].size and block.lists[4].any()
    if block.parameters.startswith("distorted") or (block.parameters.startswith("specular") and offset):
        return _scattered(block, p1, p3), values.reshape(-1, values.shape[-1]), flags.reshape(-1, values.shape[-1])
    turn = p1.size > 1 or p1[0] != 0
    angles = [np.clip(np.radians(a), 0, 2 * math.pi) for a in (p0, p1, p2, p3)]
    if block.parameters.startswith("spherical"):
        if block.kind == "btdf":
            angles[2], values, flags = math.pi - angles[2][::-1], values[:, :, ::-1], flags[:, :, ::-1]
        return _spherical(angles, values, flags, turn)
    make = {"half": layouts.half_difference}.get(
        block.parameters[:4], layouts.straight if block.kind == "btdf" else layouts.mirror
    )
    if block.kind == "btdf" and block.parameters.startswith("half"):
        raise GonioError("its btdf is over half and difference angles, which have no directions behind the sample here")
    order = (0, 2, 3, 1, 4) if turn else (0, 2, 3, 4)
    values, flags = (a if turn else a[:, 0] for a in (values, flags))
    axes = [angles[0], angles[2], angles[3], angles[1] if turn else None]
    values, flags = (np.transpose(a, order) if turn else a for a in (values, flags))
    return make(axes[0], axes[1], axes[2], axes[3]), values, flags


def _spherical(
    angles: list[np.ndarray], values: np.ndarray, flags: np.ndarray, turn: bool
) -> tuple[Layout, np.ndarray, np.ndarray]:
    """By both polar angles and azimuths: in the plane of incidence alone, isotropic or whole."""
    theta_i, phi_i, theta_o, phi_o = angles
    if turn:
        return layouts.spherical(theta_i, phi_i, theta_o, phi_o), values, flags
    values, flags = values[:, 0], flags[:, 0]
    if phi_o.size == 1 or not np.isclose(np.sin(phi_o), 0, atol=1e-9).all():
        return layouts.isotropic(theta_i, theta_o, phi_o), values, flags
    back, mirror = (np.flatnonzero(s * np.cos(phi_o) > 0)[:1] for s in (1, -1))
    first = int(theta_o[0] == 0 and mirror.size > 0)
    signed = np.concatenate([-theta_o[first:][::-1] if back.size else [], theta_o if mirror.size else []])
    values, flags = (
        np.concatenate([a[:, first:][:, ::-1][:, :, k] for k in back] + [a[:, :, k] for k in mirror], axis=1)
        for a in (values, flags)
    )
    return layouts.in_plane(theta_i, signed), values, flags


def _closed(
    p1: np.ndarray, p3: np.ndarray, arrays: list[np.ndarray], period: float, understood: list[str]
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """The azimuths without one that is the first again, a turn on."""
    for axis, turn in ((1, 360.0), (3, period)):
        angles = p1 if axis == 1 else p3
        if angles.size < 2 or abs(angles[-1] - angles[0] - turn) > SAME:
            continue
        ends = [np.take(arrays[0], k, axis=axis) for k in (0, -1)]
        if not np.allclose(*ends, rtol=1e-6, atol=0):
            understood.append(
                f"values at the azimuth {angles[-1]:g}° differ from those at {angles[0]:g}°, which are taken"
            )
        arrays = [np.delete(a, -1, axis=axis) for a in arrays]
        p1, p3 = (angles[:-1], p3) if axis == 1 else (p1, angles[:-1])
    return p1, p3, arrays


def _unfolded(
    p3: np.ndarray, arrays: list[np.ndarray], reductions: tuple[str, ...]
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Difference azimuths of a half that stands for the other, by bilateral symmetry, of a turn or of half a one."""
    if "bilateral_symmetry" not in reductions:
        return p3, arrays
    turn = 180.0 if "reciprocity" in reductions else 360.0
    other = [k for k in range(p3.size - 1, -1, -1) if SAME < p3[k] < turn / 2 - SAME]
    return np.concatenate([p3, turn - p3[other]]), [np.concatenate([a, a[:, :, :, other]], axis=3) for a in arrays]


def _scattered(block: Block, p1: np.ndarray, p3: np.ndarray) -> Layout:
    """The directions of coordinates about an offset direction, or distorted ones."""
    p0, _, p2, _, offsets = block.lists
    if p0.size * p1.size * p2.size * p3.size > MOST_LISTED:
        raise GonioError(f"its coordinates are no grid of gonio's, and have more than {MOST_LISTED:,} directions")
    shift = np.radians(offsets if offsets.size else np.zeros(p0.size))
    theta_i, phi_i, polar, azimuth = (a.ravel() for a in np.meshgrid(*map(np.radians, (p0, p1, p2, p3)), indexing="ij"))
    centre = theta_i + np.repeat(shift, p1.size * p2.size * p3.size)
    if block.parameters.startswith("specular"):
        c, s = np.cos(centre), np.sin(centre)
        x, y, z = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)
        theta_o, phi_o = spherical_angles(c * x - s * z, y, c * z + s * x)
        phi_o = phi_o + phi_i
    else:
        r, d = 2 * polar / math.pi, 2 * np.abs(centre) / math.pi
        turn = phi_i + np.where(centre < 0, 0.0, math.pi)
        u, v = (r * f(azimuth) + (1 - r) * d * f(turn) for f in (np.cos, np.sin))
        theta_o, phi_o = np.minimum(np.hypot(u, v) * math.pi / 2, math.pi), np.arctan2(v, u)
    if block.kind == "btdf":
        theta_o = math.pi - theta_o
    make = layouts.scattered if block.kind == "btdf" else layouts.front_samples
    return make(theta_i, phi_i % (2 * math.pi), theta_o, phi_o % (2 * math.pi))


def _listed(tables: list[Table]) -> Table:
    """One list of the readings of several tables, with the channels of all."""
    lists = [table.as_list() for table in tables]
    axes = [np.concatenate(a) for a in zip(*(t.layout.axes.values() for t in lists), strict=True)]
    keys = [list(zip(t.channels.names, t.channels.wavelengths_nm or t.channels.names, strict=True)) for t in lists]
    every = list(dict.fromkeys(key for names in keys for key in names))
    spectral = all(t.channels.wavelengths_nm is not None for t in lists)
    channels = Channels(tuple(n for n, _ in every), tuple(float(w) for _, w in every) if spectral else None)
    shape = axes[0].size, len(every)
    f, flag, row = np.full(shape, np.nan), np.full(shape, np.uint8(Flag.NOT_MEASURED)), 0
    for table, names in zip(lists, keys, strict=True):
        cells = np.ix_(np.arange(row, row + table.layout.size), np.array([every.index(key) for key in names]))
        f[cells], flag[cells] = table.f, table.flag
        row += table.layout.size
    return Table(layouts.scattered(axes[0], axes[1], axes[2], axes[3]), f, flag, channels)
