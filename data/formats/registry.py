"""Any file that gonio can read, known by what is in it, not by its name: the one list of formats."""

import os
from typing import TYPE_CHECKING, Any

from gonio.data.files import is_there
from gonio.data.formats import bbm_fits, csv, hdf5_file, material_file, merl, nist_ptfe, rgl_file
from gonio.data.formats.base import FileHead, Format, file_head
from gonio.data.round_trip import RoundTrip
from gonio.data.table import Table
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.data.material import Material

FORMATS: tuple[Format, ...] = (
    material_file.FORMAT,
    bbm_fits.FORMAT,
    hdf5_file.FORMAT,
    rgl_file.FORMAT,
    merl.FORMAT,
    nist_ptfe.FORMAT,
    csv.FORMAT,
)
"""In the order in which files are tried."""


def sniff(path: str | os.PathLike[str]) -> Format:
    """The format of a file. Raises GonioError, in one sentence, for an unknown one and for what cannot be read."""
    head = file_head(path)
    for known in FORMATS:
        if known.sniff(head):
            return known
    names = head.columns
    if len(names) > 1 and not _is_number(names[0]):
        csv.read_directions(path)  # raises, naming the columns that are missing
    return _refuse(head)


def load(path: str | os.PathLike[str], **options: Any) -> "Table | Material":
    """The table or the material of a file, or of one entry of it, ``FILE:NAME``.

    `options`: `nodes` ("lower" or "centre") for MERL, `wavelength_nm` for NIST. Raises GonioError for a file that is
    damaged or unknown, and for an option that its format does not have.
    """
    file, entry = split_entry(path)
    known = sniff(file)
    if entry is not None:
        options["entry"] = entry
    if unknown := sorted(set(options) - set(known.options)):
        raise GonioError(f"{path} is a {known.name} file, which has no option {unknown[0]!r}; leave it out")
    return known.read(file, **options)


def read(path: str | os.PathLike[str], **options: Any) -> Table:
    """The table of a file; options and errors are those of `load`. Raises GonioError for a model, with the remedy."""
    table = load(path, **options)
    if not isinstance(table, Table):
        raise GonioError(f"{path} is a model, not a table; measure it first: gonio measure '{path}' -o T.h5")
    return table


def split_entry(path: str | os.PathLike[str]) -> tuple[str, str | None]:
    """(file, entry) of ``FILE:NAME`` where FILE is of a format with entries; (path, None) of any other path."""
    text = os.fspath(path)
    file, colon, entry = text.rpartition(":")
    if not colon or is_there(text):
        return text, None
    suffixes = {suffix for known in FORMATS if known.entries for suffix in known.suffixes}
    return (file, entry) if os.path.splitext(file)[1].lower() in suffixes else (text, None)


def writable(path: str | os.PathLike[str]) -> Format:
    """The format in which an output of this name is written. Raises GonioError, naming the endings, for others."""
    suffix = os.path.splitext(path)[1].lower()
    writers = [known for known in FORMATS if known.write is not None]
    for known in writers:
        if suffix in known.suffixes:
            return known
    *first, last = (f"{known.suffixes[0]} ({known.name})" for known in writers)
    raise GonioError(f"{path} ends in '{suffix}'; give {', '.join(first)} or {last} to say the format")


def write(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    """Writes a table in the format of the path's ending, and returns what reading it again shows to be lost.

    Raises GonioError for another ending, where `path` exists (unless `force`), and where it cannot be written.
    """
    writer = writable(path).write
    assert writer is not None
    return writer(path, table, force=force)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _refuse(head: FileHead) -> Format:
    *first, last = (known.title for known in FORMATS if known.holds == "table")
    kind = "binary" if head.binary else "text"
    raise GonioError(f"{head.path} is {kind} of an unknown kind; expected {', '.join(first)}, or {last}")
