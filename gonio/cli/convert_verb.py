"""``gonio convert``: from one format to another, with the round-trip error."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("input", metavar="IN", help="any file that can be read")
    parser.add_argument("output", metavar="OUT", help=".h5 (gonio's HDF5), .binary (MERL) or .csv (scattered)")
    parser.add_argument("--merl-nodes", choices=("lower", "centre"), help="where a MERL file's nodes lie in their bins")
    parser.add_argument("--force", action="store_true", help="replace an existing output")


def run(args: argparse.Namespace) -> int:
    from pathlib import Path

    from gonio.data.files import refuse_existing, refuse_input
    from gonio.data.formats.csv import write_csv
    from gonio.data.formats.merl import write_merl
    from gonio.data.formats.registry import read
    from gonio.data.formats.round_trip import compare_cells
    from gonio.data.hdf5.writer import open_table, write_table
    from gonio.models.errors import GonioError
    from gonio.text import say

    suffix = Path(args.output).suffix.lower()
    if suffix not in (".h5", ".hdf5", ".nc", ".binary", ".csv"):
        raise GonioError(
            f"{args.output} ends in '{suffix}'; give .h5 (gonio's HDF5), .binary (MERL) or .csv to say the format."
        )
    refuse_existing(args.output, args.force)
    refuse_input(args.output, args.input)
    table = read(args.input, **({"nodes": args.merl_nodes} if args.merl_nodes else {}))
    if suffix == ".binary":
        error = write_merl(args.output, table, force=args.force)
    elif suffix == ".csv":
        error = write_csv(args.output, table, force=args.force)
    else:
        write_table(args.output, table, force=args.force)
        error = compare_cells(table, open_table(args.output))
    say(f"{args.output}: {error}")
    return 0
