"""Any file that gonio can read, known by what is in it, not by its name: the one list of formats."""

import dataclasses
import functools
import importlib
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from gonio.data.files import input_size
from gonio.data.formats import bbm_fits, material_file, merl, nist_ptfe, rgl_file
from gonio.data.formats.csv import directions, table_file
from gonio.data.formats.csv.columns import CsvText
from gonio.data.formats.file_colours import in_file_colours
from gonio.data.formats.foreign import foreign_kind
from gonio.data.formats.laboratory import alta, astm, bird, csail, openmaterial, pab, ssdd, utia
from gonio.data.formats.optics import fred, speos, zemax
from gonio.data.plausibility.consistency import check_readings
from gonio.data.round_trip import RoundTrip
from gonio.data.table import Table
from gonio.models.errors import GonioError, nearest

if TYPE_CHECKING:
    from gonio.data.material import Material

HEAD_BYTES = 1 << 16
HEADER_BYTES = 1 << 20
WIDE_MARKS = (b"\xff\xfe", b"\xfe\xff")
"""How UTF-16 text begins, whose half is zeros."""


@dataclasses.dataclass(frozen=True)
class FileHead:
    """The beginning of a file, by which its format is recognised."""

    path: str
    size: int
    """Bytes of the whole file."""
    start: bytes
    suffix: str
    """The ending of the name, small letters."""
    binary: bool
    """Whether the file is no text."""

    @functools.cached_property
    def text(self) -> CsvText | None:
        """A text file with its header; None for others. Raises GonioError for a text that has none."""
        return None if self.binary else CsvText(self.path, HEADER_BYTES)

    @functools.cached_property
    def opening(self) -> str:
        """The first characters of a text; nothing of other files."""
        wide = self.start[:2] in WIDE_MARKS
        return "" if self.binary else self.start.decode("utf-16" if wide else "latin-1", "ignore")

    @property
    def columns(self) -> list[str]:
        """The header of a text file as names of columns."""
        return self.text.names if self.text else []


@dataclasses.dataclass(frozen=True)
class Format:
    """A format: to add one, a module that reads it, and its entry in `FORMATS`."""

    name: str
    title: str
    """How a sentence names such a file."""
    holds: Literal["table", "model"]
    recognises: Callable[[FileHead], bool]
    """By the signature alone: what is damaged behind it is the reader's to say."""
    read: Callable[..., "Table | Material"]
    write: Callable[..., RoundTrip] | None = None
    """From a path, a table and `force`; and options of its own."""
    writes_models: bool = False
    """Whether `write` takes a material too."""
    write_options: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    """Keywords of `read`."""
    suffixes: tuple[str, ...] = ()
    """Endings by which the format of an output is chosen, the usual one first."""
    colours: tuple[str, ...] = ()
    """Kinds of three channels that `write` has a place for, of "rgb", "xyz", "wavelengths"; empty: any channels."""
    entries: Callable[[str | os.PathLike[str]], list[str]] | None = None
    """The names in a file of several materials; `read` then takes one as `entry`, written FILE:NAME."""
    by_blocks: bool = False
    """Whether `read` takes `blockwise`, and holds the readings against each other itself."""


def _read_hdf5(path: str | os.PathLike[str], blockwise: bool = False) -> Table:
    from gonio.data.hdf5.reader import BLOCKWISE_BYTES, open_table  # h5py is loaded with the first such file

    return open_table(path, BLOCKWISE_BYTES) if blockwise else open_table(path)


def _read_window_xml(path: str | os.PathLike[str]) -> Table:
    from gonio.data.formats.optics.window_xml import read_window_xml  # JAX is loaded with the first such file

    return read_window_xml(path)


def _reads_as(opening: str) -> Callable[[FileHead], bool]:
    """Whether a text has this pattern in its beginning; patterns take blanks once, as a stranger's may be many."""
    return lambda head: re.search(opening, head.opening) is not None


def _later(module: str, name: str) -> Callable[..., RoundTrip]:
    """A writer whose module is loaded with its first call: JAX comes with it."""

    def write(*args: Any, **options: Any) -> RoundTrip:
        return getattr(importlib.import_module(f"gonio.data.formats.{module}"), name)(*args, **options)

    return write


def _write_hdf5(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    from gonio.data.hdf5.writer import write_compared

    return write_compared(path, table, force)


def _write_merl(path: str | os.PathLike[str], source: "Table | Material", force: bool = False) -> RoundTrip:
    return merl.write_merl(path, source if isinstance(source, Table) else source.brdf, force)


def _write_rgl(
    path: str | os.PathLike[str], source: "Table | Material", force: bool = False, **options: Any
) -> RoundTrip:
    from gonio.data.formats.rgl_write import write_rgl  # SciPy and JAX are loaded with the first such file

    return write_rgl(path, source, force, **options)


FORMATS = (
    Format(
        "material", "a material (.toml)", "model",
        lambda head: head.suffix == ".toml" or b"gonio_material" in head.start,
        material_file.read_material, suffixes=(".toml",),
    ),
    Format(
        "published fits", "published fits (.fit)", "model", lambda head: head.suffix == ".fit",
        bbm_fits.read_published, options=("entry",), suffixes=(".fit",), entries=bbm_fits.published_names,
    ),
    Format(
        "HDF5", "a table of gonio (HDF5)", "table",
        lambda head: head.start.startswith(b"\x89HDF\r\n\x1a\n") and b"com.xrite" not in head.start,
        _read_hdf5, _write_hdf5, by_blocks=True, suffixes=(".h5", ".hdf5", ".nc"),
    ),
    Format(
        "RGL", "RGL .bsdf", "table", lambda head: head.start.startswith(b"tensor_file\0"),
        rgl_file.read_rgl, _write_rgl, writes_models=True, write_options=("channel_bytes",), suffixes=(".bsdf",),
        colours=("rgb", "wavelengths"),
    ),
    Format(
        "MERL", "MERL .binary", "table",
        lambda head: merl.has_header(head.start, head.size) or (head.binary and head.suffix == ".binary"),
        merl.read_merl, _write_merl, writes_models=True, options=("nodes",), suffixes=(".binary",),
        colours=("rgb",),
    ),
    Format(
        "Klems", "an XML BSDF of WINDOW or Radiance", "table",
        lambda head: b"<WindowElement" in head.start or b"<\0W\0i\0n\0d\0o\0w\0E\0l" in head.start,
        _read_window_xml, _later("optics.window_xml_write", "write_window_xml"), writes_models=True,
        write_options=("basis", "channel"), suffixes=(".xml",),
    ),
    Format(
        "Speos", "a Speos .brdf or .anisotropicbsdf (text)", "table", lambda head: head.start.startswith(b"OPTIS"),
        speos.read_speos, _later("optics.speos_write", "write_speos"), writes_models=True, write_options=("step",),
        suffixes=(".anisotropicbsdf", ".brdf"),
    ),
    Format(
        "Zemax", "a Zemax .bsdf (text)", "table",
        _reads_as(r"(?im)^[ \t\r]*+(?:(?:SampleRotation|AngleOfIncidence)\s++\d|ScatterType[ \t]++B[RT]DF[ \t\r]*$)"),
        zemax.read_zemax, _later("optics.zemax_write", "write_zemax"), writes_models=True,
        write_options=("part", "channel", "step"), options=("scale",), suffixes=(".bsdf",),
    ),
    Format(
        "FRED", "FRED's text of readings", "table", _reads_as(r"(?im)^[ \t\r]*+type[ \t]++bsdf_data\b|^!!.*BSDF"),
        fred.read_fred,
    ),
    Format(
        "SSDD", "an SSDD file", "table", lambda head: ssdd.is_ssdd(head.start),
        ssdd.read_ssdd, _later("laboratory.ssdd_write", "write_ssdd"), writes_models=True, write_options=("ascii",),
        suffixes=(".ssdd",), colours=("rgb", "xyz", "wavelengths"),
    ),
    Format(
        "UTIA", "a UTIA BRDF", "table", lambda head: head.size == utia.BYTES and (head.binary or head.suffix == ".bin"),
        utia.read_utia, _later("laboratory.utia_write", "write_utia"), writes_models=True, options=("scale",),
        suffixes=(".bin",), colours=("rgb",),
    ),
    Format(
        "CSAIL", "an anisotropic BRDF of MIT CSAIL", "table", lambda head: csail.is_csail(head.start),
        csail.read_csail, options=("nodes", "scale"),
    ),
    Format(
        "ASTM", "an ASTM file (E1392, E2387)", "table", _reads_as(astm.VARIABLES),
        astm.read_astm, _later("laboratory.astm_write", "write_astm"), options=("angles", "quantity", "mirror_azimuth"),
        suffixes=(".astm",),
    ),
    Format(
        "ALTA", "an ALTA file", "table", _reads_as(alta.SIGNATURE),
        alta.read_alta, options=("quantity", "coverage"),
    ),
    Format(
        "pab", "a pab goniophotometer's file", "table", _reads_as(pab.SIGNATURE),
        pab.read_pab, options=("mirror_azimuth",),
    ),
    Format(
        "OpenMATERIAL", "an OpenMATERIAL table (.xompt)", "table",
        lambda head: openmaterial.is_openmaterial(head.start),
        openmaterial.read_openmaterial, options=("quantity", "mirror_azimuth"), suffixes=(".xompt",),
    ),
    Format(
        "BiRD", "a BiRD file (JSON)", "table", lambda head: bird.is_bird(head.start),
        bird.read_bird, _later("laboratory.bird_write", "write_bird"),
        options=("quantity", "mirror_azimuth", "coverage"), suffixes=(".json",),
    ),
    Format(
        "NIST", "NIST's PTFE CSV", "table", lambda head: bool(nist_ptfe.columns_of(head.columns)),
        nist_ptfe.read_nist, options=("wavelength_nm",),
    ),
    Format(
        "CSV", "CSV with a header (theta_i,phi_i,theta_o,phi_o,f)", "table",
        lambda head: head.text is not None and head.text.has_directions, table_file.read_csv, table_file.write_csv,
        options=("angles", "quantity", "missing", "mirror_azimuth", "coverage"), suffixes=(".csv",),
    ),
)  # fmt: skip
"""In the order in which files are tried."""
TABLES_OF_TEXT = 2
"""The last formats have no signature: they are tables of text, which a foreign text may look like."""


def sniff(path: str | os.PathLike[str]) -> Format:
    """The format of a file. Raises GonioError, in one sentence, for an unknown one and for what cannot be read."""
    size = input_size(path)
    with open(path, "rb") as file:
        start = file.read(HEAD_BYTES)
    head = FileHead(os.fspath(path), size, start, _suffix(path), b"\0" in start and not _wide_text(start))
    for known in FORMATS[:-TABLES_OF_TEXT]:
        if known.recognises(head):
            return known
    if (kind := foreign_kind(start, head.suffix)) is not None:
        raise GonioError(
            f"{path} is {kind}, which gonio does not read; export its readings as CSV with the columns "
            "theta_i,phi_i,theta_o,phi_o,f"
        )
    for known in FORMATS[-TABLES_OF_TEXT:]:
        if known.recognises(head):
            return known
    if head.text is not None and head.text.delimiter and len(head.columns) > 1 and not head.text.headless:
        directions.direction_columns(head.text)  # raises, naming the columns that are missing
    names = ", ".join(known.name for known in FORMATS if known.holds == "table")
    kind = "binary" if head.binary else "text"
    raise GonioError(f"{path} is {kind} of an unknown kind; expected one of {names}")


def _wide_text(start: bytes) -> bool:
    """Whether the beginning of a file is UTF-16 text: numbers may begin with its mark, but have no lines."""
    if start[:2] not in WIDE_MARKS:
        return False
    text = start[: len(start) // 2 * 2].decode("utf-16", "replace")
    return "\0" not in text and ("\n" in text or "\r" in text or len(start) < HEAD_BYTES)


def load(path: str | os.PathLike[str], *, blockwise: bool = False, **options: Any) -> "Table | Material":
    """The table or the material of a file, or of one entry of it, ``FILE:NAME``.

    `blockwise`: more values than a few stay in the file, where its format allows that, for who reads them in blocks.
    `options`: `nodes` ("lower" or "centre") for MERL and CSAIL, `scale` for UTIA, CSAIL and Zemax, `wavelength_nm` for
    NIST; `angles`, `quantity`, `missing`, `mirror_azimuth` and `coverage` for CSV (see `read_csv` in
    `gonio.data.formats.csv.table_file`), most of them for laboratories' files too (see the reader of each). Raises
    GonioError for a file that is damaged or unknown, and for an option that its format does not have.
    """
    file, entry = split_entry(path)
    known = sniff(file)
    if entry is not None:
        options["entry"] = entry
    if unknown := sorted(set(options) - set(known.options)):
        raise GonioError(f"{path} is {known.title}, which has no option {unknown[0]!r}; leave it out")
    if known.by_blocks:
        return known.read(file, blockwise=blockwise, **options)
    content = known.read(file, **options)
    if isinstance(content, Table):
        try:
            check_readings(content)
        except GonioError as error:
            raise GonioError(f"{path}: {error}") from None
    return content


def read(path: str | os.PathLike[str], **options: Any) -> Table:
    """The table of a file; options and errors are those of `load`. Raises GonioError for a model, with the remedy."""
    text = os.fspath(path)
    if (text.endswith(")") or not _suffix(text)) and not is_there(text):
        raise GonioError(f"'{text[:80]}' is no file; gonio.material(...) opens models and reference materials by name")
    table = load(path, **options)
    if not isinstance(table, Table):
        raise GonioError(f"{path} is a model, not a table; measure it first: gonio measure '{path}' -o T.h5")
    return table


def is_there(path: str | os.PathLike[str]) -> bool:
    """Whether a path exists; False for what can be no path: an expression too long for a name, or a null character."""
    try:
        return Path(path).exists()
    except (OSError, ValueError):
        return False


def split_entry(path: str | os.PathLike[str]) -> tuple[str, str | None]:
    """(file, entry) of ``FILE:NAME`` where FILE is of a format with entries; (path, None) of any other path."""
    text = os.fspath(path)
    file, colon, entry = text.rpartition(":")
    suffixes = {suffix for known in FORMATS if known.entries for suffix in known.suffixes}
    if not colon or is_there(text) or _suffix(file) not in suffixes:
        return text, None
    return file, entry


def targets() -> dict[str, Format]:
    """The formats that are written, by the names in small letters that ``--to`` gives them."""
    return {known.name.casefold(): known for known in FORMATS if known.write is not None}


def _ending(path: str | os.PathLike[str]) -> str:
    """What is said of a path whose ending names no format."""
    return f"ends in '{_suffix(path)}'" if _suffix(path) else "has no ending"


def writable(path: str | os.PathLike[str], to: str | None = None) -> Format:
    """The format in which an output of this name is written, or the one that is named.

    Raises GonioError, naming the endings, for another ending, and for a name that no written format has.
    """
    writers = targets()
    if to is not None:
        if (known := writers.get(to.casefold())) is None:
            raise GonioError(f"no format {to[:80]!r} is written; {nearest(to[:80], writers)}")
        if known.suffixes and _suffix(path) not in known.suffixes:
            raise GonioError(f"{path} {_ending(path)}; {known.title} ends in {' or '.join(known.suffixes)}")
        return known
    for known in writers.values():
        if _suffix(path) in known.suffixes:
            return known
    *first, last = (f"{known.suffixes[0]} ({known.name})" for known in writers.values() if known.suffixes)
    raise GonioError(f"{path} {_ending(path)}; give {', '.join(first)} or {last} to say the format")


def write(
    path: str | os.PathLike[str],
    source: "Table | Material",
    force: bool = False,
    to: str | None = None,
    **options: Any,
) -> RoundTrip:
    """Writes a table, or a material where the format holds models, in the format of the path's ending.

    Args:
        path: its ending says the format.
        source: a table or a material.
        force: replaces an existing file.
        to: the format's name, where several have one ending.
        options: `channel_bytes` for RGL (see `gonio.data.formats.rgl_write.write_rgl`).

    Returns:
        What reading the file again shows to be lost.

    Raises:
        GonioError: another ending, a model for a format of readings, an option that the format does not have, a path
            that exists (unless `force`) or cannot be written.
    """
    known = writable(path, to)
    if not (isinstance(source, Table) or known.writes_models):
        raise GonioError(
            f"{source.name} is a model, and {known.name} holds readings; measure it first: gonio measure "
            f"'{source.name}' -o T.h5"
        )
    if unknown := sorted(set(options) - set(known.write_options)):
        raise GonioError(f"{path} is written as {known.name}, which has no option {unknown[0]!r}; leave it out")
    assert known.write is not None
    source, remark = in_file_colours(source, known.title, known.colours)
    error = known.write(path, source, force=force, **options)
    return dataclasses.replace(error, note="; ".join(filter(None, [error.note, remark])))


def _suffix(path: str | os.PathLike[str]) -> str:
    return os.path.splitext(path)[1].lower()
