"""Tabular ``.bsdf`` files of Zemax OpticStudio: f about the mirror direction, or about the direction straight through.

Degrees. ScatterRadial is the angle from that direction, ScatterAzimuth the azimuth about it, 0 towards the normal and
counter-clockwise as seen from outside; AngleOfIncidence is the polar angle of that direction. Values are f, 1/sr; TIS,
the share of light that is scattered, is an integral of its own, which need not be that of the values.
"""

import math
import os
import re
from typing import NamedTuple

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.flags import Flag
from gonio.data.formats.optics.angle_nodes import on_nodes
from gonio.data.formats.optics.grid_words import all_zero_in_words, copied_pole, repeats_in_words
from gonio.data.formats.optics.stated_totals import BY_TOTALS, StatedTotals
from gonio.data.formats.optics.text_lines import MOST_VALUES, TextLines
from gonio.data.layouts import Layout
from gonio.data.table import COPIED, Table
from gonio.models.errors import GonioError, nearest, one_line

KIND = "a Zemax BSDF file"
LISTS = {
    "samplerotation": ("SampleRotation", -3600.0, 3600.0),
    "angleofincidence": ("AngleOfIncidence", -90.0, 90.0),
    "scatterazimuth": ("ScatterAzimuth", -3600.0, 3600.0),
    "scatterradial": ("ScatterRadial", -180.0, 180.0),
}
"""The lists of angles in the order of the values, with their least and largest."""
WORDS = {
    "source": ("Source", None),
    "symmetry": ("Symmetry", ("PlaneSymmetrical", "Asymmetrical", "ASymmetrical4D")),
    "spectralcontent": ("SpectralContent", ("Monochrome", "XYZ")),
    "scattertype": ("ScatterType", ("BRDF", "BTDF")),
}
SECTIONS = {"monochrome": "grey", "tristimulusx": "X", "tristimulusy": "Y", "tristimulusz": "Z"}
"""What stands before the values of a channel, and the channel's name."""
MOST_COMMENTS = 200


class Header(NamedTuple):
    """What stands before the values."""

    words: dict[str, str]
    lists: dict[str, np.ndarray]

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of rotations, incidences, azimuths and radial angles."""
        return tuple(self.lists[name].size for name in LISTS)


class Section(NamedTuple):
    """The values of one channel."""

    channel: str
    tis: np.ndarray
    """(rotation, incidence)."""
    values: np.ndarray
    """(rotation, incidence, azimuth, radial), 1/sr."""


def read_zemax(path: str | os.PathLike[str], scale: str | float | None = None) -> Table:
    """The table of a Zemax BSDF file, on the file's own grid about the mirror direction or straight through.

    What the grid has beyond the horizon is BELOW_HORIZON; one direction's repeated values are averaged.

    Args:
        path: the file.
        scale: "tis" multiplies each incidence so that the integral of its values is the file's TIS, as the vendor's
            converter to Speos does; otherwise values are f as they stand.

    Raises:
        GonioError: a damaged file, with the line; another scale, and one to a TIS that the file does not have.
    """
    if scale not in (None, BY_TOTALS):
        raise GonioError(f"the scale of {path} is {scale!r}; Zemax values are f as they stand, or --scale {BY_TOTALS}")
    text = TextLines(path, KIND)
    header = _header(text)
    sections = _sections(text, header)
    transmits = header.words["scattertype"] == "BTDF"
    azimuth = header.lists["scatterazimuth"]
    if (azimuth % 360 >= 180).all() and header.words["symmetry"] == "PlaneSymmetrical":
        azimuth = -azimuth  # the other side of the plane of incidence, whose mirror image this is
    values = np.stack([np.swapaxes(s.values, 2, 3) for s in sections])
    out = on_nodes(header.lists["scatterradial"], azimuth, values)
    light = np.moveaxis(out.values, (1, 2), (-1, -2))  # (channel, radial, azimuth, incidence, rotation)
    lit = on_nodes(header.lists["angleofincidence"], -header.lists["samplerotation"], light, pole=False)
    turned = lit.azimuth.size > 1
    make = layouts.straight if transmits else layouts.mirror
    angles = [np.radians(x) for x in (lit.polar, out.polar, out.azimuth, lit.azimuth)]
    layout = make(angles[0], angles[1], angles[2], angles[3] if turned else None)
    f = np.transpose(lit.values, (3, 1, 2, 4, 0))
    missing = out.missing[None, :, :, None, None] | lit.missing[:, None, None, :, None]
    flag = np.where(np.isfinite(f), np.uint8(Flag.VALID), np.uint8(Flag.INVALID))
    flag[np.broadcast_to(missing, f.shape)] = Flag.NOT_MEASURED
    shape = (*layout.shape, len(sections))
    f, flag = f.reshape(shape), flag.reshape(shape)
    flag[~layout.readable().reshape(layout.shape)] = Flag.BELOW_HORIZON
    f = np.where(flag == Flag.VALID, f, np.nan)
    tis = np.moveaxis(np.stack([s.tis for s in sections]), 1, 2)
    tis = on_nodes(header.lists["angleofincidence"], -header.lists["samplerotation"], tis, pole=False).values
    table = Table(layout, f, flag, _channels(text, sections), name=stem(path))
    totals = StatedTotals.of(table, tis.transpose(1, 2, 0))
    table.provenance = {
        "format": "Zemax BSDF",
        "source": os.path.basename(path),
        "comments": [one_line(c) for c in text.comments[:MOST_COMMENTS] if c.strip("= ")],
        "symmetry": header.words["symmetry"],
        "understood": [*_understood(header, layout, turned), *repeats_in_words(out), *repeats_in_words(lit)],
        "totals": [t.replace("of the values", "before scaling") if scale else t for t in totals.in_words()],
    }
    table.provenance["understood"].insert(1, totals.scaled(table, path) if scale else totals.unscaled())
    if copied_pole(layout, f):
        table.provenance[COPIED] = True
    if dark := all_zero_in_words(layout, f):
        table.provenance["warnings"] = [dark]
    return table


def _header(text: TextLines) -> Header:
    words: dict[str, str] = {}
    lists = {"samplerotation": np.zeros(1)}
    while text.peek().split()[:1] and (key := text.peek().split()[0].lower()) not in (*SECTIONS, "databegin"):
        _, *rest = text.next("its header").split()
        if key in LISTS:
            name, low, high = LISTS[key]
            lists[key] = text.angles(text.count(" ".join(rest), f"the number after {name}"), name, low, high)
        elif key in WORDS:
            name, known = WORDS[key]
            word = " ".join(rest)
            same = [k for k in known or () if k.lower() == word.lower()]
            if known and not same:
                text.fail(f"{name} is {one_line(word, 40)!r}; {nearest(word, known)}")
            words[key] = same[0] if known else word
        else:
            text.fail(f"{one_line(key, 40)!r} is no word of {KIND}; {nearest(key, [n for n, *_ in LISTS.values()])}")
    if absent := [name for key, (name, *_) in LISTS.items() if key not in lists]:
        text.refuse(f"it has no {absent[0]} before its values; copy it again")
    words = {"symmetry": "Asymmetrical", "spectralcontent": "Monochrome"} | words
    if "scattertype" not in words:
        text.refuse("it does not say ScatterType BRDF or BTDF; add that line")
    return Header(words, lists)


def _sections(text: TextLines, header: Header) -> list[Section]:
    names = ["X", "Y", "Z"] if header.words["spectralcontent"] == "XYZ" else ["grey"]
    count = math.prod(header.shape)
    if 2 * count > text.size or count * len(names) > MOST_VALUES:
        text.refuse(f"its lists of angles make {count:,} values, more than it holds; copy it again")
    sections: dict[str, Section] = {}
    while text.peek():
        key = text.next("its values").split()[0].lower()
        name = SECTIONS.get(key, names[0] if key == "databegin" else "")
        if name not in names or name in sections:
            text.fail(f"{one_line(key, 40)!r} stands where the values of {', '.join(names)} are expected; once each")
        if key != "databegin" and text.next("DataBegin").lower() != "databegin":
            text.fail("expected DataBegin")
        sections[name] = _section(text, header, name)
        if text.peek().lower() == "dataend":
            text.next("DataEnd")
        else:
            text.row += 1
            text.fail("expected DataEnd: it has more values than its lists of angles make, or is cut")
    if absent := [name for name in names if name not in sections]:
        text.refuse(f"it has no values of the channel {absent[0]}; copy it again")
    return [sections[name] for name in names]


def _section(text: TextLines, header: Header, channel: str) -> Section:
    rotations, incidences, azimuths, radial = header.shape
    tis, rows = [], []
    for _ in range(rotations * incidences):
        tis.append(math.nan)
        if text.peek().lower().startswith("tis"):
            line = text.next("TIS")[3:]
            numbers = text.parsed(line, "TIS")
            if numbers.size != 1:
                text.fail(f"TIS is {one_line(line, 40)!r}; expected one number")
            tis[-1] = float(numbers[0])
        rows += [text.numbers(radial, "a row of values over ScatterRadial") for _ in range(azimuths)]
    return Section(channel, np.reshape(tis, (rotations, incidences)), np.reshape(rows, header.shape))


def _channels(text: TextLines, sections: list[Section]) -> Channels:
    stated = [m for c in text.comments if (m := re.search(r"(?i)wavelength\s*\(nm\)\s*[=:]\s*([0-9.]{1,12})\s*$", c))]
    if len(sections) == 1 and stated:
        try:
            return Channels.of_wavelengths([float(stated[0][1])])
        except ValueError:  # of a comment: no number after all, or none of a wavelength
            pass
    return Channels(tuple(s.channel for s in sections))


def _understood(header: Header, layout: Layout, turned: bool) -> list[str]:
    transmits = header.words["scattertype"] == "BTDF"
    centre = "direction straight through" if transmits else "mirror direction"
    sentences = [
        f"angles are degrees about the {centre}: radial 0 is that direction, azimuth 0 points to the normal, "
        "counter-clockwise",
    ]
    if transmits:
        sentences.append(
            "transmission (BTDF), light in front and detector behind: the media of both sides are taken as alike, so "
            "that light goes straight through at the angle of incidence"
        )
    if turned:
        sentences.append(
            "+x is where the light comes from at rotation 0 (the vendor says: the angle from the surface's +X to the "
            "normal of the plane of incidence); the sense of the rotation is not said: taken as counter-clockwise, "
            "phi_i = −rotation"
        )
    else:
        sentences.append("one rotation of the sample: the surface is taken as isotropic")
    if layout.mirrored_axes:
        sentences.append("azimuths are of one side only: the other is taken as its mirror image")
    if layout.mirrored_axes and header.words["symmetry"] != "PlaneSymmetrical":
        sentences.append(f"though its symmetry is {header.words['symmetry']}")
    below = int((~layout.readable()).sum())
    if below:
        sentences.append(f"{below} nodes of the grid lie beyond the horizon; their values are left out")
    return sentences
