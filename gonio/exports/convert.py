"""Any subject into a file of another format."""

import os
from typing import Any

from gonio.data.formats.registry import writable, write
from gonio.data.round_trip import RoundTrip
from gonio.data.subject import SubjectLike, resolve_subject


def convert(
    subject: SubjectLike,
    path: str | os.PathLike[str],
    to: str | None = None,
    force: bool = False,
    channel_bytes: int | None = None,
) -> RoundTrip:
    """Writes a table, or a model where the format holds models, in the format of the path's ending, or the named one.

    Args:
        subject: any subject (see `gonio.data.subject.SubjectLike`).
        path: ends in .h5, .bsdf, .binary or .csv, or as the format `to` asks.
        to: the format's name, in any case: needed where several formats have one ending.
        force: replaces an existing file.
        channel_bytes: of a .bsdf file: of the samples of one channel, of an anisotropic surface those of each azimuth
            of the light; by default 16384, as published.

    Returns:
        What reading the file again shows to be lost.

    Raises:
        GonioError: another ending or name, a model for a format of readings, a path that exists or cannot be written.
    """
    writable(path, to)  # refuses other endings, before any work
    resolved = resolve_subject(subject)
    options: dict[str, Any] = {} if channel_bytes is None else {"channel_bytes": channel_bytes}
    return write(path, resolved.material or resolved.require_table(), force, to, **options)
