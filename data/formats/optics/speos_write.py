"""Writing Speos' ``.brdf`` and ``.anisotropicbsdf`` files, text v8.0, of tables and models."""

import os

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import new_file
from gonio.data.flags import Flag
from gonio.data.formats.optics.grid_source import FINE, GridSource
from gonio.data.formats.optics.hemispherical_totals import grid_totals
from gonio.data.formats.optics.speos import read_speos
from gonio.data.formats.optics.zemax_write import checked_step, degrees, numbers
from gonio.data.layouts import Layout
from gonio.data.material import Material
from gonio.data.round_trip import RoundTrip
from gonio.data.table import Table
from gonio.models.errors import GonioError

STEP = 2.0
WIDEST_AZIMUTH_STEP = 5.0
INCIDENCES = (5.0, 2.5, 1.25)
"""Degrees between the incidences of a model."""
MOST_CELLS = 6_000_000
"""Of a file that is read again."""
GREY_NM = (350.0, 850.0)
"""Wavelengths, nm, between which a channel without one is the same."""
RGB_NM = {"R": 611.4, "G": 549.1, "B": 464.3}
"""Dominant wavelengths, nm, of the primaries of sRGB."""
LEAST_COST = 1e-3
"""Relative rms that is worth a word."""
PARTS = (("reflection", 1), ("transmission", -1))


def write_speos(
    path: str | os.PathLike[str], source: Table | Material, force: bool = False, step: float | None = None
) -> RoundTrip:
    """Writes what light in front of the sample does as a Speos file, by the path's ending; returns what is lost by it.

    A table on a grid of polar angles and azimuths is written node by node; all else is sampled, fine in azimuth about
    the plane of incidence, a model with incidences the nearer the narrower its lobe is. An .anisotropicbsdf file has
    one angular distribution, the channels' mean, times a spectrum of totals; a .brdf file one for each wavelength, of
    isotropic surfaces. R, G and B become wavelengths.

    Args:
        path: ends in .anisotropicbsdf or .brdf.
        source: a table or a material.
        force: replaces an existing file.
        step: degrees, of polar angles in the sampled grid, by default 2.

    Raises:
        GonioError: an anisotropic source for .brdf, channels that are neither grey, R, G, B nor wavelengths, a step out
            of range, a path that cannot be written.
    """
    whole = GridSource.of(source)
    anisotropic = not os.fspath(path).lower().endswith(".brdf")
    wavelengths, named = _wavelengths(whole.channels, anisotropic)
    layout = _layout(whole, checked_step(step, STEP))
    if "phi_i" in layout.axes and not anisotropic:
        raise GonioError(
            "a .brdf file holds isotropic surfaces; write this one to a name that ends in .anisotropicbsdf"
        )
    table, note = whole.on(layout)
    behind = any(light < 0 for light, _ in whole.sides)
    shape = _cost_of_one_shape(table) if anisotropic and len(whole.channels) > 1 else ""
    notes = [note, named, shape, "what light from behind does is left out" if behind else "", whole.media_note]
    with new_file(path, force) as temporary:
        temporary.write_text((_anisotropic if anisotropic else _isotropic)(table, wavelengths), encoding="utf-8")
        written = read_speos(temporary)
    order = np.argsort(wavelengths) if len(whole.channels) > 1 else None
    return whole.compared(written, "; ".join(filter(None, notes)), order)


def _cost_of_one_shape(table: Table) -> str:
    """What the channels' mean, times the file's total of each, is off from them; nothing where it is not."""
    _, _, phi, parts = _blocks(table)
    off = size = 0.0
    largest = max(float(np.nanmax(np.abs(f), initial=0.0)) for _, f in parts.values()) or 1.0
    for theta_o, f in parts.values():
        shape, totals, unit = _one_shape(theta_o, phi, f / largest)
        error = f / largest - shape[..., None] * (totals / (unit or 1.0))
        above = np.abs(theta_o - 90) > 1e-9
        for_each = ((off, error), (size, f / largest))
        off, size = (n + float(np.nansum(a[:, :, above][:, :, :, phi < 360] ** 2)) for n, a in for_each)
    cost = float(np.sqrt(off / max(size, 1e-300)))
    if cost < LEAST_COST:
        return ""
    better = "" if "phi_i" in table.layout.axes else ", and a .brdf file has one for each"
    return f"one angular distribution for all channels, each with its total, is off by rms {cost:.2g}{better}"


def _wavelengths(channels: Channels, anisotropic: bool) -> tuple[np.ndarray, str]:
    """(nm, what is to be said of it); two for one channel without a wavelength in a spectrum of totals."""
    if channels.wavelengths_nm is not None:
        return np.array(channels.wavelengths_nm), ""
    if len(channels) == 1:
        return np.array(GREY_NM if anisotropic else [550.0]), "" if anisotropic else "no wavelength is known: 550 nm"
    if set(channels.names) == set(RGB_NM):
        nm = [RGB_NM[name] for name in channels.names]
        return np.array(nm), "R, G, B stand at " + ", ".join(f"{w:g}" for w in nm) + " nm"
    raise GonioError(
        f"a Speos file holds wavelengths, and the channels are {', '.join(channels.names[:8])}; give them wavelengths, "
        "or choose R, G, B or one"
    )


def _layout(source: GridSource, step: float) -> Layout:
    kept = source.source.layout if isinstance(source.source, Table) else None
    if kept is not None and kept.name in ("isotropic", "turned"):
        front = kept.axes["theta_i"] < np.pi / 2 - 1e-9
        if front.all() and {sides for sides in source.sides if sides[0] > 0}:
            return kept
    front = np.radians(np.minimum(np.arange(0, 90 + step, step), 90.0))
    theta_o = [a for (_, side) in PARTS if (1, side) in source.sides for a in (front if side > 0 else np.pi - front)]
    if not theta_o:
        raise GonioError(f"{source.source.name or 'the source'} is lit from behind alone, which no Speos file holds")
    even = np.arange(WIDEST_AZIMUTH_STEP, 360, WIDEST_AZIMUTH_STEP)
    phi = np.unique(np.concatenate([FINE, even, 360 - FINE[1:]]))
    delta = np.sort(np.radians((phi + 180) % 360))
    # Lobes between two incidences are mixed, so these are as near as lobes are narrow, and as the file has room for.
    width = source.lobe_width() if isinstance(source.source, Material) else 180.0
    wanted = next((s for s in INCIDENCES if s <= width / 2), INCIDENCES[-1])
    size = 0
    for incidence in [s for s in reversed(INCIDENCES) if s >= wanted]:
        theta_i, phi_i = source.light(incidence)
        axes = theta_i, np.unique(theta_o), delta
        layout = layouts.isotropic(*axes) if phi_i is None else layouts.turned(theta_i, phi_i, *axes[1:])
        if (size := layout.size) <= MOST_CELLS:
            return layout
    raise GonioError(
        f"the file would have {size:,} values, and at most {MOST_CELLS:,} are read; give a --step above {step:g}"
    )


def _blocks(table: Table) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """(theta_i, rotation, phi, degrees, and by part theta_o and f (theta_i, rotation, theta_o, phi, channels))."""
    axes, turned = table.layout.axes, "phi_i" in table.layout.axes
    f = np.where(table.flag == Flag.VALID, table.f, np.nan)
    f = f if turned else f[:, None]
    rotation = np.round(-degrees(axes["phi_i"]) % 360, 10) if turned else np.zeros(1)
    delta = axes["delta_phi"]
    if table.layout.mirrored_axes:
        # The whole circle is written, as readers may not take one half for both
        other = (delta > 1e-9) & (delta < np.pi - 1e-9)
        f = np.concatenate([f, f[:, :, :, other]], axis=3)
        delta = np.concatenate([delta, 2 * np.pi - delta[other]])
    phi = degrees((delta + np.pi) % (2 * np.pi))
    columns, rows = np.argsort(phi), np.argsort(rotation)
    phi = phi[columns]
    if phi[0] == 0:  # a whole turn ends where it began
        phi, columns = np.append(phi, 360.0), np.append(columns, columns[0])
    f = f[:, rows][:, :, :, columns]
    parts = {}
    for name, side in PARTS:
        there = np.flatnonzero(np.cos(axes["theta_o"]) * side >= -1e-12)
        if (1, side) in table.sides and there.size:
            parts[name] = degrees(axes["theta_o"][there]), _continued(f[:, :, there], side)
    return degrees(axes["theta_i"]), rotation[rows], phi, parts


def _continued(f: np.ndarray, side: int) -> np.ndarray:
    """The values with those on the horizon, which have none, continued from their neighbours."""
    f = f.copy()
    order = range(f.shape[2]) if side > 0 else range(f.shape[2] - 1, -1, -1)
    before: np.ndarray | None = None
    for k in order:
        row = f[:, :, k]
        row[np.isnan(row)] = 0.0 if before is None else before[np.isnan(row)]
        before = row
    return f


def _total(theta_o: np.ndarray, phi: np.ndarray, f: np.ndarray) -> np.ndarray:
    """(n,): the integrals of f (n, theta_o, phi), as a reader takes them."""
    upright = np.radians(np.minimum(theta_o, 180 - theta_o))
    order = np.argsort(upright)
    once = phi < 360
    return grid_totals(upright[order], np.radians(phi[once]), f[:, order][:, :, once, None], np.zeros(len(f)), False)[
        :, 0
    ]


def _one_shape(theta_o: np.ndarray, phi: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The channels' mean of f (theta_i, rotation, theta_o, phi, channels), and at the first incidence the integral of
    each channel (channels,) and of the mean, by which a reader scales them."""
    shape = f.mean(axis=-1)
    totals = np.stack([_total(theta_o, phi, f[:1, 0, :, :, c])[0] for c in range(f.shape[-1])])
    return shape, totals, float(_total(theta_o, phi, shape[:1, 0])[0])


def _head(table: Table, kind: str, parts: dict, vector: list[str], values: int) -> list[str]:
    description = f"{table.name or 'a table'}, written by gonio"
    flags = "\t".join(str(int(name in parts)) for name, _ in PARTS)
    start = [f"OPTIS - {kind} surface file v8.0", "0", "gonio", str(len(description)), description]
    return [*start, *vector, flags, str(values)]


def _anisotropic(table: Table, wavelengths: np.ndarray) -> str:
    theta_i, rotation, phi, parts = _blocks(table)
    # Of transmission alone the vendor's own converter writes intensities: f cos(theta_o).
    values = 0 if list(parts) == ["transmission"] else 1
    lines = _head(table, "Anisotropic BSDF", parts, ["0\t1\t0"], values)
    for _ in parts:
        lines += [str(rotation.size), numbers(rotation)]
        lines += [str(theta_i.size), numbers(theta_i)] * rotation.size
    blocks = []
    for theta_o, f in parts.values():
        cosine = np.abs(np.cos(np.radians(theta_o)))[:, None] if values == 0 else np.ones((theta_o.size, 1))
        f = np.where((cosine > 1e-12)[..., None], f, np.nan)  # an intensity on the horizon says nothing of f
        shape, totals, unit = _one_shape(theta_o, phi, f)
        shares = np.broadcast_to(totals, wavelengths.size)
        order = np.argsort(wavelengths)
        lines += [
            f"{numbers(theta_i[:1])}\t{numbers(rotation[:1])}",
            "wavelength (nm), total (%)",
            str(wavelengths.size),
        ]
        lines += [numbers(np.array([wavelengths[k], 100 * shares[k]])) for k in order]
        scale = np.pi if unit > 0 else 0.0
        for r in range(rotation.size):
            for i in range(theta_i.size):
                blocks += _table_lines(theta_o, phi, np.nan_to_num(scale * shape[i, r] * cosine))
    return "\n".join([*lines, *blocks, "End of file"]) + "\n"


def _isotropic(table: Table, wavelengths: np.ndarray) -> str:
    theta_i, _, phi, parts = _blocks(table)
    lines = _head(table, "brdf", parts, [], 1)
    order = np.argsort(wavelengths)
    lines += [f"{theta_i.size}\t{wavelengths.size}", numbers(theta_i), numbers(wavelengths[order])]
    for theta_o, f in parts.values():
        totals = np.stack([_total(theta_o, phi, f[:, 0, :, :, c]) for c in range(f.shape[-1])], axis=-1)
        for i in range(theta_i.size):
            for k in order:
                lines.append(repr(float(100 * totals[i, k])))
                lines += _table_lines(theta_o, phi, np.pi * f[i, 0, :, :, k])
    return "\n".join([*lines, "End of file"]) + "\n"


def _table_lines(theta_o: np.ndarray, phi: np.ndarray, values: np.ndarray) -> list[str]:
    rows = [numbers(np.append(t, row)) for t, row in zip(theta_o, values, strict=True)]
    return [f"{theta_o.size}\t{phi.size}", "\t" + numbers(phi), *rows]
