"""Where readings go: arrays in memory, or a file that is written in blocks and continued where it was stopped."""

import abc
import os
from typing import Any, NamedTuple, Self

import numpy as np

from gonio.data.hdf5.writer import BlockWriter, TableHeader, open_table
from gonio.data.table import Table
from gonio.data.tabulate import block_rows
from gonio.instrument import provenance
from gonio.instrument.options import MeasureSettings
from gonio.instrument.reader import BlockReadings, Reader, WorstAverage
from gonio.models.errors import GonioError

FLAT_BLOCK = 1 << 14
"""Cells of a block whose readings are averages over rays: some seconds of work at most, even for narrow lobes."""
MEMORY_BYTES = 8 << 30
"""Larger tables are only written to a file, in blocks."""


class CellBlock(NamedTuple):
    """Number of a block, and the range of its cells."""

    number: int
    start: int
    stop: int


class Sink(abc.ABC):
    """A context that takes the readings of blocks and makes a table of them."""

    missing: list[CellBlock]
    """Blocks that are still to be read."""
    worst: WorstAverage | None = None
    remark: str = ""
    """What a user should know before it begins."""

    def __init__(self, reader: Reader, settings: MeasureSettings):
        self.reader = reader
        self.dtype = np.dtype(settings.dtype or reader.dtype)
        self.provenance = provenance.of(reader, settings.command)
        source, receiver = reader.instrument.solid_angles()
        self.metadata: dict[str, Any] = {
            "name": reader.material.name, "source_solid_angle": source, "receiver_solid_angle": receiver,
        }  # fmt: skip
        layout = reader.layout
        self.block_cells = layout.row_size * block_rows(layout) if reader.by_rows else FLAT_BLOCK

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

    def __init__(self, reader: Reader, settings: MeasureSettings):
        super().__init__(reader, settings)
        layout = reader.layout
        shape = (*layout.shape, reader.channels)
        need = layout.size * reader.channels * (2 * self.dtype.itemsize + 1)
        if need > MEMORY_BYTES:
            raise GonioError(
                f"this table needs {need / 1e9:.0f} GB of memory; give an output, which is written in blocks"
            )
        self.f, self.u_f, self.flag = (
            np.empty(shape, self.dtype),
            np.zeros(shape, self.dtype),
            np.empty(shape, np.uint8),
        )
        starts = range(0, layout.size, self.block_cells)
        self.missing = [CellBlock(k, a, min(a + self.block_cells, layout.size)) for k, a in enumerate(starts)]

    def take(self, block: CellBlock, readings: BlockReadings) -> None:
        for array, values in ((self.f, readings.f), (self.u_f, readings.u_f), (self.flag, readings.flag)):
            if values is not None:
                array.reshape(-1, self.reader.channels)[block.start : block.stop] = values
        self.worst = WorstAverage.of(self.worst, readings.worst)

    def finish(self) -> Table:
        about = {} if self.worst is None else {"aperture_error": self.worst.to_dict()}
        return Table(
            self.reader.layout, self.f, self.flag, self.reader.material.channels, self.u_f, self.provenance | about,
            **self.metadata,
        )  # fmt: skip


class FileSink(Sink):
    """Writes blocks to a file, and knows which it holds already."""

    def __init__(self, reader: Reader, settings: MeasureSettings, output: str | os.PathLike[str]):
        super().__init__(reader, settings)
        recipe = provenance.recipe(self.provenance, reader.material)
        header = TableHeader(reader.layout, reader.material.channels, self.dtype, self.provenance, **self.metadata)
        self.writer = BlockWriter(
            output, header, recipe, settings.force, u_f=reader.noisy, block_cells=self.block_cells
        )
        self.missing = [CellBlock(k, *self.writer.blocks[k]) for k in self.writer.missing_blocks()]
        done = len(self.writer.blocks) - len(self.missing)
        if done:
            self.remark = f"going on with {self.writer.part}: {done} of {len(self.writer.blocks)} blocks were there"
            self.worst = WorstAverage.from_dict(self.writer.provenance.get("aperture_error"))

    def __exit__(self, *_: object) -> None:
        """Ends the work; the file keeps its finished blocks for the next time."""
        self.writer.close()

    def take(self, block: CellBlock, readings: BlockReadings) -> None:
        worst = WorstAverage.of(self.worst, readings.worst)
        if worst is not None and worst is not self.worst:
            # Before the block is marked as written: the worst may be recorded too early, but never be lost.
            self.writer.amend({**self.writer.provenance, "aperture_error": worst.to_dict()})
            self.worst = worst
        self.writer.write(block.number, readings.f, readings.u_f, readings.flag)

    def finish(self) -> Table:
        return open_table(self.writer.finish())


def open_sink(reader: Reader, settings: MeasureSettings) -> Sink:
    """The file of the settings, or arrays where they name none."""
    return MemorySink(reader, settings) if settings.output is None else FileSink(reader, settings, settings.output)
