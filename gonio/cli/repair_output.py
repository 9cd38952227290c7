"""`gonio check FILE --repair OUT`: the certificate before, how far the readings moved, the certificate after."""

import argparse
import json
from typing import TYPE_CHECKING, Any

from gonio.cli.arguments import write_text
from gonio.cli.certificate_text import print_certificate
from gonio.text import show

if TYPE_CHECKING:
    from gonio.checks.repairs.nearest_table import Repaired


def run_repair(args: argparse.Namespace, options: dict[str, Any]) -> int:
    """Repairs, prints and writes; the exit status is that of the repaired table."""
    from gonio.checks.repairs.nearest_table import repair
    from gonio.data.hdf5.writer import write_table

    result = repair(args.subject, nonnegative=args.nonnegative, step=args.step, **options)
    write_table(args.repair, result.table, args.force)
    if args.json:
        change = {"file": args.repair, "moved": result.moved, "remark": result.remark, "after": result.after.to_dict()}
        content = result.before.to_dict() | {"repair": change}
        write_text(args.json, json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n", args.force)
    if args.json != "-":
        print_certificate(result.before)
        show(f"\n{repair_sentence(result)}\n")
        print_certificate(result.after)
    return result.after.exit_status


def repair_sentence(result: "Repaired") -> str:
    """How far the readings moved, relative to themselves and in units of their uncertainties."""
    m = result.moved
    text = f"Repaired{f', {result.remark}' if result.remark else ''}: the {m['readings']:,} readings moved by"
    text += f" {m['relative_rms']:.2%} (rms, of their own), {m['median_relative']:.2%} at the median and"
    text += f" {m['percentile_95_relative']:.2%} at the 95th percentile"
    if "rms_in_uncertainties" in m:
        text += f"; by {m['rms_in_uncertainties']:.2f} standard uncertainties (rms), {m['share_beyond_2_u']:.1%} of"
        text += " them by more than two"
    at_limit = sum(m["incidences_at_the_limit"])
    return text + (f". {at_limit} albedos stand at the limit of 1." if at_limit else ". No albedo stands at 1.")
