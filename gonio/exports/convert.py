"""Any subject into a file of another format, or into the nearest expression of a renderer."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from gonio.data.formats.registry import writable, write
from gonio.data.round_trip import RoundTrip
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.exports.settings import ConvertOptions, ConvertSettings
from gonio.exports.targets import canonical, target_of
from gonio.models.deprecation import settings_of

if TYPE_CHECKING:
    from gonio.exports.reexpression import ReExpression


def convert(
    subject: SubjectLike, path: str | os.PathLike[str], to: str | None = None, **options: Unpack[ConvertOptions]
) -> "RoundTrip | ReExpression":
    """Writes a subject in the format of the path's ending, or as the nearest expression of a renderer.

    A table, or a model where the format holds models (.bsdf, .binary), is written in a format of samples. For a
    renderer a surface is said exactly where the renderer has it, else by the numbers for which the renderer's own BRDF
    is nearest to it; a table is fitted first.

    Args:
        subject: any subject (see `gonio.data.subject.SubjectLike`).
        path: the file.
        to: "mitsuba", "pbrt", "materialx", "gltf", "blender" or "radiance" (a matrix over the Klems patches), or the
            name of a format; needed where its ending is that of others too.
        force: replaces an existing file.
        ascii: values of an .ssdd file as text, at full precision; else in single precision.
        channel_bytes: of a .bsdf file: of the samples of one channel, of an anisotropic surface those of each azimuth
            of the light; by default 16384, as published.
        part: of a Zemax file: "reflection" or "transmission".
        channel: of a Zemax or Klems file: the only channel to write.
        step: of a Zemax or Speos file that is sampled: degrees between its angles, by default 5 and 2.
        basis: of a Klems file: "full" (default), "half" or "quarter".
        model: the expression that is fitted to a table; by default it is selected.
        measured: for Mitsuba and pbrt: the surface as data in an RGL file beside `path`, to which that refers.
        tolerance: of a renderer: refuses an expression whose relative rms or difference of albedo is larger.
        log: called with a line for what takes long.

    Returns:
        What reading the file again shows to be lost; for a renderer the errors of its expression.

    Raises:
        GonioError: another ending or name, a model for a format of readings, a surface without a colour, an expression
            beyond the tolerance, a path that exists or cannot be written.
    """
    settings = settings_of(ConvertSettings, "convert", options)
    target, to = target_of(path, to), canonical(to)
    if target is None:
        settings.refuse_for_tables(path)
        writable(path, to)  # refuses other endings, before any work
        resolved = resolve_subject(subject)
        return write(path, resolved.material or resolved.require_table(), settings.force, to, **settings.of_samples)
    from gonio.exports.renderer_file import write_for_renderer

    return write_for_renderer(resolve_subject(subject), Path(path), target, settings)
