"""``gonio fit``: from a table to a model, written as a material file."""

import argparse

METRIC_NAMES = {
    "relative_rms": "relative rms",
    "relative_rms_cosine": "with cosines",
    "median_relative": "median |Δ|/f",
    "log_rms": "log rms",
    "cbrt_rms": "cube-root rms",
    "bias": "bias (1/sr)",
    "reduced_chi2": "reduced χ²",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a table in any format that can be read")
    parser.add_argument(
        "-m", "--model", action="append", metavar="MODEL",
        help="such as 'lambert + ggx(eta=1.5)': omitted shapes are free, name=v is fixed, name~v free from v; "
        "several are ranked by BIC; without one, a model grows until BIC and held-out directions ask for no more",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="FIT.toml", help="the fitted material; FILE's name with .fit.toml if not given"
    )
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
    parser.add_argument("--weight", metavar="HOW", help="solid-angle: weigh cells by the solid angle they stand for")
    parser.add_argument("--channel", action="append", metavar="NAME", help="only this channel, such as R or '633 nm'")
    parser.add_argument("--per-channel", action="store_true", help="fit each channel by itself")
    parser.add_argument("--samples", type=int, metavar="N", help="use at most N cells, drawn by the seed")
    parser.add_argument(
        "--starts", type=int, default=8, metavar="N", help="random starts beside those from the data (default 8)"
    )
    parser.add_argument(
        "--scene", metavar="S", help="a scene's file, or a shipped scene's name: weigh by what it sees, meet its tolerance"
    )
    parser.add_argument("--seed", type=int, default=0, help="of random starts and samples (default 0)")
    parser.add_argument("--merl-nodes", choices=("lower", "centre"), help="where a MERL file's nodes lie in their bins")
    parser.add_argument(
        "--json", metavar="FILE", help="also write everything about the fit as JSON ('-': standard output)"
    )
    parser.add_argument("--force", action="store_true", help="replace an existing output")


def run(args: argparse.Namespace) -> int:
    import json
    import math
    from pathlib import Path

    from gonio.cli.text import say, tell
    from gonio.data.files import new_file, refuse_existing, refuse_input
    from gonio.models.errors import GonioError

    output = args.output or f"{Path(args.file).stem}.fit.toml"
    refuse_existing(output, args.force)
    refuse_input(output, args.file)
    if args.json and args.json != "-":
        refuse_existing(args.json, args.force)
        refuse_input(args.json, args.file)
    if args.starts < 0 or (args.samples is not None and args.samples < 1):
        raise GonioError("--starts takes 0 or more and --samples 1 or more; give a larger number.")
    if args.theta_max is not None and not 0 < args.theta_max <= 90:
        raise GonioError(f"--theta-max is {args.theta_max:g}; expected degrees above 0 and up to 90.")
    import tomli_w

    from gonio.data.plain import plain
    from gonio.data.reading import read
    from gonio.fitting.fitting import fit

    table = read(args.file, **({"nodes": args.merl_nodes} if args.merl_nodes else {}))
    if args.channel:
        table = table.only(args.channel)
    if not table.name:
        table.name = Path(args.file).stem
    result = fit(
        table,
        args.model,
        loss=args.loss,
        theta_max=None if args.theta_max is None else math.radians(args.theta_max),
        weight=args.weight,
        relative_noise=args.relative_noise,
        per_channel=args.per_channel,
        samples=args.samples,
        starts=args.starts,
        scene=args.scene,
        seed=args.seed,
        say=tell if not args.model or len(args.model) > 1 else lambda line: None,
    )
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


def summary(r) -> list[str]:
    """What a fit says of itself, in lines."""
    from gonio.cli.text import columns, number
    from gonio.cli.tried import tried

    lines = [
        f"{r.asked} on {r.table}: {r.samples} readings, loss {r.loss}" + (f", weight {r.weight}" if r.weight else "")
    ]
    lines.append(
        f"{'converged' if r.converged else 'NOT converged'}: {r.reason}; {r.starts_agreed} of {r.starts} starts agree"
    )
    rows = [
        [
            p.label,
            number(p.value, 8),
            number(p.standard_uncertainty, 2),
            f"[{number(p.interval95[0])}, {number(p.interval95[1])}]",
            p.status,
        ]
        for p in r.parameters
        if p.status != "fixed"
    ]
    if rows:
        lines.append(columns(rows, ["number", "value", "std. unc.", "95 % interval", "status"]))
    lines.append("; ".join(f"{METRIC_NAMES[k]} {number(v, 3)}" for k, v in r.metrics.items()))
    if r.negative_readings:
        lines.append(f"{r.negative_readings} negative readings, used as they are")
    lines += [f"active bound: {name}" for name in r.active_bounds]
    lines += [f"undetermined: {words}" for words in r.undetermined]
    lines += [f"note: {words}" for words in r.notes]
    if r.alternatives:
        lines.append(tried(r.alternatives))
    return lines
