"""``gonio convert``: from one format to another, with the round-trip error."""

import argparse

from gonio.cli.arguments import FORCE, MERL, READING, add_options, read_table
from gonio.text import show


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("input", metavar="IN", help="any file that can be read")
    parser.add_argument("output", metavar="OUT", help=".h5 (gonio's HDF5), .binary (MERL) or .csv")
    add_options(parser.add_argument, MERL | READING | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.formats.registry import writable, write

    writable(args.output)  # refuses other endings, before any work
    from gonio.data.files import refuse_outputs

    refuse_outputs([args.output], [args.input], args.force)
    error = write(args.output, read_table(args.input, args), force=args.force)
    show(f"{args.output}: {error}")
    return 0
