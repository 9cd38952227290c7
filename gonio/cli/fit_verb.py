"""``gonio fit``: from a table to a model, written as a material file."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

from gonio.cli.arguments import add_force, add_merl_nodes, refuse_outputs, require_range, write_text
from gonio.cli.fit_batch import SUFFIX, is_batch, run_batch, table_of
from gonio.cli.fit_summary import summary
from gonio.models.errors import GonioError
from gonio.text import log, show


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "files", nargs="+", metavar="FILE",
        help="a table in any format that can be read; several, or folders of them, are fitted one after another, on "
        "all processors, and a killed run goes on where it stopped",
    )  # fmt: skip
    add(
        "-m", "--model", action="append", metavar="MODEL",
        help="such as 'lambert + ggx(eta=1.5)': omitted shapes are free, name=v is fixed, name~v free from v; "
        "several are ranked by BIC; without one, a model grows until BIC and held-out directions ask for no more",
    )  # fmt: skip
    add(
        "-o", "--output", metavar="FIT.toml",
        help="the fitted material, or the folder of those of several files; FILE's name with .fit.toml if not given",
    )  # fmt: skip
    add("--json", metavar="FILE", help="also write everything about the fit as JSON ('-': standard output)")
    _add_weighting(parser)
    _add_selection(parser)
    add_merl_nodes(parser)
    add_force(parser)


def _add_weighting(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--loss", help="sigma, linear, cbrt, log or log1p; by default sigma where known, else cbrt")
    add("--relative-noise", type=float, metavar="SHARE", help="noise as a share of f, such as 0.05; reweighted")
    add(
        "--weight", metavar="HOW",
        help="solid-angle: by the solid angle of a cell; cosine: by cosθi cosθo; projected-solid-angle: by both",
    )  # fmt: skip
    add(
        "--robust", nargs="?", const="tukey", metavar="KIND",
        help="count outliers less: tukey (default), student or soft-l1; says how many readings, and where",
    )  # fmt: skip
    add(
        "--bootstrap", type=int, default=0, metavar="N",
        help="N refits to readings resampled in blocks of neighbouring directions: intervals for any noise",
    )  # fmt: skip
    add(
        "--bootstrap-kind", metavar="KIND",
        help="wild (default: random signs of residuals) or block_pairs (directions are resampled with their readings)",
    )  # fmt: skip


def _add_selection(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--theta-max", type=float, metavar="DEG", help="leave out readings beyond this polar angle, on either side")
    add("--channel", action="append", metavar="NAME", help="only this channel, such as R or '633 nm'")
    add("--per-channel", action="store_true", help="fit each channel by itself")
    add("--samples", type=int, metavar="N", help="use at most N cells, chosen by the seed")
    add("--starts", type=int, default=8, metavar="N", help="random starts beside those from the data (default 8)")
    add(
        "--scene", metavar="S",
        help="a scene's file, or a shipped scene's name: weigh by what it sees, meet its tolerance",
    )  # fmt: skip
    add("--seed", type=int, default=0, help="of random starts and samples (default 0)")


def run(args: argparse.Namespace) -> int:
    if args.theta_max == 0:
        raise GonioError("--theta-max is 0; give degrees above 0 and up to 90")
    require_range("--theta-max", args.theta_max, 0, 90)
    return run_batch(args, _options(args)) if is_batch(args.files) else _run_one(args, args.files[0])


def _options(args: argparse.Namespace) -> dict[str, Any]:
    names = ("loss", "weight", "relative_noise", "robust", "bootstrap", "per_channel", "samples", "starts", "scene")
    options = {name: getattr(args, name) for name in (*names, "seed")}
    if args.bootstrap_kind is not None:
        from gonio.fitting.options import OLD_KINDS

        options["bootstrap_kind"] = OLD_KINDS.get(args.bootstrap_kind, args.bootstrap_kind)
        if args.bootstrap_kind in OLD_KINDS:
            log(f"gonio: --bootstrap-kind {args.bootstrap_kind} is called {options['bootstrap_kind']} now")
    return {**options, "theta_max": None if args.theta_max is None else math.radians(args.theta_max)}


def _run_one(args: argparse.Namespace, file: str) -> int:
    output = args.output or f"{Path(file).stem}{SUFFIX}"
    refuse_outputs([output, args.json], [file], args.force)
    from gonio.data.serialise import plain
    from gonio.fitting.fit_table import fit
    from gonio.fitting.solver.lm_step import compile_step, padded_size
    from gonio.fitting.solver.precompile import ahead

    # To load the program of a step takes as long as to read a large file; what goes into it is known already.
    ahead(("step", padded_size(0)), lambda: compile_step(0))
    options = _options(args)
    if not args.model or len(args.model) > 1:
        options["log"] = log
    result = fit(table_of(file, args), args.model, **options)
    result.save(output, args.force)
    if args.json:
        text = json.dumps(plain(result.to_dict()), indent=2, ensure_ascii=False, allow_nan=False)
        write_text(args.json, text + "\n", args.force)
    if args.json != "-":
        show("\n".join([*summary(result), f"written: {output}"]))
    return result.exit_status
