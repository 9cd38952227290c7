"""``gonio eval``: values of a material at any directions, as CSV."""

import argparse
import io

from gonio.cli.arguments import FORCE, MATERIAL, READING, Options, add_options, as_stated, write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("material", metavar="MATERIAL", help=MATERIAL)
    columns = "columns theta_i,phi_i,theta_o,phi_o in degrees, or wi_x,wi_y,wi_z,wo_x,wo_y,wo_z"
    options: Options = {
        "--directions DIRS.csv": {"required": True, "help": columns},
        "-o/--output OUT.csv": {"default": "-", "help": "default: standard output"},
    }
    add_options(parser.add_argument, options | READING | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.files import refuse_outputs

    refuse_outputs([args.output], [args.directions, args.material], args.force)
    import numpy as np

    from gonio.data.formats.csv import read_directions
    from gonio.data.formats.csv_columns import write_columns
    from gonio.data.formats.registry import is_there, sniff
    from gonio.data.subject import load_material
    from gonio.models.evaluation import evaluate

    wi, wo, columns = read_directions(args.directions, args.angles)
    if not (is_there(args.material) and "angles" in sniff(args.material).options):
        args.angles = None  # they are the directions' own
    f = np.asarray(evaluate(load_material(as_stated(args.material, args)).brdf, wi, wo))
    columns |= {"f": f} if f.ndim == 1 else {f"f_{c + 1}": f[:, c] for c in range(f.shape[1])}
    text = io.StringIO()
    write_columns(text, columns)
    write_text(args.output, text.getvalue(), args.force)
    return 0
