"""A large table measured in parts, each a task of its own, and put together into the file that one task would write."""

import dataclasses
import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gonio.campaigns.choices import USUAL_SCAN
from gonio.campaigns.store import PART, Store
from gonio.data.hdf5.writer import write_cells
from gonio.data.layouts import Layout
from gonio.data.subject import load_material
from gonio.instrument.measurement import open_reader
from gonio.instrument.reader import BlockReadings, Reader, WorstAverage
from gonio.instrument.scans import default_hemisphere, default_name, listed_seconds, scan
from gonio.instrument.sinks import MeasureSettings, header_of
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError

PART_VALUES = 1 << 22
"""Values of one part, cells times channels: some 70 MB, and seconds of work. A table of twice as many is cut."""
CELLS = ("f", "u_f", "flag")


def layout_of(brdf: AbstractBRDF, options: dict[str, Any]) -> Layout:
    """The layout of a recipe's scan over a material."""
    given = dict(options)
    name = scan_name(brdf, given.pop("name"))
    given.setdefault("hemisphere", default_hemisphere(name, brdf))
    return scan(name, **given)


def scan_name(brdf: AbstractBRDF, name: str) -> str:
    """The name of a scan, or of that which the material takes by default."""
    return default_name(brdf) if name == USUAL_SCAN else name


def part_ranges(layout: Layout, channels: int) -> list[tuple[int, int]]:
    """Ranges of cells (start, stop) of a table's parts, whole rows of the layout; one where the table is small."""
    if layout.size * channels < 2 * PART_VALUES:
        return [(0, layout.size)]
    cells = max(1, PART_VALUES // (layout.row_size * channels)) * layout.row_size
    return [(start, min(start + cells, layout.size)) for start in range(0, layout.size, cells)]


def read_part(inputs: dict[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """(row of its record, values of its cells (n, channels) by name) of a part of a table."""
    reader = _reader(inputs, [])
    start, stop = inputs["cells"]
    edges = [*range(start, stop, reader.block_cells), stop]
    blocks = [reader.read(a, b) for a, b in itertools.pairwise(edges)]
    values = {name: np.concatenate([_values(block, name, reader.dtype) for block in blocks]) for name in CELLS}
    worst = _worst([block.worst for block in blocks])
    u_f = values["u_f"]
    alike = 0.0 if not u_f.any() else "unknown" if np.isnan(u_f).all() else None
    return {"worst": worst and dataclasses.asdict(worst), "u_f": alike}, values


def assembled(inputs: dict[str, Any], store: Store) -> tuple[dict[str, Any], Callable[[Path], None]]:
    """(row of its record, what writes it) of a table whose parts are there. Raises LostPart where one is not."""
    remarks: list[str] = []
    reader = _reader(inputs, remarks)
    records = [store.record(key) for key in inputs["parts"]]
    rows = [record.row for record in records if record is not None]
    if len(rows) < len(records):
        raise LostPart(f"a part of a table is gone from {store.folder}")
    header = header_of(reader, MeasureSettings())
    about = without_place(header.provenance)
    worst = _worst([row["worst"] and WorstAverage(**row["worst"]) for row in rows])
    remarks += about.get("warnings", [])
    if worst is not None:
        about["aperture_error"] = dataclasses.asdict(worst)
        remarks += [worst.sentence()] if worst.excess > 1 else []
    header = dataclasses.replace(header, provenance=about)
    alike = {row["u_f"] for row in rows}  # what is the same everywhere takes no room, as in `write_table`
    uncertainty = {0.0: 0.0, "unknown": float("nan"), None: None}[alike.pop() if len(alike) == 1 else None]

    def write(path: Path) -> None:
        write_cells(path, header, uncertainty, _stored(inputs["parts"], store))

    row = {"readings": reader.layout.size, "channels": reader.channels, "remarks": "; ".join(remarks)}
    return row, write


class LostPart(GonioError):
    """A part of a table that was there is not any more."""


def without_place(provenance: dict[str, Any]) -> dict[str, Any]:
    """A provenance without the time, and the material's file by its name: in which folder it lies changes nothing."""
    material = dict(provenance["material"])
    if "file" in material:
        material["file"] = os.path.basename(material["file"])
    return {name: value for name, value in provenance.items() if name != "created"} | {"material": material}


def _reader(inputs: dict[str, Any], remarks: list[str]) -> Reader:
    """What reads the table of a task, cell by cell; `remarks` takes what a user should know."""
    material = load_material(Path(inputs["material"]) if inputs["file"] else inputs["material"])
    seconds = listed_seconds(scan_name(material.brdf, inputs["scan"]["name"]))
    settings = MeasureSettings(seed=inputs["seed"], seconds=seconds, log=remarks.append)
    return open_reader(material, inputs["instrument"], layout_of(material.brdf, inputs["scan"]), settings)


def _worst(averages: Sequence[WorstAverage | None]) -> WorstAverage | None:
    worst: WorstAverage | None = None
    for average in averages:
        worst = WorstAverage.of(worst, average)
    return worst


def _values(block: BlockReadings, name: str, dtype: np.dtype) -> np.ndarray:
    values = getattr(block, name)
    if values is None:
        return np.zeros(block.f.shape, dtype)
    return values if name == "flag" else values.astype(dtype, copy=False)


def _stored(parts: Sequence[str], store: Store) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    start = 0
    for key in parts:
        with np.load(store.path(PART, key), allow_pickle=False) as file:
            values = {name: file[name] for name in CELLS}
        yield start, values
        start += len(values["f"])
