"""``gonio check FILE|MATERIAL``: a certificate to read, and one for machines; a repair; the self-test of the checks."""

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gonio.checks.properties import PROPERTIES
from gonio.cli.arguments import (
    FORCE,
    READING,
    Options,
    add_options,
    as_stated,
    require_degrees,
    write_json,
    writing_json,
)
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.text import columns, is_verbose, log, show, shows_results

if TYPE_CHECKING:
    from gonio.checks.certificate import Certificate
    from gonio.checks.repairs.nearest_table import Repaired

OPTIONS: Options = {
    "--self-test": "judge models and tables whose verdicts are known, some with mistakes; exit status 0 if all are "
    "right",
    "--strict": "all properties but isotropy count",
    **{f"--tol-{name} T": f"tolerance of {name}: {spec.unit}" for name, spec in PROPERTIES.items()},
    "--feature-width DEG": "tables: no lobe is narrower than this (full width at half maximum at normal incidence: "
    "about 190 alpha), so that readings which leave out the mirror direction bound what hides there",
    "--level P": "tables with stored uncertainties: chance of calling an honest one significantly wrong (0.01)",
    "--against FILE|MATERIAL": "the truth, if known, or another table of the surface, as far as its readings tell: "
    "agreement with it counts too",
    "--model MODEL": "tables: where the readings alone leave energy or reciprocity undecided, fit this model (or "
    "'auto') and assume that between the readings the surface follows it, as far as they do",
    "--with FILE": {
        "dest": "further",
        "help": "tables: more readings of the same surface, such as gonio plan --for energy names",
    },
    "--instrument LAB.toml": "tables: the media in front of the sample and behind it are those of this instrument",
    "--repair OUT.h5": "write the nearest table that is reciprocal and conserves energy; the exit status is then that "
    "table's",
    "--nonnegative": "no reading of the repaired table is negative",
    "--step DEG": {"type": float, "help": "a file that is no grid (RGL's) is repaired on one of this step (5)"},
}
COLOURS = {"pass": "green", "fail": "red", "undecided": "yellow", "not testable": "yellow", "not applicable": "dim"}
WORSE = (0, 3, 1, 2)
"""Exit statuses, the worst last: pass, undecided, fail, refused."""
HEADINGS = ("property", "verdict", "residual", "bound", "tolerance", "worst at")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Judges reciprocity, energy conservation, positivity, symmetries and edges of a model or a table, each with"
        " the error of the judgement. Exit status: 0 pass, 1 fail, 3 undecided."
    )
    subject = "a table, a profile (light below the surface), a material's name, or an expression"
    subject += "; of several each gets a line, and the exit status is the worst"
    parser.add_argument("subjects", metavar="FILE|MATERIAL", nargs="*", help=subject)
    add_options(parser.add_argument, OPTIONS | READING | FORCE)
    parser.set_defaults(feature_width=0.0, level=0.01)


def run(args: argparse.Namespace) -> int:
    """Checks, prints, writes; the exit status is the certificate's."""
    _refuse_contradictions(args)
    from gonio.data.files import refuse_outputs

    refuse_outputs([args.json, args.repair], [*args.subjects, args.against, args.further, args.instrument], args.force)
    if args.self_test:
        return run_self_test(args)
    tolerances = {name: getattr(args, f"tol_{name}") for name in PROPERTIES}
    options: dict[str, Any] = {"tolerances": tolerances, "feature_width": args.feature_width, "level": args.level}
    if args.repair:
        return _run_repair(args, options)
    options |= {"strict": args.strict, "against": args.against, "model": args.model, "further": args.further}
    if args.instrument is not None:
        from gonio.instrument.description import read_instrument

        options["instrument"] = read_instrument(args.instrument)
    if len(args.subjects) > 1:
        return _run_several(args, options)
    from gonio.checks.certify import check

    certificate = check(as_stated(args.subjects[0], args), **options)
    print_certificate(certificate)
    return write_json(args, certificate.to_dict(), certificate.exit_status)


def _run_several(args: argparse.Namespace, options: dict[str, Any]) -> int:
    """Checks one subject after another, a line each as soon as it is judged; the exit status is the worst."""
    from gonio.checks.certify import check

    width = max(map(len, args.subjects))
    facts: list[dict[str, Any]] = []
    for subject in args.subjects:
        try:
            certificate = check(as_stated(subject, args), **options)
        except GonioError as error:
            why = str(error)
            facts.append({"subject": subject, "refused": why, "exit_status": 2})
            named = why.startswith(subject) or f"'{subject}'" in why
            sys.stderr.write(f"gonio: {why}\n" if named else f"gonio: {subject}: {why}\n")
            continue
        facts.append(certificate.to_dict())
        others = [
            f"{p.name} {p.verdict}" for p in certificate.properties if p.verdict not in ("pass", "not applicable")
        ]
        show(f"{subject.ljust(width)}  {certificate.verdict_in_words}" + f"  ({', '.join(others)})" * bool(others))
        if is_verbose():
            print_certificate(certificate)
    statuses = [f["exit_status"] for f in facts]
    return write_json(args, {"certificates": facts}, max(statuses, key=WORSE.index))


def _refuse_contradictions(args: argparse.Namespace) -> None:
    if args.self_test == bool(args.subjects):
        raise GonioError("give either a FILE or MATERIAL to check, or --self-test")
    require_degrees("--feature-width", args.feature_width, 0, 90)
    other = args.self_test or args.against or args.strict or args.model or args.further or args.instrument
    if args.repair and (other or len(args.subjects) > 1):
        raise GonioError("--repair goes with one file, tolerances and --json only; check what it wrote afterwards")
    if not args.repair and (args.nonnegative or args.step is not None):
        option = "--nonnegative" if args.nonnegative else "--step"
        raise GonioError(f"{option} is an option of the repair; give --repair OUT.h5 too")


def print_certificate(certificate: "Certificate") -> None:
    """Prints the verdict, a line a property, and a sentence for each that counts and does not pass; -v: for each.

    Verdicts are coloured on a terminal.
    """
    from gonio.checks.certificate import place_in_words

    title = f"{certificate.subject} ({certificate.kind}): {certificate.verdict_in_words}"
    rows = [
        (p.name, p.verdict, *map(_number, (p.residual, p.bound, p.tolerance)), place_in_words(p.where) or "-")
        for p in certificate.properties
    ]
    if sys.stdout.isatty() and shows_results():
        _print_coloured(title, rows)
    else:
        show(f"{title}\n\n{columns(rows, HEADINGS)}\n")
    every = certificate.properties
    explained = every if is_verbose() else [p for p in every if p.name in certificate.counted and p.verdict != "pass"]
    for p in explained:
        show(f"{p.name}: {p.detail}")
    for note in certificate.notes:
        show(f"note: {note}")
    more = "" if len(explained) == len(every) else " -v says how each property was judged."
    show(f"The overall verdict is the worst of {certificate.basis}.{more}")


def _print_coloured(title: str, rows: Sequence[tuple[str, ...]]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(*HEADINGS, title=Text(title), title_justify="left")
    for name, verdict, *rest in rows:
        table.add_row(name, Text(verdict, style=COLOURS[verdict]), *rest)
    Console().print(table)


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return "no bound" if value == float("inf") else f"{value:.3g}"


def _run_repair(args: argparse.Namespace, options: dict[str, Any]) -> int:
    """Repairs, prints and writes; the exit status is that of the repaired table."""
    from gonio.checks.repairs.nearest_table import repair
    from gonio.data.hdf5.writer import write_table

    result = repair(as_stated(args.subjects[0], args), nonnegative=args.nonnegative, step=args.step, **options)
    change = {"file": args.repair, "moved": result.moved, "remark": result.remark, "after": result.after.to_dict()}
    with writing_json(args, result.before.to_dict() | {"repair": change}, result.after.exit_status):
        write_table(args.repair, result.table, args.force)
    print_certificate(result.before)
    show(f"\n{repair_sentence(result)}\n")
    print_certificate(result.after)
    return result.after.exit_status


def repair_sentence(result: "Repaired") -> str:
    """How far the readings moved, relative to themselves and in units of their uncertainties."""
    m = result.moved
    text = f"Repaired{f', {result.remark}' if result.remark else ''}: the {m['readings']:,} readings moved by"
    text += (
        f" {percent(m['relative_rms'], 3)} (rms, of their own), {percent(m['median_relative'], 3)} at the median and"
    )
    text += f" {percent(m['percentile_95_relative'], 3)} at the 95th percentile"
    if "rms_in_uncertainties" in m:
        text += (
            f"; by {m['rms_in_uncertainties']:.2f} standard uncertainties (rms), {percent(m['share_beyond_2_u'])} of"
        )
        text += " them by more than two"
    at_limit = sum(m["incidences_at_the_limit"])
    return text + (f". {at_limit} albedos stand at the limit of 1." if at_limit else ". No albedo stands at 1.")


def run_self_test(args: argparse.Namespace) -> int:
    """Judges all subjects, prints each verdict, then the confusion table; 0 only if every verdict is right."""
    from gonio.checks.controls.self_test import Judgement, confusion, self_test

    out = log if args.json == "-" else show
    judged: list[Judgement] = []
    for one in self_test():
        judged.append(one)
        mark = "right" if one.right else "WRONG"
        out(f"{mark}  {one.kind:12}  {one.subject[:64]:64}  expected {one.expected:12}  found {one.outcome}")
    table = confusion(judged)
    wrong = sum(row["wrong"] for row in table.values())
    rows = [(name, str(row["right"]), str(row["wrong"])) for name, row in table.items()]
    out(f"\n{columns(rows, ('subjects: expected', 'right', 'wrong'))}\n")
    out(f"{len(judged)} subjects, {wrong} judged wrongly.")
    content = {"gonio_self_test": 1, "confusion": table, "judged": [one.to_dict() for one in judged]}
    return write_json(args, content, 1 if wrong else 0)
