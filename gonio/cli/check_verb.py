"""``gonio check FILE|MATERIAL``: a certificate to read, and one for machines."""

import argparse
import math
from typing import Any

from gonio.checks.properties import PROPERTIES
from gonio.cli.arguments import add_force, refuse_outputs, require_range, write_text
from gonio.cli.certificate_text import print_certificate
from gonio.models.errors import GonioError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Judges reciprocity, energy conservation, positivity, symmetries and edges of a model or a table, each with"
        " the error of the judgement. Exit status: 0 pass, 1 fail, 3 undecided."
    )
    add = parser.add_argument
    add("subject", metavar="FILE|MATERIAL", nargs="?", help="a table, a material's name, or an expression")
    add(
        "--self-test", action="store_true",
        help="judge models and tables whose verdicts are known, some with mistakes; exit status 0 if all are right",
    )  # fmt: skip
    add("--strict", action="store_true", help="all properties but isotropy count")
    for name, spec in PROPERTIES.items():
        add(f"--tol-{name}", type=float, metavar="T", help=f"tolerance of {name}: {spec.unit}")
    add(
        "--feature-width", type=float, default=0.0, metavar="DEG",
        help="tables: no lobe is narrower than this, so a grid that leaves out the mirror direction may be judged",
    )  # fmt: skip
    add(
        "--level", type=float, default=0.01, metavar="P",
        help="tables with stored uncertainties: chance of calling an honest one significantly wrong (0.01)",
    )  # fmt: skip
    add("--against", metavar="FILE|MATERIAL", help="the truth, if known: agreement with it counts too")
    add(
        "--repair", metavar="OUT.h5",
        help="write the nearest table that is reciprocal and conserves energy; the exit status is then that table's",
    )  # fmt: skip
    add("--nonnegative", action="store_true", help="no reading of the repaired table is negative")
    add("--step", type=float, metavar="DEG", help="a file that is no grid (RGL's) is repaired on one of this step (5)")
    add("--json", metavar="FILE", help="write the certificate as JSON too; '-' prints it instead")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Checks, prints, writes; the exit status is the certificate's."""
    _refuse_contradictions(args)
    refuse_outputs([args.json, args.repair], [args.subject], args.force)
    if args.self_test:
        from gonio.cli.self_test_output import run_self_test

        return run_self_test(args.json, args.force)
    options: dict[str, Any] = {
        "tolerances": {name: getattr(args, f"tol_{name}") for name in PROPERTIES},
        "feature_width": math.radians(args.feature_width),
        "level": args.level,
    }
    if args.repair:
        from gonio.cli.repair_output import run_repair

        return run_repair(args, options)
    from gonio.checks.certify import check

    certificate = check(args.subject, strict=args.strict, against=args.against, **options)
    if args.json:
        write_text(args.json, certificate.to_json(), args.force)
    if args.json != "-":
        print_certificate(certificate)
    return certificate.exit_status


def _refuse_contradictions(args: argparse.Namespace) -> None:
    if args.self_test == (args.subject is not None):
        raise GonioError("give either a FILE or MATERIAL to check, or --self-test")
    require_range("--feature-width", args.feature_width, 0, 90)
    if args.repair and (args.self_test or args.against or args.strict):
        raise GonioError("--repair goes with tolerances and --json only; check what it wrote by a second command")
    if not args.repair and (args.nonnegative or args.step is not None):
        option = "--nonnegative" if args.nonnegative else "--step"
        raise GonioError(f"{option} is an option of the repair; give --repair OUT.h5 too")
