"""The text form of Speos' ``.brdf`` and ``.anisotropicbsdf`` files, v8.0: its flags, lists and blocks of values."""

import os
import re
from typing import NamedTuple

import numpy as np

from gonio.data.formats.optics.text_lines import MOST_VALUES, TextLines
from gonio.models.errors import GonioError, one_line

KIND = "a Speos BSDF file"
HEADER = re.compile(r"OPTIS\s*-\s*(brdf|anisotropic bsdf) surface file v(\d{1,4}(?:\.\d{1,4})?)\s*", re.IGNORECASE)
VERSION = 8.0
PARTS = ("reflection", "transmission")
MOST_BLOCKS = 1 << 16
MOST_PERCENT = 1e9
"""Of a total: what is above 100 is judged by gonio check."""


class Spectrum(NamedTuple):
    """Totals of a part by wavelength, at one incidence and rotation."""

    theta_i: float
    rotation: float
    wavelengths: np.ndarray
    """nm."""
    share: np.ndarray
    """Of the light; the file has per cent."""


class SpeosBlock(NamedTuple):
    """Values of one incidence."""

    part: str
    rotation: float
    """Degrees, like all angles here."""
    theta_i: float
    wavelength: int | None
    """Number of the wavelength; None: the spectrum's."""
    share: float | None
    """The total of the block, of the light."""
    theta: np.ndarray
    phi: np.ndarray
    values: np.ndarray
    """(theta, phi)."""


class SpeosText(NamedTuple):
    """All that a file says."""

    anisotropic: bool
    comment: str
    description: str
    vector: np.ndarray | None
    parts: tuple[str, ...]
    intensity: bool
    """Whether values are those of an intensity, which has the cosine; else of a BSDF."""
    wavelengths: np.ndarray
    """nm, of a .brdf file."""
    spectra: dict[str, Spectrum]
    """By the part, of an .anisotropicbsdf file."""
    blocks: list[SpeosBlock]


def read_speos_text(path: str | os.PathLike[str]) -> SpeosText:
    """What a Speos file says. Raises GonioError for other kinds and versions, by their names, and for damaged ones."""
    with open(path, "rb") as file:
        start = file.read(4096)
    first, second, *_ = [*start.split(b"\n", 2), b""]
    head = first.decode("latin-1").strip()
    match = HEADER.fullmatch(head)
    if match is None:
        raise GonioError(
            f"{path} is a Speos file of the kind {one_line(head.removeprefix('OPTIS').strip(' -'), 40)!r}; gonio reads "
            "the text forms of .brdf and .anisotropicbsdf, so save it as one of these"
        )
    if float(match[2]) != VERSION:
        raise GonioError(
            f"{path} is {KIND} of version {match[2]}, and gonio reads {VERSION}; save it again with a viewer of today"
        )
    if second.strip() == b"1" or b"\0" in start:
        raise GonioError(f"{path} is a binary Speos BSDF file; save it as text (mode 0), which gonio reads")
    text = TextLines(path, KIND, comment="")
    text.raw("its header")
    if (mode := text.next("its mode")) != "0":
        text.fail(f"the mode is {one_line(mode, 20)!r}; expected 0, for text")
    return _content(text, match[1].lower() != "brdf")


def _content(text: TextLines, anisotropic: bool) -> SpeosText:
    comment = text.raw("its comment").strip()
    description = _description(text)
    vector = text.numbers(3, "the anisotropy vector") if anisotropic else None
    flags = text.numbers(2, "the flags of reflection and transmission")
    kind = text.numbers(1, "the kind of its values")[0]
    parts = tuple(part for part, flag in zip(PARTS, flags, strict=True) if flag == 1)
    if not np.isin(flags, (0, 1)).all() or not parts or kind not in (0, 1):
        text.fail("its flags are not 0 and 1, or it has neither reflection nor transmission; copy it again")
    facts = (comment, description, vector, parts, kind == 0)
    if anisotropic:
        spectra, blocks = _anisotropic(text, parts)
        return SpeosText(True, *facts, np.zeros(0), spectra, blocks)
    wavelengths, blocks = _isotropic(text, parts)
    return SpeosText(False, *facts, wavelengths, {}, blocks)


def _description(text: TextLines) -> str:
    """The description, which has a stated number of characters, on one line or several."""
    line = text.next("the length of its description")
    if not re.fullmatch(r"\d{1,7}", line):
        text.fail(f"the length of its description is {one_line(line, 20)!r}; expected a number of characters")
    length, lines = int(line), []
    while sum(map(len, lines)) + len(lines) < length + 1 and length:
        if lines and re.fullmatch(r"[-+.\deE\s]+", text.peek()):
            break  # the number was not kept when the text was edited
        lines.append(text.raw("the end of its description").strip())
    return " ".join(filter(None, lines))


def _isotropic(text: TextLines, parts: tuple[str, ...]) -> tuple[np.ndarray, list[SpeosBlock]]:
    counts = text.next("the numbers of incidences and wavelengths").split()
    if len(counts) != 2:
        text.fail("expected the numbers of incidences and of wavelengths")
    incidences = text.angles(text.count(counts[0], "the number of incidences"), "the list of incidences", 0, 90)
    wavelengths = _wavelengths(text, text.numbers(text.count(counts[1], "the number of wavelengths"), "wavelengths"))
    blocks: list[SpeosBlock] = []
    for part in parts:
        for theta_i in incidences:
            for number in range(wavelengths.size):
                share = _share(text, text.numbers(1, "the total of a block in per cent")[0])
                blocks.append(_block(text, SpeosBlock(part, 0.0, theta_i, number, share, *[np.zeros(0)] * 3)))
    return wavelengths, blocks


def _anisotropic(text: TextLines, parts: tuple[str, ...]) -> tuple[dict[str, Spectrum], list[SpeosBlock]]:
    lit: list[tuple[str, float, float]] = []
    for part in parts:
        count = text.count(text.next("the number of rotations"), "the number of rotations")
        for rotation in text.angles(count, "the list of rotations", -360, 360):
            count = text.count(text.next("the number of incidences"), "the number of incidences")
            incidences = text.angles(count, "the list of incidences", 0, 90)
            lit += [(part, float(rotation), float(theta_i)) for theta_i in incidences]
            if len(lit) > MOST_BLOCKS:
                text.fail(f"it has above {MOST_BLOCKS:,} incidences; copy it again")
    spectra = {part: _spectrum(text) for part in parts}
    blocks: list[SpeosBlock] = []
    for part, rotation, theta_i in lit:
        blocks.append(_block(text, SpeosBlock(part, rotation, theta_i, None, None, *[np.zeros(0)] * 3)))
    return spectra, blocks


def _spectrum(text: TextLines) -> Spectrum:
    theta_i, rotation = text.numbers(2, "the incidence and rotation of the spectrum")
    text.raw("the description of the spectrum")
    count = text.count(text.next("the number of wavelengths"), "the number of wavelengths")
    rows = np.stack([text.numbers(2, "a wavelength and its total in per cent") for _ in range(count)])
    wavelengths, share = _wavelengths(text, rows[:, 0]), [_share(text, r) for r in rows[:, 1]]
    if not (np.isfinite(theta_i) and np.isfinite(rotation)):
        text.fail("the incidence of its spectrum is no angle; copy it again")
    return Spectrum(float(theta_i), float(rotation), wavelengths, np.array(share))


def _wavelengths(text: TextLines, values: np.ndarray) -> np.ndarray:
    if not ((values > 0) & (values < 1e6)).all() or np.unique(values).size < values.size:
        text.fail("its wavelengths are not all different and above 0; expected nm")
    return values


def _share(text: TextLines, percent: float) -> float:
    if not 0 <= percent <= MOST_PERCENT:
        text.fail(f"a total is {percent:g} per cent; expected a share of the light")
    return float(percent) / 100


def _block(text: TextLines, empty: SpeosBlock) -> SpeosBlock:
    counts = text.next("the numbers of angles of a block").split()
    if len(counts) != 2:
        text.fail("expected the numbers of polar angles and azimuths of a block")
    rows, columns = (text.count(c, "the number of angles of a block") for c in counts)
    if rows * columns > min(text.size, MOST_VALUES):
        text.fail(f"a block has {rows:,} × {columns:,} values, more than the file holds; copy it again")
    phi = text.angles(columns, "the azimuths of a block", -360, 360)
    table = np.stack([text.numbers(columns + 1, "a polar angle and its values") for _ in range(rows)])
    most = 90 if empty.part == "reflection" else 180
    if not ((table[:, 0] >= 0) & (table[:, 0] <= most + 1e-6)).all():
        text.fail(f"a polar angle of this block of {empty.part} is outside of 0 to {most} degrees; copy the file again")
    return empty._replace(theta=table[:, 0], phi=phi, values=table[:, 1:])
