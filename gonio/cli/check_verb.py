"""``gonio check FILE|MATERIAL``: a certificate to read, and one for machines."""

import math
import sys


def add_arguments(parser) -> None:
    """The arguments of the verb."""
    parser.description = (
        "Judges reciprocity, energy conservation, positivity, symmetries and edges of a model or a table, each with"
        " the error of the judgement. Exit status: 0 pass, 1 fail, 3 undecided."
    )
    parser.add_argument(
        "subject", metavar="FILE|MATERIAL", nargs="?", help="a table, a material's name, or an expression"
    )
    parser.add_argument(
        "--self-test",
        action="store_true",
        help="judge liars, mutants and honest subjects whose verdicts are known; exit status 0 only if all are right",
    )
    parser.add_argument("--strict", action="store_true", help="all properties but isotropy count")
    for name, unit in (
        ("reciprocity", "relative difference"),
        ("energy", "albedo above 1"),
        ("positivity", "negative part"),
        ("symmetry", "relative difference"),
        ("isotropy", "relative difference"),
        ("pole", "relative difference"),
        ("horizon", "share of the flux, or e-folds"),
        ("agreement", "relative difference"),
    ):
        parser.add_argument(f"--tol-{name}", type=float, metavar="T", help=f"tolerance of {name}: {unit}")
    parser.add_argument(
        "--feature-width",
        type=float,
        default=0.0,
        metavar="DEG",
        help="tables: no lobe is narrower than this, so a grid that leaves out the mirror direction may be judged",
    )
    parser.add_argument(
        "--level",
        type=float,
        default=0.01,
        metavar="P",
        help="tables with stored uncertainties: chance of calling an honest one significantly wrong (0.01)",
    )
    parser.add_argument("--against", metavar="FILE|MATERIAL", help="the truth, if known: agreement with it counts too")
    parser.add_argument(
        "--repair",
        metavar="OUT.h5",
        help="write the nearest table that is reciprocal and conserves energy; the exit status is then that table's",
    )
    parser.add_argument("--nonnegative", action="store_true", help="no reading of the repaired table is negative")
    parser.add_argument(
        "--step", type=float, metavar="DEG", help="a file that is no grid (RGL's) is repaired on one of this step (5)"
    )
    parser.add_argument("--json", metavar="FILE", help="write the certificate as JSON too; '-' prints it instead")
    parser.add_argument("--force", action="store_true", help="replace an existing FILE")


def run(args) -> int:
    """Checks, prints, writes; the exit status is the certificate's."""
    from gonio.data.files import refuse_existing
    from gonio.models.errors import GonioError

    if args.self_test == (args.subject is not None):
        raise GonioError("give either a FILE or MATERIAL to check, or --self-test")
    if not 0 <= args.feature_width <= 90:
        raise GonioError(f"--feature-width is {args.feature_width:g}; give degrees from 0 to 90")
    if args.repair:
        if args.self_test or args.against or args.strict:
            raise GonioError("--repair goes with tolerances and --json only; check what it wrote by a second command")
        from gonio.cli.repair_output import run_repair

        return run_repair(args)
    if args.nonnegative or args.step is not None:
        option = "--nonnegative" if args.nonnegative else "--step"
        raise GonioError(f"{option} says how to repair; give --repair OUT.h5 too")
    if args.json and args.json != "-":
        refuse_existing(args.json, args.force)
    if args.self_test:
        from gonio.cli.self_test_output import run_self_test

        return run_self_test(args.json, args.force)
    from gonio.checks.certificate import NAMES
    from gonio.checks.certify import check

    certificate = check(
        args.subject,
        tolerances={name: getattr(args, f"tol_{name}") for name in NAMES},
        strict=args.strict,
        feature_width=math.radians(args.feature_width),
        level=args.level,
        against=args.against,
    )
    if args.json == "-":
        sys.stdout.write(certificate.to_json())
        return certificate.exit_status
    if args.json:
        _write(args.json, certificate, args.force)
    print_certificate(certificate)
    return certificate.exit_status


def _write(path, certificate, force):
    from gonio.data.files import new_file

    with new_file(path, force) as temporary:
        temporary.write_text(certificate.to_json(), encoding="utf-8")


COLOURS = {"pass": "green", "fail": "red", "undecided": "yellow", "not applicable": "dim"}
HEADINGS = ("property", "verdict", "residual", "bound", "tolerance", "worst at")


def print_certificate(certificate) -> None:
    """The certificate as a table, and a sentence for each property."""
    from gonio.text import columns, say

    title = f"{certificate.subject} ({certificate.kind}): {certificate.overall.upper()}"
    counted = "all properties but isotropy" if certificate.strict else "reciprocity and energy"
    if not certificate.strict and any(p.name == "agreement" for p in certificate.properties):
        counted = "reciprocity, energy and agreement"
    rows = [
        (p.name, p.verdict, *(_number(v) for v in (p.residual, p.bound, p.tolerance)), _place(p.where))
        for p in certificate.properties
    ]
    if sys.stdout.isatty():
        _rich(title, rows)
    else:
        say(f"{title}\n\n{columns(rows, HEADINGS)}\n")
    for p in certificate.properties:
        sys.stdout.write(f"{p.name}: {p.detail}\n")
    sys.stdout.write(f"The overall verdict is the worst of {counted}.\n")


def _rich(title, rows) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(*HEADINGS, title=Text(title), title_justify="left")
    for name, verdict, *rest in rows:
        table.add_row(name, Text(verdict, style=COLOURS[verdict]), *rest)
    Console().print(table)


def _number(value) -> str:
    if value is None:
        return "-"
    return "no bound" if math.isinf(value) else f"{value:.3g}"


def _place(where) -> str:
    if not where:
        return "-"
    signs = {"theta_i": "θi", "phi_i": "φi", "theta_o": "θo", "phi_o": "φo"}
    if "theta_from" in where:
        band = f"θ {where['theta_from']:g}–{where['theta_to']:g}°"
        return band + (f" channel {where['channel']}" if "channel" in where else "")
    said = " ".join(f"{signs[k]} {v:.4g}°" for k, v in where.items() if k in signs)
    return said + (f" channel {where['channel']}" if "channel" in where else "")
