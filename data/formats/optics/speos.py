"""Speos' ``.brdf`` and ``.anisotropicbsdf`` files: f by polar angle and azimuth, scaled to stated totals.

Degrees. The specular direction is azimuth 0 at the polar angle of incidence, whatever the rotation; transmission has
polar angles from 90 to 180. Values are proportional to f, or to f |cosθo| (an "intensity"). The total, in per cent,
sets their scale: f = value / π · total / Σ, where Σ is the integral of value / π · cosθo over the block's angles, of
values that are bilinear between its nodes.
"""

import os
from typing import NamedTuple

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.flags import Flag
from gonio.data.formats.optics.angle_nodes import DIGITS, on_nodes
from gonio.data.formats.optics.grid_words import all_zero_in_words, copied_pole
from gonio.data.formats.optics.hemispherical_totals import grid_totals
from gonio.data.formats.optics.speos_text import MOST_BLOCKS, SpeosBlock, SpeosText, read_speos_text
from gonio.data.formats.optics.text_lines import MOST_VALUES
from gonio.data.layouts import Layout
from gonio.data.table import COPIED, Table
from gonio.models.errors import GonioError, one_line

LIMIT = "less than the number that is read"


class _Part(NamedTuple):
    """The values of one block in our angles."""

    block: SpeosBlock
    theta_o: np.ndarray
    """Degrees, increasing."""
    azimuth: np.ndarray
    """Degrees, that of the file; half a turn or a whole one."""
    f: np.ndarray
    """(theta_o, azimuth), 1/sr up to the scale."""
    integral: float
    """∫ f cosθo dωo before scaling."""


def read_speos(path: str | os.PathLike[str]) -> Table:
    """The table of a Speos file: isotropic, or with the light's azimuth where the sample was turned.

    Blocks with angles of their own are put on one grid, bilinearly between their nodes. Raises GonioError for binary
    files and other kinds, by their names, and for damaged ones with the line.
    """
    text = read_speos_text(path)
    half = all((b.phi >= 0).all() and (b.phi <= 180).all() for b in text.blocks)
    parts = [_in_our_angles(b, text.intensity, half) for b in text.blocks]
    channels, scales, sentences = _scales(text, parts)
    layout, f, filled = _on_grid(path, parts, scales, half)
    flag = np.where(np.isfinite(f), np.uint8(Flag.VALID), np.uint8(Flag.NOT_MEASURED))
    flag[~layout.readable().reshape(layout.shape)] = Flag.BELOW_HORIZON
    f = np.where(flag == Flag.VALID, f, np.nan)
    table = Table(layout, f, flag, channels, name=stem(path))
    table.provenance = {
        "format": "Speos BSDF",
        "source": os.path.basename(path),
        "comments": [one_line(c) for c in (text.comment, text.description) if c],
        "understood": [*_understood(text, layout, filled), *sentences],
        "totals": _totals(text, parts, scales),
    }
    if copied_pole(layout, f):
        table.provenance[COPIED] = True
    if dark := all_zero_in_words(layout, f):
        table.provenance["warnings"] = [dark]
    return table


def _in_our_angles(block: SpeosBlock, intensity: bool, half: bool) -> _Part:
    theta = block.theta
    if block.part == "transmission" and theta.min() < 90 - 1e-6:
        theta = 180 - theta
    nodes = on_nodes(theta, block.phi, block.values)
    cosine = np.abs(np.cos(np.radians(nodes.polar)))[:, None]
    f = nodes.values / np.pi
    if intensity:
        f = np.divide(f, cosine, out=np.full_like(f, np.nan), where=cosine > 1e-12)
    upright = np.radians(np.minimum(nodes.polar, 180 - nodes.polar))
    order = np.argsort(upright)
    whole = f[None, order, :, None]
    total = grid_totals(upright[order], np.radians(nodes.azimuth), whole, np.zeros(1), half)[0, 0]
    return _Part(block, nodes.polar, nodes.azimuth, f, float(total))


def _scales(text: SpeosText, parts: list[_Part]) -> tuple[Channels, np.ndarray, list[str]]:
    """(channels, factor of each block in each of them, what was understood of the scale)."""
    if not text.anisotropic:
        scales = np.full((len(parts), text.wavelengths.size), np.nan)
        for row, part in zip(scales, parts, strict=True):
            row[part.block.wavelength] = (part.block.share or 0.0) / part.integral if part.integral > 0 else 1.0
        return Channels.of_wavelengths(text.wavelengths), scales, [_scale_in_words(scales)]
    wavelengths = np.unique(np.concatenate([s.wavelengths for s in text.spectra.values()]))
    shares = {name: _on_wavelengths(s.wavelengths, s.share, wavelengths) for name, s in text.spectra.items()}
    sentences: list[str] = []
    if all(np.ptp(share) == 0 for share in shares.values()):
        sentences.append(
            f"the totals are the same at all {wavelengths.size} wavelengths, {wavelengths[0]:g} to {wavelengths[-1]:g} "
            "nm: one channel"
        )
        channels, shares = Channels.grey(), {name: share[:1] for name, share in shares.items()}
    else:
        channels = Channels.of_wavelengths(wavelengths)
        sentences.append("one angular distribution for all wavelengths, times their totals")
    factors = {name: share * _inverse_integral(parts, name, text) for name, share in shares.items()}
    scales = np.stack([factors[part.block.part] for part in parts])
    return channels, scales, [_scale_in_words(scales), *sentences]


def _on_wavelengths(known: np.ndarray, share: np.ndarray, wavelengths: np.ndarray) -> np.ndarray:
    order = np.argsort(known)
    return np.interp(wavelengths, known[order], share[order])


def _inverse_integral(parts: list[_Part], name: str, text: SpeosText) -> float:
    """1 / Σ at the spectrum's incidence: between two of the blocks' it is interpolated, beyond them held."""
    spectrum = text.spectra[name]
    those = [part for part in parts if part.block.part == name]
    rotation = min({p.block.rotation for p in those}, key=lambda r: abs((r - spectrum.rotation + 180) % 360 - 180))
    rows = sorted((p.block.theta_i, p.integral) for p in those if p.block.rotation == rotation and p.integral > 0)
    if not rows:
        return 1.0
    theta, integral = np.transpose(rows)
    return float(np.interp(spectrum.theta_i, theta, 1 / integral))


def _scale_in_words(scales: np.ndarray) -> str:
    known = scales[np.isfinite(scales)]
    spread = f"{known.min():.6g}" if np.ptp(known) == 0 else f"{known.min():.6g} to {known.max():.6g}"
    return f"the stated totals scale the values: by {spread} beyond f = value/π"


def _on_grid(
    path: str | os.PathLike[str], parts: list[_Part], scales: np.ndarray, half: bool
) -> tuple[Layout, np.ndarray, int]:
    """(layout, f (*shape, channels), values that were interpolated as their block has other angles)."""
    theta_i, rotations = (
        np.unique(np.round(a, DIGITS)) for a in zip(*((p.block.theta_i, _turn(p)) for p in parts), strict=True)
    )
    theta_o, azimuth = (
        np.unique(np.round(np.concatenate(a), DIGITS))
        for a in zip(*((p.theta_o, p.azimuth) for p in parts), strict=True)
    )
    delta = (180 - azimuth if half else azimuth + 180) % 360
    order = np.argsort(delta)
    size = theta_i.size * rotations.size * theta_o.size * azimuth.size * scales.shape[1]
    if size > 4 * MOST_VALUES or theta_i.size * rotations.size > MOST_BLOCKS:
        raise GonioError(f"{path}: its blocks have angles of their own, which make a grid of {size:,} values; {LIMIT}")
    f = np.full((theta_i.size, rotations.size, theta_o.size, azimuth.size, scales.shape[1]), np.nan)
    filled = 0
    for part, scale in zip(parts, scales, strict=True):
        i, r = np.searchsorted(theta_i, round(part.block.theta_i, DIGITS)), np.searchsorted(rotations, _turn(part))
        rows, columns, values, other = _placed(part, theta_o, azimuth, half)
        known = np.isfinite(scale)
        f[i, r][np.ix_(rows, columns, known)] = values[..., None] * scale[known]
        filled += other
    f = f[:, :, :, order]
    angles = [np.radians(a) for a in (theta_i, rotations, theta_o, delta[order])]
    if rotations.size > 1:
        return layouts.turned(*angles), f, filled
    return layouts.isotropic(angles[0], *angles[2:]), f[:, 0], filled


def _turn(part: _Part) -> float:
    """The light's azimuth, degrees."""
    turn = round(-part.block.rotation % 360, DIGITS)
    return 0.0 if turn >= 360 else turn


def _placed(
    part: _Part, theta_o: np.ndarray, azimuth: np.ndarray, half: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """(rows, columns of the grid, values there, how many are between the block's own nodes)."""
    rows = np.flatnonzero((theta_o >= part.theta_o[0]) & (theta_o <= part.theta_o[-1]))
    own_rows, own_columns = np.isin(theta_o[rows], part.theta_o), np.isin(azimuth, part.azimuth)
    columns = np.arange(azimuth.size)
    if own_rows.all() and own_columns.all():
        return rows, columns, part.f, 0
    if half:
        along = np.stack([np.interp(azimuth, part.azimuth, row) for row in part.f])
    else:
        along = np.stack([np.interp(azimuth, part.azimuth, row, period=360) for row in part.f])
    values = np.stack([np.interp(theta_o[rows], part.theta_o, column) for column in along.T], axis=1)
    return rows, columns, values, int(values.size - np.outer(own_rows, own_columns).sum())


def _understood(text: SpeosText, layout: Layout, filled: int) -> list[str]:
    sentences = [
        f"{' and '.join(text.parts)}; values are proportional to "
        + ("f cos(theta_o), an intensity, which was divided by the cosine" if text.intensity else "f"),
        "azimuth 0 is the specular side, and where light goes straight through",
    ]
    if "phi_i" in layout.axes:
        sentences.append(
            "+x is where the light comes from at rotation 0, against the anisotropy vector; phi_i = −rotation"
        )
    else:
        sentences.append("one rotation of the sample: the surface is taken as isotropic")
    if layout.mirrored_axes:
        sentences.append("azimuths are of one side only: the other is taken as its mirror image")
    if filled:
        sentences.append(f"blocks have angles of their own: {filled} values of the common grid lie between their nodes")
    return sentences


def _totals(text: SpeosText, parts: list[_Part], scales: np.ndarray) -> list[str]:
    """The file's totals beside the integrals of the values as scaled."""
    sentences = []
    for name, s in text.spectra.items():
        those = [
            (p.block.theta_i, p.integral * c[0]) for p, c in zip(parts, scales, strict=True) if p.block.part == name
        ]
        low, high = min(t for _, t in those), max(t for _, t in those)
        sentences.append(
            f"total {name} at θi {s.theta_i:g}°: {100 * s.share[0]:.6g} % at {s.wavelengths[0]:g} nm; the integrals of "
            f"all incidences are {100 * low:.6g} to {100 * high:.6g} %"
        )
    for name in text.parts if not text.spectra else ():
        shares = [100 * (p.block.share or 0.0) for p in parts if p.block.part == name]
        before = [100 * p.integral for p in parts if p.block.part == name]
        sentences.append(
            f"total {name}: {min(shares):.6g} to {max(shares):.6g} %; the integrals of the values before scaling are "
            f"{min(before):.6g} to {max(before):.6g} %"
        )
    return sentences
