"""Measuring: an instrument reads a material in the directions of a scan, block by block."""

import dataclasses
import functools
import importlib.util
import os
import sys
import time
import warnings
from typing import TYPE_CHECKING, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.files import refuse_outputs
from gonio.data.layouts import Layout
from gonio.data.material import Material
from gonio.data.subject import SubjectLike, load_material
from gonio.data.table import Table
from gonio.instrument.instrument import Instrument
from gonio.instrument.reader import Reader
from gonio.instrument.scans import (
    SIDES,
    ScanOptions,
    default_hemisphere,
    default_name,
    hemisphere_remark,
    isotropy_remark,
    listed_seconds,
    mirror_remark,
    out_of_reach,
)
from gonio.instrument.scans import scan as named_scan
from gonio.instrument.sinks import OLD_NAMES, MeasureOptions, MeasureSettings, open_sink
from gonio.models.brdf import AbstractBRDF
from gonio.models.deprecation import settings_of
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from rich.progress import Progress

MAY_SHOW = {"FORCE_COLOR", "TTY_COMPATIBLE"}
"""Variables by which Rich takes what is no terminal for one."""
PATIENCE = 0.5
"""Seconds of work before a bar is shown."""


def measure(
    material: SubjectLike,
    instrument: Instrument | None = None,
    scan: Layout | str | os.PathLike[str] | None = None,
    **options: Unpack[MeasureOptions],
) -> Table:
    """Readings of a material by an instrument in the directions of a scan.

    Noise is drawn from the seed by the number of the cell: blocks, order and resumption change no bit.

    Args:
        material: any subject (see `gonio.data.subject.SubjectLike`); a table is interpolated.
        instrument: ideal by default.
        scan: a layout, such as `gonio.scan` makes, or a name or a file that it takes; by default isotropic by 5° up to
            85°, or spherical by 10° where the material is anisotropic.
        output: a file to be written in blocks, for tables of any size; the same call goes on where one was killed.
        seed: of the noise and the systematic errors, in [0, 2^64).
        progress: shows a progress bar of a long measurement, in a terminal or a notebook.
        force: replaces an existing output.
        dtype: of the stored values, float32 or float64; by default JAX's own precision.
        log: takes remarks and, at the end, the rate; without it remarks are Python warnings.
        hemisphere: of a named scan, where the detector goes: "reflection", "transmission" (behind the sample, polar
            angles beyond π/2) or "both"; by default into the hemispheres that the material scatters into.
        lit: of a named scan, the sides that the light goes to: "front" (default), "back" or "both".
        seconds: counting time of each cell (n,), or one for all; by default the column `seconds` of a file of
            directions, else the instrument's own.
        command: the way to ask for this on the command line; the provenance keeps it.

    Returns:
        The table; of an output one that reads from the file.

    Raises:
        GonioError: for an unknown material or scan, a table too large for memory, an output that exists.
        TypeError: for an option that there is not, or that the scan takes.
    """
    if misplaced := [name for name in options if name in ScanOptions.__annotations__ and name not in SIDES]:
        raise TypeError(f"{misplaced[0]} is an option of the scan; give scan=gonio.scan(NAME, {misplaced[0]}=...)")
    settings = settings_of(MeasureSettings, "measure", options, OLD_NAMES)
    log = settings.log or functools.partial(warnings.warn, stacklevel=2)
    if settings.output is not None and isinstance(material, str | os.PathLike):
        refuse_outputs([settings.output], [material], force=True)  # whether it may exist the sink decides
    logged = dataclasses.replace(settings, log=log)
    reader = open_reader(load_material(material), instrument or Instrument(), scan, logged)
    layout = reader.layout
    with open_sink(reader, settings) as sink:
        if sink.remark:
            log(sink.remark)
        for warning in sink.header.provenance.get("warnings", []):
            log(warning)
        missing = sum(block.stop - block.start for block in sink.missing)
        with CellCount(layout.size, layout.size - missing, settings.progress) as count:
            for block in sink.missing:
                sink.take(block, reader.read(block.start, block.stop))
                count.add(block.stop - block.start)
        if sink.worst is not None and sink.worst.excess > 1:
            log(sink.worst.sentence())
        table = sink.finish()
    if settings.log is not None:
        log(count.summary(reader.channels))
    return table


def open_reader(
    material: Material,
    instrument: Instrument,
    scan: Layout | str | os.PathLike[str] | None,
    settings: MeasureSettings,
) -> Reader:
    """What reads the cells of a measurement, in any order; the settings' `log` takes what a user should know first."""
    layout = _layout(scan, material.brdf, settings)
    unread = None if settings.hemisphere else hemisphere_remark(layout, material.brdf)
    unseen = None if isinstance(scan, Layout) else mirror_remark(layout)
    for remark in (isotropy_remark(layout, material.brdf), unread, out_of_reach(layout, instrument), unseen):
        if remark and settings.log is not None:
            settings.log(remark)
    seconds = settings.seconds
    if seconds is None and scan is not None and not isinstance(scan, Layout):
        seconds = listed_seconds(scan)
    return Reader(material, instrument, layout, int(settings.seed), _counting(seconds, layout))


def _layout(scan: Layout | str | os.PathLike[str] | None, brdf: AbstractBRDF, settings: MeasureSettings) -> Layout:
    """The scan, with the hemispheres of the settings or else of the material."""
    if isinstance(scan, Layout):
        if settings.hemisphere or settings.lit:
            raise GonioError("the layout says itself where light and detector go; leave hemisphere and lit out")
        return scan
    name = scan or default_name(brdf)
    return named_scan(name, hemisphere=settings.hemisphere or default_hemisphere(name, brdf), lit=settings.lit)


def _counting(seconds: ArrayLike | None, layout: Layout) -> np.ndarray | None:
    """Counting time of each cell (n,)."""
    if seconds is None:
        return None
    times = np.asarray(seconds, float)
    if times.shape not in ((), (layout.size,)) or not ((times > 0) & np.isfinite(times)).all():
        raise GonioError(f"seconds of shape {times.shape} came; give {layout.size} counting times above 0, or one")
    return np.broadcast_to(times, (layout.size,))


class CellCount:
    """A context that counts measured cells; with `bar` it shows a progress bar of a long job."""

    def __init__(self, cells: int, already: int, bar: bool) -> None:
        self.cells, self.already, self.fresh, self.started = cells, already, 0, time.perf_counter()
        self._bar = _shown_bar() if bar else None
        if self._bar is not None:
            self._task = self._bar.add_task("measuring", total=cells, completed=already, rate="")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None and self._bar.live.is_started:
            self._bar.stop()

    @property
    def seconds(self) -> float:
        """Seconds since the beginning."""
        return time.perf_counter() - self.started

    def add(self, cells: int) -> None:
        """Counts cells that have just been measured."""
        self.fresh += cells
        completed = self.already + self.fresh
        if self._bar is None:
            return
        if completed < self.cells and self.seconds > PATIENCE:
            self._bar.start()
        self._bar.update(self._task, completed=completed, rate=f"{self._rate()} cells/s")

    def summary(self, channels: int) -> str:
        """Cells, seconds and rate, as text."""
        times = f" × {channels} channels" if channels > 1 else ""
        return f"{self.fresh} cells{times} in {self.seconds:.2f} s, {self._rate()} cells/s"

    def _rate(self) -> str:
        rate = self.fresh / max(self.seconds, 1e-9)
        return f"{rate / 1e6:.3g} M" if rate >= 1e6 else f"{rate / 1e3:.3g} k" if rate >= 1e3 else f"{rate:.3g}"


def _shown_bar() -> "Progress | None":
    """A progress bar; None where nobody would see it, and Rich need not be loaded."""
    if not (sys.stderr.isatty() or MAY_SHOW & os.environ.keys() or "IPython" in sys.modules):
        return None
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    notebook = console.is_jupyter and importlib.util.find_spec("ipywidgets") is not None
    if not (console.is_terminal or notebook):
        return None
    times = (TimeElapsedColumn(), "left", TimeRemainingColumn())
    texts = ("{task.percentage:3.0f} %", "{task.fields[rate]}")
    return Progress("measuring", BarColumn(), *texts, *times, console=console, transient=True)
