"""Measuring: an instrument reads a material in the directions of a scan, block by block."""

import os
import warnings
from typing import Unpack

from gonio.data.layouts import Layout
from gonio.data.subject import SubjectLike, load_material
from gonio.data.table import Table
from gonio.instrument.instrument import Instrument
from gonio.instrument.options import OLD_NAMES, MeasureOptions, MeasureSettings
from gonio.instrument.progress import CellCount
from gonio.instrument.reader import Reader
from gonio.instrument.scans import default_name, isotropy_remark
from gonio.instrument.scans import scan as named_scan
from gonio.instrument.sinks import open_sink
from gonio.models.brdf import AbstractBRDF
from gonio.models.deprecation import settings_of


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
        scan: a layout, or a name or a file that `gonio.instrument.scan` takes; by default isotropic by 5° up to 85°,
            or spherical by 10° where the material is anisotropic.
        output: a file to be written in blocks, for tables of any size; the same call goes on where one was killed.
        seed: of the noise and the systematic errors, in [0, 2^64).
        progress: shows a progress bar of a long measurement, in a terminal or a notebook.
        force: replaces an existing output.
        dtype: of the stored values, float32 or float64; by default JAX's own precision.
        log: takes remarks and, at the end, the rate; without it remarks are Python warnings.
        command: the way to ask for this on the command line; the provenance keeps it.

    Returns:
        The table; of an output one that reads from the file.

    Raises:
        GonioError: for an unknown material or scan, a table too large for memory, an output that exists.
    """
    settings = settings_of(MeasureSettings, "measure", options, OLD_NAMES)
    log = settings.log or _warn
    subject = load_material(material)
    layout = _layout(scan, subject.brdf)
    if remark := isotropy_remark(layout, subject.brdf):
        log(remark)
    reader = Reader(subject, instrument or Instrument(), layout, int(settings.seed))
    with open_sink(reader, settings) as sink:
        if sink.remark:
            log(sink.remark)
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


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=3)


def _layout(scan: Layout | str | os.PathLike[str] | None, brdf: AbstractBRDF) -> Layout:
    if isinstance(scan, Layout):
        return scan
    return named_scan(default_name(brdf) if scan is None else scan)
