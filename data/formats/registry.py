"""Any file that gonio can read, known by what is in it, not by its name."""

import os

from gonio.data.files import input_size
from gonio.data.formats import bbm_fits as published
from gonio.data.formats import csv as csv_table
from gonio.data.formats import merl, tensor_file
from gonio.data.formats import nist_ptfe as nist
from gonio.data.formats.csv_columns import CsvText
from gonio.data.table import Table
from gonio.models.errors import GonioError

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
KINDS = ("HDF5", "MERL", "RGL", "NIST", "CSV")


def sniff(path: str | os.PathLike) -> str:
    """Which of `KINDS` a file is. Raises GonioError, in one sentence, where it is none of them or cannot be read."""
    _refuse_published(path)
    size = input_size(path)
    with open(path, "rb") as file:
        start = file.read(4096)
    if start.startswith(HDF5_SIGNATURE):
        return "HDF5"
    if start.startswith(tensor_file.MAGIC):
        return "RGL"
    if merl.header_counts(start, size) or merl.looks_like_merl(start):
        return "MERL"
    if b"\0" in start and os.fspath(path).lower().endswith(".binary"):
        return "MERL"  # whose reader says what its header claims
    if b"\0" in start:
        _unknown(path, "binary")
    names = CsvText(path, limit=1 << 16).names
    if nist.looks_like_nist(names):
        return "NIST"
    if csv_table.looks_like_csv(names):
        return "CSV"
    if len(names) > 1 and not _number(names[0]):
        csv_table.read_directions(path)  # says which columns are missing
    return _unknown(path, "text")


def read(path: str | os.PathLike, **options) -> Table:
    """The table of a file: gonio's HDF5, MERL, RGL, NIST's PTFE CSV or plain CSV.

    Options: `nodes` ("lower" or "centre") for MERL, `wavelength_nm` for NIST. Raises GonioError for a file
    that is damaged or unknown, and for an option that its format does not have.
    """
    kind = sniff(path)
    allowed = {"MERL": {"nodes"}, "NIST": {"wavelength_nm"}}.get(kind, set())
    if unknown := sorted(set(options) - allowed):
        raise GonioError(f"{path} is a {kind} file, which has no option {unknown[0]!r}; leave it out")
    if kind == "HDF5":
        from gonio.data.hdf5.writer import open_table

        return open_table(path)
    if kind == "RGL":
        from gonio.data.formats.rgl_file import read_rgl

        return read_rgl(path)
    return {"MERL": merl.read_merl, "NIST": nist.read_nist, "CSV": csv_table.read_csv}[kind](path, **options)


def _refuse_published(path) -> None:
    # Published fits are models: a table can be measured of one of them.
    file, sign, _ = os.fspath(path).partition(published.SUFFIX + ":")
    if sign and not os.path.exists(path):
        raise GonioError(f"{path} is a model, not a table; measure it first: gonio measure '{path}' -o T.h5")
    if not sign and file.endswith(published.SUFFIX):
        first = published.published_names(path)[0]
        raise GonioError(f"{path} holds published fits; name one of them, as in '{path}:{first}' (see gonio info)")


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _unknown(path, what: str):
    raise GonioError(
        f"{path} is {what} of an unknown kind; expected a table of gonio (HDF5), MERL .binary, RGL .bsdf, "
        "NIST's PTFE CSV, or CSV with a header (theta_i,phi_i,theta_o,phi_o,f)"
    )
