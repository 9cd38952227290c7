"""``gonio reduce``: the coarsest table that a scene's tolerance allows, with its error against the whole one."""

import argparse
from pathlib import Path

from gonio.cli.arguments import FORCE, MERL, READING, Options, add_options, read_table, write_json
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.text import log, number, show

OPTIONS: Options = {
    "--scene S": {"required": True, "help": "a scene's file, or a shipped scene's name"},
    "-o/--output OUT.h5": {"required": True, "help": "the reduced table"},
    "--tolerance SHARE": "in place of the scene's own, such as 0.05",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("table", metavar="TABLE", help="a table in any format that can be read")
    add_options(parser.add_argument, OPTIONS | MERL | READING | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.files import refuse_outputs

    refuse_outputs([args.output], [args.table, args.scene], args.force)
    if Path(args.output).suffix.lower() not in (".h5", ".hdf5", ".nc"):
        raise GonioError(f"{args.output} is not an HDF5 name; a reduced table is gonio's HDF5, so let it end in .h5")
    if args.tolerance is not None and not 0 < args.tolerance < 1:
        raise GonioError(f"--tolerance is {args.tolerance:g}; expected a share above 0 and below 1, such as 0.05")
    from gonio.data.hdf5.writer import write_table
    from gonio.data.reduction.coarsest_table import reduce_table
    from gonio.data.scene import load_scene

    scene = load_scene(args.scene)
    table = read_table(args.table, args, blockwise=True)
    reduced = reduce_table(table, scene, args.tolerance, log)
    write_table(args.output, reduced.table, force=args.force)
    before, after = (Path(p).stat().st_size for p in (args.table, args.output))
    show(f"{table.name} in the scene '{scene.name}':")
    show(f"error of the radiance {percent(reduced.error, 3)} of its rms against the whole table")
    show(reduced.promise())
    for sentence in reduced.left_out:
        show(f"left out: {sentence}")
    ratio = number(before / after, 3)
    show(f"{reduced.cells[0]} readings became {reduced.cells[1]}, {before} bytes {after}: {ratio} times less")
    show(f"written: {args.output}")
    facts = {key: getattr(reduced, key) for key in ("error", "promised", "tolerance", "left_out", "keeps")}
    facts |= {"scene": scene.name, "readings": list(reduced.cells), "bytes": [before, after], "written": args.output}
    return write_json(args, facts, reduced.exit_status)
