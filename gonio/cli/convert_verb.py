"""``gonio convert``: from one format to another, with the round-trip error."""

import argparse
from pathlib import Path

from gonio.cli.arguments import add_force, add_merl_nodes, read_table, refuse_outputs
from gonio.models.errors import GonioError
from gonio.text import show


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("input", metavar="IN", help="any file that can be read")
    parser.add_argument("output", metavar="OUT", help=".h5 (gonio's HDF5), .binary (MERL) or .csv (scattered)")
    add_merl_nodes(parser)
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    from gonio.data.formats.csv import write_csv
    from gonio.data.formats.merl import write_merl
    from gonio.data.formats.round_trip import compare_cells
    from gonio.data.hdf5.writer import open_table, write_table

    suffix = Path(args.output).suffix.lower()
    if suffix not in (".h5", ".hdf5", ".nc", ".binary", ".csv"):
        raise GonioError(f"{args.output} ends in '{suffix}'; give .h5 (gonio's HDF5), .binary (MERL) or .csv")
    refuse_outputs([args.output], [args.input], args.force)
    table = read_table(args.input, args.merl_nodes)
    if suffix == ".binary":
        error = write_merl(args.output, table, force=args.force)
    elif suffix == ".csv":
        error = write_csv(args.output, table, force=args.force)
    else:
        write_table(args.output, table, force=args.force)
        error = compare_cells(table, open_table(args.output))
    show(f"{args.output}: {error}")
    return 0
