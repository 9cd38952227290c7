"""XML files of windows and daylight, WINDOW's and Radiance's: matrices over Klems bases and tensor trees.

Read as a table of the file's own patches and, between them, the file's own rule: f is constant in each patch. A file's
"front" is +z here. (Radiance's programs call that side the back.)
"""

import itertools
import os
import xml.etree.ElementTree as ElementTree
from typing import NamedTuple

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import input_size, stem
from gonio.data.flags import Flag
from gonio.data.interpolation.angle_basis import EARLIER_BASES, KLEMS_BASES, MOST_PATCHES, AngleBasis
from gonio.data.interpolation.scattering_blocks import BLOCKS, Matrix, ScatteringBlock, SheetBSDF
from gonio.data.interpolation.tree_text import parse_numbers, parse_tree
from gonio.data.table import Table
from gonio.models.errors import GonioError, nearest

MOST_BYTES = 1 << 27
MOST_ELEMENTS = 1 << 16
MOST_RINGS = 512
STRUCTURES = ("Columns", "Rows", "TensorTree3", "TensorTree4")
NANOMETRES = {"nm": 1.0, "nanometer": 1.0, "nanometers": 1.0, "micrometer": 1e3, "micrometers": 1e3, "um": 1e3}


Bases = dict[str, tuple[AngleBasis, ...]]
"""By their names in small letters: the one that the file defines, or those that programs have taken for it."""


class SheetData(NamedTuple):
    """What a file of a sheet holds."""

    blocks: list[dict[str, ScatteringBlock]]
    """Of each channel, by the names of `BLOCKS`."""
    channels: Channels
    structure: str
    material: str
    left_out: tuple[str, ...]
    undefined: tuple[str, ...]
    """Bases that the file names without defining them."""


class _Elements(ElementTree.TreeBuilder):
    """Builds the tree of a stranger's file: no document type, so no entities, and a bounded number of elements."""

    count = 0

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise GonioError("it declares a document type, which files of this kind do not have")

    def start(self, tag: str, attrs: dict[str, str]) -> ElementTree.Element:
        self.count += 1
        if self.count > MOST_ELEMENTS:
            raise GonioError(f"it has more than {MOST_ELEMENTS:,} elements")
        return super().start(tag.rpartition("}")[2], attrs)

    def end(self, tag: str) -> ElementTree.Element:
        return super().end(tag.rpartition("}")[2])


def read_window_xml(path: str | os.PathLike[str]) -> Table:
    """The table of an XML file of a sheet: a reading for each patch, light on both sides, reflected and transmitted.

    `Table.interpolant` is `gonio.data.interpolation.scattering_blocks.SheetBSDF`, the file's own rule. Raises
    GonioError for a damaged file.
    """
    data = read_sheet(path)
    bsdf = SheetBSDF({name: tuple(of_channel.get(name) for of_channel in data.blocks) for name in BLOCKS})
    values = []
    for name, channels in bsdf.shared_patches():
        each = [block.samples().f for c in channels if (block := bsdf.blocks[name][c]) is not None]
        values.append(np.full((each[0].size, len(data.blocks)), np.nan))
        values[-1][:, channels] = np.stack(each, axis=-1)
    f = np.concatenate(values)
    flag = np.where(np.isfinite(f), np.uint8(Flag.VALID), np.uint8(Flag.NOT_MEASURED))
    provenance = {
        "format": "window XML",
        "source": os.path.basename(path),
        "material": data.material,
        "structure": data.structure,
        "blocks": [name for name in BLOCKS if any(b is not None for b in bsdf.blocks[name])],
        "isotropic": bsdf.isotropic,
        "assumptions": [
            "the file's front is the front here (+z); Radiance's programs call that side the back",
            "f is constant in each patch of the file",
            *(f"the file does not define its basis {name}; it is taken as WINDOW's" for name in data.undefined),
            *(f"left out: {what}" for what in data.left_out),
        ],
    }
    grid = layouts.scattered(*bsdf.directions())

    def interpolant(coarse: bool = False) -> SheetBSDF:
        if coarse:
            raise GonioError(
                f"the patches of {path} cannot be thinned; measure it on a grid: gonio measure FILE -o T.h5"
            )
        return bsdf

    return Table(grid, f, flag, data.channels, provenance=provenance, name=stem(path), interpolant=interpolant)


def read_sheet(path: str | os.PathLike[str]) -> SheetData:
    """The blocks of an XML file of a sheet. Raises GonioError where the file is damaged or is not of this kind."""
    size = input_size(path)
    try:
        if size > MOST_BYTES:
            raise GonioError(f"it has {size >> 20} MiB; such a file has at most {MOST_BYTES >> 20}")
        with open(path, "rb") as file:
            return _sheet(_root(file.read()))
    except GonioError as error:
        raise GonioError(f"{path} is no BSDF of WINDOW or Radiance: {error}; export it again") from None


def _root(data: bytes) -> ElementTree.Element:
    # Files made by a run of a program that was recovered begin with a line of its words
    starts = [k for k in (data.find(b"<?xml", 0, 1 << 16), data.find(b"<WindowElement", 0, 1 << 16)) if k > 0]
    parser = ElementTree.XMLParser(target=_Elements())
    try:
        parser.feed(data[min(starts) :] if starts and data[:1] not in (b"<", b"\xef", b"\xff", b"\xfe") else data)
        return parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise GonioError(f"its XML is damaged ({error})") from None


def _text(element: ElementTree.Element, path: str) -> str:
    child = element.find(path)
    return "" if child is None or child.text is None else child.text.strip()


def _sheet(root: ElementTree.Element) -> SheetData:
    layer = root.find("Optical/Layer")
    if root.tag != "WindowElement" or layer is None:
        raise GonioError("it has no WindowElement with an optical layer")
    structure = _text(layer, "DataDefinition/IncidentDataStructure")
    known = next((s for s in STRUCTURES if s.lower() == structure.lower()), None)
    if known is None:
        raise GonioError(f"its data structure is {structure[:40]!r}; {nearest(structure, STRUCTURES)}")
    bases: Bases = {}
    for basis in (*KLEMS_BASES, *EARLIER_BASES):
        bases[basis.name.lower()] = (*bases.get(basis.name.lower(), ()), basis)
    for element in layer.iterfind("DataDefinition/AngleBasis"):
        basis = _basis(element)
        bases[basis.name.lower()] = (basis,)
    blocks: dict[str, dict[str, ScatteringBlock]] = {}
    wavelengths: dict[str, float | None] = {}
    left_out = [f"{n - 1} more layers" for n in [len(root.findall("Optical/Layer"))] if n > 1]
    for element in layer.iterfind("WavelengthData"):
        label, length = _wavelength(element)
        for block in element.iterfind("WavelengthDataBlock"):
            direction = _text(block, "WavelengthDataDirection").lower()
            if label.lower() in ("cie-u", "cie-v"):
                left_out.append(f"chromaticity {label} of {direction}")
            elif direction in BLOCKS:
                wavelengths[label] = length
                blocks.setdefault(label, {})[direction] = _block(block, known, bases, f"{direction}, {label}")
            else:
                raise GonioError(f"it has a block in the direction {direction[:40]!r}; {nearest(direction, BLOCKS)}")
    if not blocks:
        raise GonioError("it has no block of scattering data")
    lengths = list(wavelengths.values())
    channels = Channels(tuple(wavelengths))
    if all(length is not None for length in lengths):
        channels = Channels.of_wavelengths([length for length in lengths if length is not None])
    material = " ".join(filter(None, (_text(layer, f"Material/{k}") for k in ("Manufacturer", "Name"))))
    named = [(e.text or "").strip() for tag in ("Column", "Row") for e in layer.iter(f"{tag}AngleBasis")]
    undefined = sorted({name for name in named if len(bases.get(name.lower(), ())) > 1})
    return SheetData(list(blocks.values()), channels, known, material, tuple(left_out), tuple(undefined))


def _wavelength(element: ElementTree.Element) -> tuple[str, float | None]:
    """The name of a channel, and its wavelength, nm, if it has one."""
    label = _text(element, "Wavelength") or "unnamed"
    child = element.find("Wavelength")
    unit = "" if child is None else child.get("unit", "").lower()
    try:
        return label, float(label) * NANOMETRES[unit]
    except (ValueError, KeyError):
        return label, None


def _basis(element: ElementTree.Element) -> AngleBasis:
    name = _text(element, "AngleBasisName")
    rings = element.findall("AngleBasisBlock")
    if len(rings) > MOST_RINGS:
        raise GonioError(f"the angle basis {name!r} has {len(rings):,} rings; at most {MOST_RINGS} are read")
    try:
        lower, upper = ([float(_text(r, f"ThetaBounds/{k}Theta")) for r in rings] for k in ("Lower", "Upper"))
        counts = [int(_text(r, "nPhis")) for r in rings]
    except (ValueError, OverflowError):
        raise GonioError(f"the angle basis {name!r} has bounds or counts that are no numbers") from None
    if max(counts, default=0) > MOST_PATCHES or not np.allclose(lower, [0.0, *upper[:-1]], atol=1e-4):
        raise GonioError(f"the rings of the angle basis {name!r} do not join, or have above {MOST_PATCHES:,} patches")
    return AngleBasis(name, (0.0, *upper), tuple(counts))


def _block(element: ElementTree.Element, structure: str, bases: Bases, what: str) -> ScatteringBlock:
    text = _text(element, "ScatteringData")
    if structure.startswith("Tensor"):
        basis = _text(element, "AngleBasis")
        if basis.lower() != "lbnl/shirley-chiu":
            raise GonioError(f"{what}: the angle basis of a tensor tree is {basis[:40]!r}, expected LBNL/Shirley-Chiu")
        return parse_tree(text, int(structure[-1]), what)
    names = [_text(element, f"{k}AngleBasis") for k in ("Column", "Row")]
    for name in names:
        if name.lower() not in bases:
            raise GonioError(f"{what}: the angle basis {name[:40]!r} is not defined")
    values = parse_numbers(text, what)
    known = [(a, b) for a, b in itertools.product(*(bases[name.lower()] for name in names))]
    fitting = [(a, b) for a, b in known if a.size * b.size == values.size]
    if not fitting:
        arriving, leaving = known[0]
        raise GonioError(f"{what}: {values.size:,} values, expected {leaving.size} × {arriving.size}")
    arriving, leaving = fitting[0]
    if structure == "Rows":
        return Matrix(values.reshape(arriving.size, leaving.size).T, arriving, leaving)
    return Matrix(values.reshape(leaving.size, arriving.size), arriving, leaving)
