"""Writing XML files of WINDOW and Radiance of tables and models: matrices over a Klems basis, up to four blocks."""

import dataclasses
import os
from typing import NamedTuple
from xml.sax.saxutils import escape

import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import new_file
from gonio.data.formats.optics.grid_source import GridSource
from gonio.data.formats.optics.window_xml import read_window_xml
from gonio.data.interpolation.angle_basis import KLEMS_BASES, AngleBasis
from gonio.data.interpolation.scattering_blocks import BLOCKS, Matrix, pair_of
from gonio.data.interpolation.sheets import sheet_of
from gonio.data.material import Material
from gonio.data.round_trip import RoundTrip
from gonio.data.table import Table
from gonio.models.errors import GonioError, nearest
from gonio.models.evaluation import sampled_directions, sampling_density
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.low_discrepancy import low_discrepancy

BASES = {basis.name.rpartition(" ")[2].lower(): basis for basis in KLEMS_BASES}
SIDES: dict[str, tuple[int, int]] = dict(zip(BLOCKS, ((1, 1), (1, -1), (-1, 1), (-1, -1)), strict=True))
"""Of light and detector, by the block."""
EVEN, SAMPLED = 256, 8192
"""Pairs of directions, even in both, of each pair of patches; by the model's sampler, of each patch of the light."""
CHUNK = 1 << 17
"""Pairs of directions whose values are computed at once, of up to eight channels; of more, fewer."""
LARGEST = 1.01
"""R + T from which on Radiance refuses a file."""
LUMINANCE = {"R": 0.2126, "G": 0.7152, "B": 0.0722}
UNSTATED = ("None", "None")
INTEGRALS = {"Visible": ("CIE Illuminant D65 1nm.ssp", "ASTM E308 1931 Y.dsp"), "Solar": UNSTATED, "NIR": UNSTATED}
"""Bands that files name, with the spectra of light and detector."""
Blocks = dict[str, np.ndarray]
"""f, 1/sr, (leaving, arriving, channels), by the names of `BLOCKS`."""


def write_window_xml(
    path: str | os.PathLike[str],
    source: Table | Material,
    force: bool = False,
    basis: str = "full",
    channel: str | None = None,
) -> RoundTrip:
    """Writes a Klems file: the mean of f over each pair of patches; returns what reading it again shows to be lost.

    +z is the file's front. Blocks of what is not known are left out. The bands "Visible", "Solar" and "NIR" and several
    wavelengths are written one by one, any other single channel as "Visible", of R, G, B their luminance, of X, Y, Z
    the Y.

    Args:
        path: the file.
        source: a table or a material.
        force: replaces an existing file.
        basis: "full" (145 patches), "half" or "quarter".
        channel: writes this channel alone.

    Raises:
        GonioError: a basis or channel that is unknown, a table with readings about less than half of the directions,
            R + T above 1.01, a path that cannot be written.
    """
    if basis not in BASES:
        raise GonioError(f"basis {basis[:40]!r} is unknown; {nearest(basis[:40], BASES)}")
    known = BASES[basis]
    whole, note = _visible(GridSource.of(source, channel))
    blocks, continued = _kept(whole, known), ""
    if not blocks:
        continued = _coverage(whole, known)
        blocks = _estimated(whole, known)
    if not blocks:
        raise GonioError(f"{source.name or 'the source'} scatters nothing that a Klems file holds")
    largest = _largest_share(blocks, known)
    if largest > LARGEST:
        raise GonioError(
            f"{source.name or 'the source'} sends back and through {largest:.4g} times the light of a patch of "
            "directions, and no Klems file may exceed 1; see gonio check, and write what conserves energy"
        )
    lacking = [name for name in BLOCKS if name not in blocks]
    left_out = f"not known, left out: {', '.join(lacking)}" if lacking else ""
    with new_file(path, force) as temporary:
        temporary.write_text(_document(source.name, known, whole.channels, blocks), encoding="utf-8")
        written = read_window_xml(temporary)
    return whole.compared(
        written, "; ".join(filter(None, [f"R + T up to {largest:.4g}", left_out, continued, note, whole.media_note]))
    )


def _visible(source: GridSource) -> tuple[GridSource, str]:
    """The source in the channels of a file, and what is to be said of them."""
    names, wavelengths = source.channels.names, source.channels.wavelengths_nm
    if (wavelengths is not None and len(names) > 1) or set(names) <= set(INTEGRALS):
        only = "" if names[:1] == ("Visible",) else "Radiance reads 'Visible' alone: for it, write one --channel"
        return source, only
    weights = np.ones(1)
    note = "the Y of X, Y, Z as 'Visible'"
    if len(names) == 1:
        note = "" if wavelengths is None else f"{names[0]} as 'Visible'"
    if set(names) == set(LUMINANCE):
        weights, note = np.array([LUMINANCE[name] for name in names]), "R, G, B as 'Visible', by their luminance"
    elif set(names) == set("XYZ"):
        weights = np.array([float(name == "Y") for name in names])
    elif len(names) > 1:
        bands = f"{', '.join(INTEGRALS)} or wavelengths"
        raise GonioError(f"a Klems file holds {bands}, not {', '.join(names[:8])}; name one --channel")
    mix = source.mix @ weights[:, None]
    return dataclasses.replace(source, channels=Channels(("Visible",)), mix=mix), note


def _kept(source: GridSource, basis: AngleBasis) -> Blocks:
    """The blocks of a file that has the same basis; nothing of other sources."""
    sheet = sheet_of(source.source) if isinstance(source.source, Table) else None
    if sheet is None:
        return {}
    kept: Blocks = {}
    for name, blocks in sheet.blocks.items():
        matrices = [b for b in blocks if isinstance(b, Matrix) and b.arriving == basis and b.leaving == basis]
        if len(matrices) == len(blocks):
            kept[name] = np.stack([np.asarray(m.values, float) for m in matrices], axis=-1) @ source.mix
        elif any(b is not None for b in blocks):
            return {}
    return kept


def _coverage(source: GridSource, basis: AngleBasis) -> str:
    """What is to be said of how many pairs of patches a table has readings about, over all blocks that it has."""
    arriving, leaving = (k.ravel() for k in np.meshgrid(*2 * (np.arange(basis.size),)))
    u = low_discrepancy(arriving.size, 4)
    pairs = [
        _pair(name, basis.within(arriving, u[:, 0], u[:, 1]), basis.within(leaving, u[:, 2], u[:, 3]))
        for name in BLOCKS
        if SIDES[name] in source.sides
    ]
    wi, wo = (Direction(*(np.concatenate(c) for c in zip(*w, strict=True))) for w in zip(*pairs, strict=True))
    return source.coverage(wi, wo)


def _estimated(source: GridSource, basis: AngleBasis) -> Blocks:
    """The blocks of any other source; of one that is reciprocal the mean of both ways, which has less noise."""
    blocks = {name: _estimate(source, basis, name) for name in BLOCKS if SIDES[name] in source.sides}
    theta, phi = basis.centres()
    turned = basis.patch(theta, (phi + np.pi) % (2 * np.pi))
    back: dict[str, str] = dict(zip(BLOCKS, (BLOCKS[0], BLOCKS[2], BLOCKS[1], BLOCKS[3]), strict=True))
    if not all(_reciprocal(source, basis, name) for name in blocks):
        return blocks
    return {n: (v + np.swapaxes(blocks[back[n]], 0, 1)[turned][:, turned]) / 2 for n, v in blocks.items()}


def _reciprocal(source: GridSource, basis: AngleBasis, name: str) -> bool:
    u = low_discrepancy(EVEN, 6)
    patches = (u[:, 4:].T * basis.size).astype(int)
    wi, wo = _pair(name, *(basis.within(k, *u[:, c : c + 2].T) for k, c in zip(patches, (0, 2), strict=True)))
    return bool(np.allclose(source.f(wi, wo), source.f(wo, wi), rtol=1e-6, atol=0))


def _estimate(source: GridSource, basis: AngleBasis, name: str) -> np.ndarray:
    """The means of f cosθo over pairs of patches, over that of cosθo: (leaving, arriving, channels).

    Pairs even in the patches' projected solid angles and pairs by the model's sampler are weighted by the balance
    heuristic [Veach 1997, eq. 9.8], so that neither wide nor narrow lobes are missed. What f has everywhere in a pair
    of patches, its least value there, is not estimated.
    """
    n, size = basis.size, basis.projected_solid_angles()
    sums = _PatchSums.of(n * n, len(source.channels))
    sampled = _sampled(source, basis, name)
    arriving, leaving = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(n)))
    # Each with its directions exchanged, so that what is reciprocal stays so
    u = np.concatenate([u := low_discrepancy(EVEN // 2, 4), u[:, [2, 3, 0, 1]]])
    step = max(1, CHUNK // EVEN // -(-len(source.channels) // 8))
    pairs = []
    for start in range(0, n * n, step):
        a, b = (np.repeat(k[start : start + step], EVEN) for k in (arriving, leaving))
        v = _turned(u, len(a) // EVEN, start)
        pairs.append((b, a, *_pair(name, basis.within(a, v[:, 0], v[:, 1]), basis.within(b, v[:, 2], v[:, 3]))))
    for b, a, wi, wo in pairs if sampled is None else [*pairs, _in_order(sampled, n)]:
        density = EVEN * np.abs(wo.z) / size[b]
        if sampled is not None:
            density = density + SAMPLED * np.asarray(sampling_density(source.brdf, wi, wo), float)
        sums.add(b * n + a, source.f(wi, wo), np.abs(wo.z) / density)
    return sums.means(np.repeat(size, n)).reshape(n, n, -1)


_Pairs = tuple[np.ndarray, np.ndarray, Direction, Direction]
"""(patch of the leaving and of the arriving direction, wi, wo)."""


def _in_order(pairs: _Pairs, patches: int) -> _Pairs:
    """By the patches of the leaving, then of the arriving direction."""
    b, a, wi, wo = pairs
    order = np.argsort(b * patches + a, kind="stable")
    wi, wo = (Direction(*(c[order] for c in w)) for w in (wi, wo))
    return b[order], a[order], wi, wo


class _PatchSums(NamedTuple):
    """Sums over the pairs of directions in each pair of patches."""

    weighted: np.ndarray
    weights: np.ndarray
    least: np.ndarray

    @classmethod
    def of(cls, patches: int, channels: int) -> "_PatchSums":
        return cls(np.zeros((patches, channels)), np.zeros((patches, 1)), np.full((patches, channels), np.inf))

    def add(self, patch: np.ndarray, f: np.ndarray, weight: np.ndarray) -> None:
        """Adds values (n, channels) of pairs in these patches (n,), which stand in order."""
        starts = np.flatnonzero(np.diff(patch, prepend=-1))
        here = patch[starts]  # each once
        self.weighted[here] += np.add.reduceat(f * weight[:, None], starts)
        self.weights[here] += np.add.reduceat(weight[:, None], starts)
        self.least[here] = np.minimum(self.least[here], np.minimum.reduceat(f, starts))

    def means(self, size: np.ndarray) -> np.ndarray:
        """By the projected solid angles of the leaving patches."""
        return self.least + (self.weighted - self.least * self.weights) / size[:, None]


def _turned(u: np.ndarray, patches: int, seed: int) -> np.ndarray:
    """(patches · n, 4): points (n, 4), turned by a number of each patch's own, so that no error is that of all."""
    turn = np.random.default_rng(seed).random((patches, 1, 4))
    return ((u + turn) % 1.0).reshape(-1, 4)


def _sampled(source: GridSource, basis: AngleBasis, name: str) -> _Pairs | None:
    """Pairs by the model's sampler; None where it draws none."""
    a = np.repeat(np.arange(basis.size), SAMPLED)
    u = _turned(low_discrepancy(SAMPLED, 4), basis.size, 0)
    wi, _ = _pair(name, basis.within(a, u[:, 0], u[:, 1]), np.zeros((len(a), 2)))
    try:
        wo = Direction(*(np.asarray(c, float) for c in sampled_directions(source.brdf, wi, u[:, 2], u[:, 3])))
    except NotImplementedError:
        return None
    here = np.flatnonzero(np.isfinite(wo.z) & (wo.z * SIDES[name][1] > 1e-9))
    if not here.size:
        return None  # it draws what is on the other side
    wi, wo = (Direction(*(np.asarray(c)[here] for c in w)) for w in (wi, wo))
    theta = np.arctan2(np.hypot(wo.x, wo.y), np.abs(wo.z))
    return basis.patch(theta, np.arctan2(wo.y, wo.x) % (2 * np.pi)), a[here], wi, wo


def _pair(name: str, arriving: np.ndarray, leaving: np.ndarray) -> tuple[Direction, Direction]:
    (theta_i, phi_i), (theta_o, phi_o) = pair_of(name, arriving, leaving)
    return from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)


def _largest_share(blocks: Blocks, basis: AngleBasis) -> float:
    """The largest R + T of the patches of the light, on either side."""
    largest = 0.0
    for front in (True, False):
        lit = [values for name, values in blocks.items() if name.endswith("front") == front]
        if lit:
            largest = max(largest, float(np.max(np.einsum("l,lac->ac", basis.projected_solid_angles(), sum(lit)))))
    return largest


def _document(name: str, basis: AngleBasis, channels: Channels, blocks: Blocks) -> str:
    rings = zip(basis.edges[:-1], basis.edges[1:], basis.counts, strict=True)
    middle = [
        f"<AngleBasisBlock><Theta>{0 if low == 0 and count == 1 else (low + high) / 2:g}</Theta><nPhis>{count}</nPhis>"
        f"<ThetaBounds><LowerTheta>{low:g}</LowerTheta><UpperTheta>{high:g}</UpperTheta></ThetaBounds></AngleBasisBlock>"
        for low, high, count in rings
    ]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<WindowElement xmlns="http://windows.lbl.gov" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xsi:schemaLocation="http://windows.lbl.gov/BSDF-v1.4.xsd">',
        "<WindowElementType>System</WindowElementType>",
        "<FileType>BSDF</FileType>",
        "<Optical>",
        "<Layer>",
        f"<Material><Name>{escape(name)}</Name><Manufacturer>gonio</Manufacturer><DeviceType>Other</DeviceType></Material>",
        "<DataDefinition>",
        "<IncidentDataStructure>Columns</IncidentDataStructure>",
        f"<AngleBasis><AngleBasisName>{basis.name}</AngleBasisName>",
        *middle,
        "</AngleBasis>",
        "</DataDefinition>",
    ]
    for c, label in enumerate(channels.names):
        wavelength = f'<Wavelength unit="Integral">{escape(label)}</Wavelength>'
        if channels.wavelengths_nm is not None:
            wavelength = f'<Wavelength unit="Nanometer">{channels.wavelengths_nm[c]!r}</Wavelength>'
        for block, values in blocks.items():
            lines += [f"<WavelengthData><!-- {escape(label.replace('--', '-'))} -->", wavelength]
            lines += _block_lines(block, basis, values[..., c], INTEGRALS.get(label, INTEGRALS["Visible"]))
    return "\n".join([*lines, "</Layer>", "</Optical>", "</WindowElement>"]) + "\n"


def _block_lines(name: str, basis: AngleBasis, values: np.ndarray, spectra: tuple[str, str]) -> list[str]:
    return [
        f"<SourceSpectrum>{spectra[0]}</SourceSpectrum>",
        f"<DetectorSpectrum>{spectra[1]}</DetectorSpectrum>",
        f"<WavelengthDataBlock><WavelengthDataDirection>{name.title()}</WavelengthDataDirection>",
        f"<ColumnAngleBasis>{basis.name}</ColumnAngleBasis><RowAngleBasis>{basis.name}</RowAngleBasis>",
        "<ScatteringDataType>BTDF</ScatteringDataType>"
        if "trans" in name
        else "<ScatteringDataType>BRDF</ScatteringDataType>",
        "<ScatteringData>",
        *(",\t".join(map(repr, row.tolist())) + "," for row in values),
        "</ScatteringData></WavelengthDataBlock>",
        "</WavelengthData>",
    ]
