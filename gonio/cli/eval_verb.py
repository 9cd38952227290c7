"""``gonio eval``: values of a material at any directions, as CSV."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("material", metavar="MATERIAL", help="a reference material, a readable file or an expression")
    parser.add_argument(
        "--directions",
        required=True,
        metavar="DIRS.csv",
        help="columns theta_i,phi_i,theta_o,phi_o in degrees, or wi_x,wi_y,wi_z,wo_x,wo_y,wo_z",
    )
    parser.add_argument("-o", "--output", metavar="OUT.csv", help="where to write; standard output if not given")
    parser.add_argument("--force", action="store_true", help="replace an existing output")


def run(args: argparse.Namespace) -> int:
    import sys

    from gonio.data.files import new_file, refuse_existing, refuse_input
    from gonio.data.formats.csv import read_directions
    from gonio.data.formats.csv_columns import write_columns
    from gonio.data.subject import load_material

    if args.output:
        refuse_existing(args.output, args.force)
        refuse_input(args.output, args.directions, args.material)
    wi, wo, columns = read_directions(args.directions)
    material = load_material(args.material)
    columns |= _values(material, wi, wo)
    if args.output is None:
        write_columns(sys.stdout, columns)
        return 0
    with new_file(args.output, args.force) as path, open(path, "w", encoding="utf-8") as file:
        write_columns(file, columns)
    return 0


def _values(material, wi, wo) -> dict:
    import numpy as np

    from gonio.models.evaluation import evaluate

    f = np.asarray(evaluate(material.brdf, wi, wo))
    if f.ndim == 1:
        return {"f": f}
    return {f"f_{c + 1}": f[:, c] for c in range(f.shape[1])}
