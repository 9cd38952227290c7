"""``gonio reduce``: the coarsest table that a scene's tolerance allows, with its error against the whole one."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("table", metavar="TABLE", help="a table in any format that can be read")
    parser.add_argument("--scene", required=True, metavar="S", help="a scene's file, or a shipped scene's name")
    parser.add_argument("-o", "--output", required=True, metavar="OUT.h5", help="the reduced table")
    parser.add_argument("--tolerance", type=float, metavar="SHARE", help="in place of the scene's own, such as 0.05")
    parser.add_argument("--merl-nodes", choices=("lower", "centre"), help="where a MERL file's nodes lie in their bins")
    parser.add_argument("--force", action="store_true", help="replace an existing output")


def run(args: argparse.Namespace) -> int:
    from pathlib import Path

    from gonio.data.files import refuse_existing, refuse_input
    from gonio.models.errors import GonioError
    from gonio.text import number, say, tell

    refuse_existing(args.output, args.force)
    refuse_input(args.output, args.table, args.scene)
    if Path(args.output).suffix.lower() not in (".h5", ".hdf5", ".nc"):
        raise GonioError(f"{args.output} is not an HDF5 name; a reduced table is gonio's HDF5, so let it end in .h5")
    if args.tolerance is not None and not 0 < args.tolerance < 1:
        raise GonioError(f"--tolerance is {args.tolerance:g}; expected a share above 0 and below 1, such as 0.05")
    from gonio.data.formats.registry import read
    from gonio.data.hdf5.writer import write_table
    from gonio.data.reduction.coarsest_table import reduce_table
    from gonio.data.scene import load_scene

    scene = load_scene(args.scene)
    table = read(args.table, **({"nodes": args.merl_nodes} if args.merl_nodes else {}))
    table.name = table.name or Path(args.table).stem
    found = reduce_table(table, scene, args.tolerance, say=tell)
    write_table(args.output, found.table, force=args.force)
    before, after = (Path(p).stat().st_size for p in (args.table, args.output))
    say(f"{table.name} in the scene '{scene.name}':")
    say(
        f"error of the reflected radiance {number(100 * found.error, 3)} % of its rms "
        f"(tolerance {number(100 * found.tolerance, 3)} %), measured against the whole table"
    )
    for words in found.left_out:
        say(f"left out: {words}")
    less = number(before / after, 3)
    say(f"{found.cells[0]} readings became {found.cells[1]}, {before} bytes {after}: {less} times less")
    say(f"written: {args.output}")
    return 0
