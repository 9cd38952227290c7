"""``gonio plan``: which directions to read, how long, and in which order."""

import argparse
import math
import re
import shlex
from typing import TYPE_CHECKING, Any

from gonio.cli.arguments import (
    DESCRIPTION,
    FORCE,
    MATERIAL,
    READING,
    Options,
    add_options,
    as_stated,
    hours,
    seconds_of,
    share_of,
    writing_json,
)  # fmt: skip
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.text import columns, log, number, show

if TYPE_CHECKING:
    from gonio.planning.planned import Plan

OPTIONS: Options = {
    "-o/--output PATH.csv": {"required": True, "help": "directions and counting times, for gonio measure --scan"},
    "--budget TIME": "of the whole, travel included, such as 2h, 30min or 1h30min",
    "--target SHARE": {"type": str, "help": "in place of a budget: largest relative standard uncertainty, such as 1%%"},
    "-m/--model MODEL": "what will be fitted, such as 'lambert + ggx(eta=1.5)'; by default the fit's own model, or the "
    "material's with its levels and widths free",
    "--for NAME,...": {
        "dest": "wanted",
        "help": "what is to be known: free numbers such as ggx.alpha, albedo, scene:NAME (default: all free numbers); "
        "or energy: the few readings that would decide on the energy of a table",
    },
    "--range NAME=LOW:HIGH,...": {
        "dest": "ranges",
        "help": "where numbers may be, such as alpha=0.05:0.3: the plan is good all over it (default: a fit's "
        "covariance; of a material, widths within a factor of 3)",
    },
    "--against MODEL": "tell the material apart from this model, in place of knowing its numbers",
    "--space-filling SHARE": {
        "default": 0.14,
        "help": "of the time, for directions all over the range, against what the model leaves out (default 0.14)",
    },
    "--lit SIDES": {
        "choices": ("front", "back", "both"),
        "default": "front",
        "help": "of what transmits: the sides of the sample that the light comes from (default front); the detector "
        "goes wherever the model sends light",
    },
    "--continue T.h5": {"dest": "continued", "help": "a table of what was read already: the plan adds to it"},
    "--picture FILE": "also draw the path (png, svg, pdf)",
}
LEAST_SHARE = 1e-6
"""That is printed of a residual; the solver's own is no better."""
MOST_RANGES, SEEN = 4, 0.01
"""Ranges of numbers that are printed, and the least share of a number that one is wide."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    help_text = f"{MATERIAL}, a fit or a table: what is known before"
    parser.add_argument("material", metavar="MATERIAL", nargs="?", help=help_text)
    add_options(parser.add_argument, OPTIONS | DESCRIPTION | READING | FORCE)


def streamed(args: argparse.Namespace) -> str:
    return ".csv"


def run(args: argparse.Namespace) -> int:
    from gonio.data.files import refuse_outputs

    outputs = [args.output, args.json, args.picture]
    refuse_outputs(outputs, [args.material, args.instrument, args.continued, args.model, args.against], args.force)
    from gonio.data.subject import resolve_subject
    from gonio.figures.paths import require_picture, write_path
    from gonio.fitting.material_warnings import material_warnings
    from gonio.instrument.description import read_instrument
    from gonio.planning.planned import plan

    if args.picture:
        require_picture(args.picture, args.force)
    if args.wanted == "energy":
        return _run_energy(args)
    options: dict[str, Any] = {
        name: getattr(args, name) for name in ("model", "against", "space_filling", "continued", "lit")
    }
    options["budget"] = None if args.budget is None else seconds_of(args.budget)
    options["target"] = None if args.target is None else share_of(args.target)
    options["wanted"] = [name.strip() for name in args.wanted.split(",")] if args.wanted else []
    options["ranges"] = _ranges(args.ranges) if args.ranges else {}
    instrument = None if args.instrument is None else read_instrument(args.instrument)
    subject = None if args.material is None else resolve_subject(as_stated(args.material, args))
    if subject is not None and subject.material is not None:
        for warning in material_warnings(subject.material):
            log(f"gonio: {args.material}: {warning}")
    planned = plan(subject, instrument, **options)
    with writing_json(args, planned.to_dict() | {"written": args.output}):
        if args.picture:
            title = f"{planned.name}: {planned.shots.seconds.size} shots in {planned.hours:.3g} h"
            write_path(planned.shots.angles, planned.shots.seconds, title, args.picture, args.force)
        planned.save(args.output, args.force)
    files = ", ".join(name for name in outputs if name)
    show("\n".join([*summary(planned), f"written: {files}"]))
    return 0


def _run_energy(args: argparse.Namespace) -> int:
    """Plans the readings that would decide on the energy of a table, prints what they promise, and writes them."""
    from gonio.checks.energy_plan import plan_energy
    from gonio.data.subject import resolve_subject
    from gonio.figures.paths import write_path
    from gonio.instrument.description import read_instrument

    others = {"budget": args.budget, "target": args.target, "range": args.ranges, "against": args.against}
    if named := [f"--{name}" for name, value in others.items() if value]:
        raise GonioError(f"a plan for energy has no {named[0]}: it names the fewest readings; leave it out")
    if args.material is None:
        raise GonioError("a plan for energy needs the table whose energy is open; name its file")
    instrument = None if args.instrument is None else read_instrument(args.instrument)
    further = None if args.continued is None else resolve_subject(args.continued).require_table()
    planned = plan_energy(as_stated(args.material, args), instrument, model=args.model or "auto", further=further)
    title = f"{planned.name}: {planned.shots.seconds.size} readings for energy in {planned.hours:.3g} h"
    with writing_json(args, planned.to_dict() | {"written": args.output}):
        if args.picture:
            write_path(planned.shots.angles, planned.shots.seconds, title, args.picture, args.force)
        planned.save(args.output, args.force)
    before, after = planned.before, planned.after
    incidences = ", ".join(f"{t:g}" for t in planned.undecided_theta_i)
    albedo = f"albedo {1 + (after.residual or 0):.4g} ± {after.bound:.2g}"
    show(title)
    show(f"now: {before.verdict} at θi {incidences}°")
    show(f"after that: {after.verdict}, {albedo}, if the surface is {planned.model}")
    files = ", ".join(name for name in (args.output, args.json, args.picture) if name)
    show(f"next: gonio measure MATERIAL --scan {args.output} -o more.h5")
    show(f"      gonio check {args.material} --with more.h5 --model {shlex.quote(args.model or 'auto')}")
    show(f"written: {files}")
    return 0


def summary(p: "Plan") -> list[str]:
    """What a plan promises, beside the best regular scan of equal hours, and its certificate."""
    rows = [
        [n.name, number(n.value, 6), *(["", number(n.regular, 4)] if p.separation else _spreads(n.value, n))]
        for n in p.numbers
    ]
    ours = "" if p.separation else "std. unc."
    filling = f"; {percent(p.space_filling)} of the time all over the range" if p.space_filling else ""
    places = len({tuple(a) for a in p.shots.angles.T.tolist()})
    wide = {name: ends for name, ends in p.over.items() if ends[1] - ends[0] > SEEN * abs(ends[1])}
    ranges = [f"{name} {number(low, 3)} to {number(high, 3)}" for name, (low, high) in wide.items()]
    listed = ", ".join(ranges[:MOST_RANGES] + ["..."] * (len(ranges) > MOST_RANGES))
    return [
        f"{p.name}: {p.shots.seconds.size} shots in {places} directions, {hours(p.hours * 3600)}, "
        f"{hours(p.way * 3600)} of it moving and settling{filling}",
        *([f"good over {listed}"] if listed else []),
        columns(rows, ["number", "value", ours, f"regular scan, equal hours ({p.regular})"]),
        *(
            [f"by the plan's own criterion the variance of the regular scan is {number(p.advantage, 3)} times as large"]
            if math.isfinite(p.advantage)
            else []
        ),
        *(
            [
                "no measurement of equal hours in the directions that it chose from has less than "
                f"{percent(p.limit)} of the plan's variance, even with the numbers known before and no time on the way"
            ]
            if math.isfinite(p.limit)
            else []
        ),
        f"certificate (Kiefer-Wolfowitz): max d − Σ w d = {number(p.residual, 2)} of {number(p.scale, 3)}: no shares "
        f"of the time gain more than {percent(max(p.residual / p.scale, LEAST_SHARE))} in the criterion",
    ]


def _spreads(value: float, n: Any) -> list[str]:
    def text(u: float) -> str:
        relative = f" ({percent(u / abs(value))})" if value else ""
        return number(u, 2) + (relative if math.isfinite(u) else "")

    return [text(n.standard_uncertainty), text(n.regular)]


def _ranges(text: str) -> dict[str, tuple[float, float]]:
    ranges: dict[str, tuple[float, float]] = {}
    for item in text.split(","):
        parts = re.fullmatch(r"\s*([\w.\[\] ]+?)\s*=\s*([^:]+):([^:]+)", item)
        try:
            name, low, high = parts.groups() if parts else ("", "", "")
            ranges[name] = float(low), float(high)
        except ValueError:
            raise GonioError(f"--range has {item.strip()!r}; give NAME=LOW:HIGH, such as alpha=0.05:0.3") from None
    return ranges
