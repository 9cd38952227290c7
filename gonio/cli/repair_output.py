"""`gonio check FILE --repair OUT`: the certificate before, how far the readings moved, the certificate after."""

import json
import math
import sys


def run_repair(args) -> int:
    """Repairs, prints and writes; the exit status is that of the repaired table."""
    from gonio.checks.certificate import NAMES
    from gonio.checks.repair.nearest_table import repair
    from gonio.cli.check_verb import print_certificate
    from gonio.data.files import new_file, refuse_existing, refuse_input
    from gonio.data.hdf5.writer import write_table
    from gonio.text import say

    refuse_input(args.repair, args.subject)
    for path in (args.repair, args.json):
        if path and path != "-":
            refuse_existing(path, args.force)
    found = repair(
        args.subject,
        nonnegative=args.nonnegative,
        tolerances={name: getattr(args, f"tol_{name}") for name in NAMES},
        feature_width=math.radians(args.feature_width),
        level=args.level,
        step=args.step,
    )
    write_table(args.repair, found.table, args.force)
    told = found.before.to_dict() | {"repair": {"file": args.repair, "moved": found.moved, "remark": found.remark}}
    told["repair"]["after"] = found.after.to_dict()
    text = json.dumps(told, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    if args.json == "-":
        sys.stdout.write(text)
        return found.after.exit_status
    if args.json:
        with new_file(args.json, args.force) as temporary:
            temporary.write_text(text, encoding="utf-8")
    print_certificate(found.before)
    say(f"\n{sentence(found)}\n")
    print_certificate(found.after)
    return found.after.exit_status


def sentence(found) -> str:
    """How far the readings moved, in units of themselves and of their uncertainties."""
    m = found.moved
    text = f"Repaired{f', {found.remark}' if found.remark else ''}: the {m['readings']:,} readings moved by"
    text += f" {m['relative_rms']:.2%} (rms, of their own), {m['median_relative']:.2%} at the median and"
    text += f" {m['percentile_95_relative']:.2%} at the 95th percentile"
    if "rms_in_uncertainties" in m:
        text += (
            f"; by {m['rms_in_uncertainties']:.2f} standard uncertainties (rms), {m['share_beyond_2_u']:.1%} of them"
        )
        text += " by more than two"
    held = sum(m["incidences_at_the_limit"])
    text += f". {held} albedos stand at the limit of 1." if held else ". No albedo had to be held at 1."
    return text
