"""``gonio fit``: from a table to a model, written as a material file."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files", nargs="+", metavar="FILE",
        help="a table in any format that can be read; several, or folders of them, are fitted one after another, on "
        "all processors, and a killed run goes on where it stopped",
    )  # fmt: skip
    parser.add_argument(
        "-m", "--model", action="append", metavar="MODEL",
        help="such as 'lambert + ggx(eta=1.5)': omitted shapes are free, name=v is fixed, name~v free from v; "
        "several are ranked by BIC; without one, a model grows until BIC and held-out directions ask for no more",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="FIT.toml",
        help="the fitted material, or the folder of those of several files; FILE's name with .fit.toml if not given",
    )  # fmt: skip
    parser.add_argument("--loss", help="sigma, linear, cbrt, log or log1p; by default sigma where known, else cbrt")
    parser.add_argument(
        "--relative-noise",
        type=float,
        metavar="SHARE",
        help="noise as a share of f, such as 0.05: weights by the model, reweighted",
    )
    parser.add_argument(
        "--theta-max", type=float, metavar="DEG", help="leave out readings beyond this polar angle, on either side"
    )
    parser.add_argument(
        "--weight", metavar="HOW",
        help="solid-angle: by the solid angle of a cell; cosine: by cosθi cosθo; projected-solid-angle: by both",
    )  # fmt: skip
    parser.add_argument(
        "--robust", nargs="?", const="tukey", metavar="KIND",
        help="count outliers less: tukey (default), student or soft-l1; says how many readings, and where",
    )  # fmt: skip
    parser.add_argument(
        "--bootstrap", type=int, default=0, metavar="N",
        help="N refits to readings drawn again in blocks of neighbouring directions: intervals for any noise",
    )  # fmt: skip
    parser.add_argument(
        "--bootstrap-kind", default="residuals", metavar="KIND",
        help="residuals (default: the directions stay) or pairs (directions are drawn with their readings)",
    )  # fmt: skip
    parser.add_argument("--channel", action="append", metavar="NAME", help="only this channel, such as R or '633 nm'")
    parser.add_argument("--per-channel", action="store_true", help="fit each channel by itself")
    parser.add_argument("--samples", type=int, metavar="N", help="use at most N cells, drawn by the seed")
    parser.add_argument(
        "--starts", type=int, default=8, metavar="N", help="random starts beside those from the data (default 8)"
    )
    parser.add_argument(
        "--scene",
        metavar="S",
        help="a scene's file, or a shipped scene's name: weigh by what it sees, meet its tolerance",
    )
    parser.add_argument("--seed", type=int, default=0, help="of random starts and samples (default 0)")
    parser.add_argument("--merl-nodes", choices=("lower", "centre"), help="where a MERL file's nodes lie in their bins")
    parser.add_argument(
        "--json", metavar="FILE", help="also write everything about the fit as JSON ('-': standard output)"
    )
    parser.add_argument("--force", action="store_true", help="replace an existing output")


def run(args: argparse.Namespace) -> int:
    from gonio.cli.fit_batch import is_batch, run_batch
    from gonio.models.errors import GonioError

    if args.starts < 0 or (args.samples is not None and args.samples < 1):
        raise GonioError("--starts takes 0 or more and --samples 1 or more; give a larger number.")
    if args.theta_max is not None and not 0 < args.theta_max <= 90:
        raise GonioError(f"--theta-max is {args.theta_max:g}; expected degrees above 0 and up to 90.")

    def table_of(file):
        from pathlib import Path

        from gonio.data.formats.registry import read

        table = read(file, **({"nodes": args.merl_nodes} if args.merl_nodes else {}))
        if args.channel:
            table = table.only(args.channel)
        if not table.name:
            table.name = Path(file).stem
        return table

    if is_batch(args.files):
        return run_batch(args, table_of, _options(args))
    return _run_one(args, args.files[0], table_of)


def _options(args: argparse.Namespace) -> dict:
    import math

    names = ("loss", "weight", "relative_noise", "robust", "bootstrap", "bootstrap_kind", "per_channel", "samples")
    options = {name: getattr(args, name) for name in (*names, "starts", "scene", "seed")}
    return {**options, "theta_max": None if args.theta_max is None else math.radians(args.theta_max)}


def _run_one(args: argparse.Namespace, file: str, table_of) -> int:
    import json
    from pathlib import Path

    from gonio.cli.fit_summary import summary
    from gonio.data.files import new_file, refuse_existing, refuse_input
    from gonio.text import say, tell

    output = args.output or f"{Path(file).stem}.fit.toml"
    refuse_existing(output, args.force)
    refuse_input(output, file)
    if args.json and args.json != "-":
        refuse_existing(args.json, args.force)
        refuse_input(args.json, file)
    import tomli_w

    from gonio.data.serialise import plain
    from gonio.fitting.fit_table import fit
    from gonio.fitting.solver.lm_step import padded_size, prepare
    from gonio.fitting.solver.precompile import ahead

    # To load the program of a step takes as long as to read a large file; what goes into it is known already.
    ahead(("step", padded_size(0)), lambda: prepare(0))
    listens = tell if not args.model or len(args.model) > 1 else lambda line: None
    result = fit(table_of(file), args.model, say=listens, **_options(args))
    text = tomli_w.dumps(result.to_material_dict(Path(output).name.removesuffix(".toml").removesuffix(".fit")))
    with new_file(output, args.force) as path:
        path.write_text(text, encoding="utf-8")
    if args.json == "-":
        say(json.dumps(plain(result.to_dict()), indent=2, ensure_ascii=False, allow_nan=False))
        return result.exit_status
    if args.json:
        with new_file(args.json, args.force) as path:
            path.write_text(
                json.dumps(plain(result.to_dict()), indent=2, ensure_ascii=False, allow_nan=False), encoding="utf-8"
            )
    for line in summary(result):
        say(line)
    say(f"written: {output}")
    return result.exit_status
