"""The options of a measurement, and where its readings go: arrays, or a file in blocks, continued where it stopped.

The provenance of the table holds all that is needed to make it again, in a form that JSON can hold.
"""

import abc
import dataclasses
import datetime
import hashlib
import os
import re
from collections.abc import Callable
from typing import Any, NamedTuple, Self, TypedDict

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from gonio.data.hdf5.writer import BlockWriter, TableHeader, open_table
from gonio.data.material import Material
from gonio.data.table import MEDIA, Table
from gonio.fitting.material_warnings import material_warnings
from gonio.instrument.instrument import Systematic
from gonio.instrument.media import media_of_measurement
from gonio.instrument.reader import BlockReadings, Reader, WorstAverage
from gonio.models.errors import GonioError
from gonio.models.expression.builder import to_expression
from gonio.text import versions

LONG_TEXT = 4000
"""Characters that the provenance keeps of a text."""
MEMORY_BYTES = 8 << 30
"""Larger tables are only written to a file, in blocks."""
MEASURED_BYTES = 32 << 20
"""Values of a table just written that are read back at once; beyond, they stay in its file."""
OLD_NAMES = {"say": "log"}
"""Of options."""


class MeasureOptions(TypedDict, total=False):
    """Keywords of `gonio.measure`; `help(gonio.measure)` describes each."""

    output: str | os.PathLike[str] | None
    seed: int
    progress: bool
    force: bool
    dtype: DTypeLike | None
    log: Callable[[str], None] | None
    command: str | None
    seconds: ArrayLike | None
    hemisphere: str | None
    lit: str | None


@dataclasses.dataclass(frozen=True)
class MeasureSettings:
    """The options of a measurement, complete and checked; see `gonio.measure`."""

    output: str | os.PathLike[str] | None = None
    seed: int = 0
    progress: bool = False
    force: bool = False
    dtype: DTypeLike | None = None
    log: Callable[[str], None] | None = None
    command: str | None = None
    seconds: ArrayLike | None = None
    hemisphere: str | None = None
    lit: str | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.seed, int | np.integer) and 0 <= self.seed < 1 << 64):
            raise GonioError(f"the seed is {self.seed!r}; give a whole number from 0 to 2^64 − 1")
        if self.dtype is not None and np.dtype(self.dtype) not in (np.float32, np.float64):
            raise GonioError(f"values of type {np.dtype(self.dtype)} cannot be stored; give float32 or float64")


class CellBlock(NamedTuple):
    """Number of a block, and the range of its cells."""

    number: int
    start: int
    stop: int


def header_of(reader: Reader, settings: MeasureSettings) -> TableHeader:
    """All of a measured table but its values."""
    layout, material = reader.layout, reader.material
    source, receiver = reader.instrument.solid_angles()
    dtype, about = np.dtype(settings.dtype or reader.dtype), provenance_of(reader, settings.command)
    return TableHeader(layout, material.channels, dtype, about, material.name, source, receiver)


class Sink(abc.ABC):
    """A context that takes the readings of blocks and makes a table of them."""

    missing: list[CellBlock]
    """Blocks that are still to be read."""
    worst: WorstAverage | None = None
    remark: str = ""
    """What a user should know before it begins."""

    def __init__(self, reader: Reader, settings: MeasureSettings) -> None:
        self.header = header_of(reader, settings)
        self.block_cells = reader.block_cells

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    @abc.abstractmethod
    def take(self, block: CellBlock, readings: BlockReadings) -> None:
        """Keeps the readings of a block."""

    @abc.abstractmethod
    def finish(self) -> Table:
        """The table, after the last block."""


class MemorySink(Sink):
    """Collects blocks in arrays."""

    def __init__(self, reader: Reader, settings: MeasureSettings) -> None:
        super().__init__(reader, settings)
        size, dtype, shape = reader.layout.size, np.dtype(self.header.dtype), self.header.shape
        need = size * reader.channels * (2 * dtype.itemsize + 1)
        if need > MEMORY_BYTES:
            raise GonioError(
                f"this table needs {need / 1e9:.0f} GB of memory; give an output, which is written in blocks"
            )
        self.arrays = {"f": np.empty(shape, dtype), "u_f": np.zeros(shape, dtype), "flag": np.empty(shape, np.uint8)}
        starts = range(0, size, self.block_cells)
        self.missing = [CellBlock(k, a, min(a + self.block_cells, size)) for k, a in enumerate(starts)]

    def take(self, block: CellBlock, readings: BlockReadings) -> None:
        for name, array in self.arrays.items():
            values = getattr(readings, name)
            if values is not None:
                array.reshape(-1, array.shape[-1])[block.start : block.stop] = values
        self.worst = WorstAverage.of(self.worst, readings.worst)

    def finish(self) -> Table:
        h = self.header
        about = h.provenance | ({} if self.worst is None else {"aperture_error": dataclasses.asdict(self.worst)})
        f, u_f, flag = self.arrays.values()
        return Table(h.layout, f, flag, h.channels, u_f, about, h.source_solid_angle, h.receiver_solid_angle, h.name)


class FileSink(Sink):
    """Writes blocks to a file, and knows which it holds already."""

    def __init__(self, reader: Reader, settings: MeasureSettings, output: str | os.PathLike[str]) -> None:
        super().__init__(reader, settings)
        recipe = recipe_of(self.header.provenance, reader.material)
        self.writer = BlockWriter(
            output, self.header, recipe, settings.force, u_f=reader.noisy, block_cells=self.block_cells
        )
        self.missing = [CellBlock(k, *self.writer.blocks[k]) for k in self.writer.missing_blocks()]
        done = len(self.writer.blocks) - len(self.missing)
        if done:
            self.remark = f"going on with {self.writer.part}: {done} of {len(self.writer.blocks)} blocks were there"
            worst = self.writer.provenance.get("aperture_error")
            self.worst = worst and WorstAverage(**worst)

    def __exit__(self, *_: object) -> None:
        """Ends the work; the file keeps its finished blocks for the next time."""
        self.writer.close()

    def take(self, block: CellBlock, readings: BlockReadings) -> None:
        worst = WorstAverage.of(self.worst, readings.worst)
        if worst is not None and worst is not self.worst:
            # Before the block is marked as written: the worst may be recorded too early, but never be lost.
            self.writer.amend({**self.writer.provenance, "aperture_error": dataclasses.asdict(worst)})
            self.worst = worst
        self.writer.write(block.number, readings.f, readings.u_f, readings.flag)

    def finish(self) -> Table:
        return open_table(self.writer.finish(), MEASURED_BYTES)


def open_sink(reader: Reader, settings: MeasureSettings) -> Sink:
    """The file of the settings, or arrays where they name none."""
    return MemorySink(reader, settings) if settings.output is None else FileSink(reader, settings, settings.output)


def provenance_of(reader: Reader, command: str | None) -> dict[str, Any]:
    """The provenance of a measurement that begins now. `command`: the way to ask for it on the command line."""
    material, layout = reader.material, reader.layout
    values = facts_of(material, command)
    values |= {
        "instrument": reader.instrument.to_dict() or "ideal",
        "scan": {"layout": layout.name, "shape": list(layout.shape)},
        "seed": reader.seed,
    }
    if not reader.counts_evenly and (reader.seconds != reader.instrument.seconds).any():
        digest = hashlib.sha256(np.ascontiguousarray(reader.seconds).tobytes()).hexdigest()
        values["counting"] = {"seconds": float(np.sum(reader.seconds)), "digest": digest}
    if reader.errors != Systematic():
        values["systematic"] = reader.errors.to_dict()
    if reader.edge_loss is not None:
        values["edge_loss"] = reader.edge_loss.to_dict()
        if sentence := reader.edge_loss.sentence(material.channels.names):
            values["warnings"] = [*values.get("warnings", []), sentence]
    if (media := media_of_measurement(reader.instrument, material.brdf, layout.sides)) is not None:
        values[MEDIA] = media
    return values


def facts_of(material: Material, command: str | None) -> dict[str, Any]:
    """What a measurement's provenance says of the material, and of when and by what it was computed."""
    values: dict[str, Any] = {
        "material": {
            "name": material.name[:LONG_TEXT],
            # In full precision: what a person wrote may hold fewer digits than the numbers of a fit.
            "spelling": to_expression(material.brdf) if material.expression is not None else None,
            "description": material.description[:LONG_TEXT],
            "source": material.source[:LONG_TEXT],
        },
        "versions": versions("jax", "numpy"),
        "computed": {"platform": jax.default_backend(), "precision": str(np.dtype(jnp.result_type(float)))},
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    if material.meta.get("file"):
        values["material"]["file"] = str(material.meta["file"])
    if command:
        values["command"] = command[:LONG_TEXT]
    if warnings := material_warnings(material):
        values["warnings"] = [warning[:LONG_TEXT] for warning in warnings]
    return values


def recipe_of(provenance: dict[str, Any], material: Material) -> dict[str, Any]:
    """What determines the values, bit for bit: the provenance but for time, with the material's own numbers."""
    kept = {name: value for name, value in provenance.items() if name not in ("created", "command", "scan")}
    leaves, structure = jax.tree.flatten(material.brdf)
    digest = hashlib.sha256(re.sub(r" at 0x[0-9a-f]+", "", str(structure)).encode())
    for values in map(np.asarray, leaves):
        digest.update(f"{values.dtype}{values.shape}".encode() + np.ascontiguousarray(values).tobytes())
    return kept | {"material": {"digest": digest.hexdigest()}}
