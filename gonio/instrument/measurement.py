"""Measuring: an instrument goes through a scan over a material, block by block, and writes down what it read."""

import os
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gonio.data.layouts import Layout
from gonio.data.material import Material
from gonio.data.subject import SubjectLike, load_material
from gonio.data.table import Table
from gonio.data.tabulate import block_rows
from gonio.instrument import provenance
from gonio.instrument.instrument import Instrument
from gonio.instrument.progress import Progress
from gonio.instrument.reader import Reader, WorstAverage
from gonio.instrument.scans import default_name, isotropy_remark
from gonio.instrument.scans import scan as named_scan
from gonio.models.errors import GonioError

FLAT_BLOCK = 1 << 14
"""Cells of a block whose readings are averages over rays: some seconds of work at most, even for narrow lobes."""
MEMORY_BYTES = 8 << 30
"""Tables beyond this are only written to a file, in blocks."""


def measure(
    material: SubjectLike,
    instrument: Instrument | None = None,
    scan: Layout | str | os.PathLike | None = None,
    *,
    output: str | os.PathLike | None = None,
    seed: int = 0,
    progress: bool = False,
    force: bool = False,
    dtype=None,
    say: Callable[[str], None] | None = None,
    command: str | None = None,
) -> Table:
    """What `instrument` (ideal by default) reads of `material` in the directions of `scan`.

    `material`: any subject (see `gonio.data.subject.SubjectLike`). `scan`: a layout, or what `scan`
    takes; by default an isotropic scan by 5° up to 85°, or a spherical one by 10° if the material is anisotropic.
    `output`: written there in blocks, for tables of any size; where the same call was killed it goes on, and ends with
    the same bits. `dtype` is that of the stored values (float32 or float64; by default JAX's own precision). `say` is
    told what a user should know, and how fast it went; without it the former are Python warnings. `progress` shows a
    bar. `command` is how a person would ask for this; the provenance keeps it.

    Noise is drawn from `seed` by the number of the cell. Raises GonioError for an unknown material or scan, a seed
    outside [0, 2^64), a table too large for memory without an output, and an output that exists without `force`.
    """
    talk, say = say is not None, say or (lambda text: warnings.warn(text, stacklevel=3))
    material = load_material(material)
    instrument = instrument or Instrument()
    layout = _scan(scan, material)
    if not (isinstance(seed, int | np.integer) and 0 <= seed < 1 << 64):
        raise GonioError(f"the seed is {seed!r}; give a whole number from 0 to 2^64 − 1")
    if remark := isotropy_remark(layout, material.brdf):
        say(remark)
    reader = Reader(material, instrument, layout, int(seed))
    dtype = np.dtype(dtype or reader.dtype)
    if dtype not in (np.float32, np.float64):
        raise GonioError(f"values of type {dtype} cannot be stored; give float32 or float64")
    told = provenance.of(material, instrument, reader.errors, layout, int(seed), command)
    source, receiver = instrument.solid_angles()
    about = {"name": material.name, "source_solid_angle": source, "receiver_solid_angle": receiver}
    size = layout.row_size * block_rows(layout) if reader.by_rows else FLAT_BLOCK
    target = _InFile if output is not None else _InMemory
    made = target(output, layout, reader, dtype, told, about, size, force, say)
    with made as sink, Progress(layout.size, progress) as bar:
        bar.begin(layout.size - sum(stop - start for _, start, stop in sink.missing))
        for number, start, stop in sink.missing:
            f, u_f, flag, worst = reader.read(start, stop)
            sink.take(number, start, stop, f, u_f, flag, worst)
            bar.done(stop - start)
        if sink.worst is not None and sink.worst.excess > 1:
            say(sink.worst.sentence())
        table = sink.finish()
    if talk:
        say(bar.sentence(reader.channels))
    return table


def _scan(scan, material: Material) -> Layout:
    if scan is None:
        return named_scan(default_name(material.brdf))
    if isinstance(scan, Layout):
        return scan
    return named_scan(scan)


class _InMemory:
    """Collects blocks in arrays."""

    def __init__(self, _, layout, reader, dtype, told, about, size, *__):
        shape = (*layout.shape, reader.channels)
        count = layout.size * reader.channels
        need = count * (2 * dtype.itemsize + 1)
        if need > MEMORY_BYTES:
            raise GonioError(
                f"this table needs {need / 1e9:.0f} GB of memory; give an output, which is written in blocks"
            )
        self.arrays = {"f": np.empty(shape, dtype), "u_f": np.zeros(shape, dtype), "flag": np.empty(shape, np.uint8)}
        starts = range(0, layout.size, size)
        self.missing = [(k, start, min(start + size, layout.size)) for k, start in enumerate(starts)]
        self.layout, self.channels, self.told, self.about = layout, reader.material.channels, told, about
        self.worst = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def take(self, _, start, stop, f, u_f, flag, worst):
        for name, values in (("f", f), ("u_f", u_f), ("flag", flag)):
            if values is not None:
                self.arrays[name].reshape(-1, f.shape[1])[start:stop] = values
        self.worst = WorstAverage.of(self.worst, worst)

    def finish(self) -> Table:
        told = self.told if self.worst is None else {**self.told, "aperture_error": self.worst.to_dict()}
        return Table(self.layout, channels=self.channels, provenance=told, **self.arrays, **self.about)


class _InFile:
    """Writes blocks to a file, and knows which are there already."""

    def __init__(self, path, layout, reader, dtype, told, about, size, force, say):
        from gonio.data.hdf5.writer import BlockWriter

        self.path = Path(path)
        recipe = provenance.recipe(told, reader.material)
        self.writer = BlockWriter(
            path, layout, reader.material.channels, dtype, recipe, told, force,
            u_f=reader.noisy, block_cells=size, **about,
        )  # fmt: skip
        self.missing = [(k, *self.writer.blocks[k]) for k in self.writer.missing_blocks()]
        done = len(self.writer.blocks) - len(self.missing)
        self.worst = None
        if done:
            say(f"going on with {self.writer.part}: {done} of {len(self.writer.blocks)} blocks were there")
            self.worst = WorstAverage.from_dict(self.writer.provenance.get("aperture_error"))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.writer.close()

    def take(self, number, start, stop, f, u_f, flag, worst):
        found = WorstAverage.of(self.worst, worst)
        if found is not self.worst:
            # Before the block is marked as written: the worst may be said too early, but never be lost.
            self.writer.amend({**self.writer.provenance, "aperture_error": found.to_dict()})
            self.worst = found
        self.writer.write(number, f, u_f, flag)

    def finish(self) -> Table:
        from gonio.data.hdf5.writer import open_table

        return open_table(self.writer.finish())
