"""``gonio convert``: from one format to another, or a model into a file of samples, with the round-trip error."""

import argparse

from gonio.cli.arguments import FORCE, MERL, READING, Options, add_options, given, reading_options
from gonio.text import log, show

RGL: Options = {
    "--channel-bytes N": "of one channel's samples in a .bsdf file (default 16384, as published), of an anisotropic "
    "surface those of each azimuth of the light"
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "input", metavar="IN", help="any file that can be read; for .bsdf and .binary any model too (a reference "
        "material, an expression, a fit)"
    )  # fmt: skip
    parser.add_argument("output", metavar="OUT", help=".h5 (gonio's HDF5), .bsdf (RGL), .binary (MERL) or .csv")
    add_options(parser.add_argument, MERL | READING | RGL | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.formats.registry import writable, write

    writable(args.output)  # refuses other endings, before any work
    from gonio.data.files import refuse_outputs
    from gonio.data.subject import resolve_subject

    refuse_outputs([args.output], [args.input], args.force)
    subject = resolve_subject(args.input, **reading_options(args))
    source = subject.material or subject.require_table()
    warnings: list[str] = [] if subject.table is None else subject.table.provenance.get("warnings", [])
    for warning in warnings:
        log(f"gonio: {args.input}: {warning}")
    error = write(args.output, source, force=args.force, **given(args, "channel_bytes"))
    show(f"{args.output}: {error}")
    return 0
