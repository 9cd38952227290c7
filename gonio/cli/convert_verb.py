"""``gonio convert``: from one format to another, or a model into a file of samples, with the round-trip error."""

import argparse

from gonio.cli.arguments import FORCE, MERL, READING, Options, add_options, given, reading_options
from gonio.text import log, show

OPTIONS: Options = {
    "--to NAME": "the format to write, where OUT's ending leaves it open",
    "--channel-bytes N": "of one channel's samples in a .bsdf file (default 16384, as published), of an anisotropic "
    "surface those of each azimuth of the light",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "input", metavar="IN", help="any file that can be read; for .bsdf and .binary any model too (a reference "
        "material, an expression, a fit)"
    )  # fmt: skip
    parser.add_argument(
        "output",
        metavar="OUT",
        help=".h5 (gonio's HDF5), .bsdf (RGL), .binary (MERL) or .csv; '-' prints CSV, or what --to names",
    )
    add_options(parser.add_argument, MERL | READING | OPTIONS | FORCE)


def streamed(args: argparse.Namespace) -> str:
    """The ending of the format that is printed: CSV, or the one that is named. Raises GonioError where it is binary."""
    from gonio.data.formats.registry import targets

    known = targets().get((args.to or "CSV").casefold())
    return known.suffixes[0] if known is not None and known.suffixes else ".csv"


def run(args: argparse.Namespace) -> int:
    from gonio.data.formats.registry import writable

    writable(args.output, args.to)  # refuses other endings, before any work
    from gonio.data.files import refuse_outputs
    from gonio.data.subject import resolve_subject
    from gonio.exports.convert import convert

    refuse_outputs([args.output], [args.input], args.force)
    subject = resolve_subject(args.input, **reading_options(args))
    warnings: list[str] = [] if subject.table is None else subject.table.provenance.get("warnings", [])
    for warning in warnings:
        log(f"gonio: {args.input}: {warning}")
    error = convert(subject, args.output, args.to, args.force, **given(args, "channel_bytes"))
    show(f"{args.output}: {error}")
    return 0
