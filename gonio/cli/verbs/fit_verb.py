"""``gonio fit``: from a table to a model, written as a material file."""

import argparse
import collections
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gonio.cli.arguments import (
    DESCRIPTION,
    FORCE,
    MERL,
    READING,
    Options,
    add_options,
    require_degrees,
    stated_terms,
    writing_json,
)
from gonio.cli.fit_batch import SUFFIX, is_batch, kept_results, run_batch, table_of
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.text import columns, is_verbose, log, number, show

if TYPE_CHECKING:
    from gonio.data.table import Table
    from gonio.fitting.result import FitResult
    from gonio.fitting.uncertainty.optimum import ParameterEstimate

OPTIONS: Options = {
    "-m/--model MODEL": {
        "action": "append",
        "help": "such as 'lambert + ggx(eta=1.5)': omitted shapes are free, name=v is fixed, name~v free from v; "
        "several are ranked by BIC; without one, a model grows until BIC and held-out directions ask for no more; of a "
        "profile (light below the surface) 'dipole(eta=1.3)', or without one the best of all",
    },
    "-o/--output FIT.toml": "the fitted material, or the folder of those of several files; FILE's name with .fit.toml "
    "if not given",
    "--loss LOSS": "sigma, linear, cbrt, log or log1p; by default sigma where known, else cbrt",
    "--relative-noise SHARE": "noise as a share of f, such as 0.05; reweighted",
    "--weight HOW": "solid-angle: by the solid angle of a cell; cosine: by cosθi cosθo; projected-solid-angle: by both",
    "--robust KIND": {
        "nargs": "?",
        "const": "tukey",
        "help": "count outliers less: tukey (default), student or soft-l1; says how many readings, and where",
    },
    "--bootstrap N": "N refits to readings resampled in blocks of neighbouring directions: intervals for any noise",
    "--bootstrap-kind KIND": "wild (default: random signs of residuals) or block_pairs (directions are resampled with "
    "their readings)",
    "--theta-max DEG": "leave out readings beyond this polar angle, on either side",
    "--channel NAME": {"action": "append", "help": "only this channel, such as R or '633 nm'"},
    "--per-channel": "fit each channel by itself",
    "--aperture HOW": "average (default): the model is averaged over the discs of light and detector that the table "
    "states, as its readings are; ignore: compared at their centres",
    "--samples N": "use at most N cells, chosen by the seed",
    "--starts N": "random starts beside those from the data (default 8)",
    "--nuisance NAME,...": "fit errors of the instrument too, held by their stated uncertainties: tilt, theta_i, "
    "theta_o, phi, gain, dark, ...",
    "--uncertainty NAME=U,...": "what holds them, such as 'gain=0.5 %%, tilt=0.05 deg'; before --instrument's and the "
    "table's",
    "--scene S": "a scene's file, or a shipped scene's name: weigh by what it sees, meet its tolerance",
    "--seed SEED": "of random starts and samples (default 0)",
}
MOST_ROWS = 48  # free numbers that are shown one by one
METRIC_NAMES = {
    "relative_rms": "relative rms",
    "relative_rms_cosine": "with cosines",
    "median_relative": "median |Δ|/f",
    "log_rms": "log rms",
    "cbrt_rms": "cube-root rms",
    "bias": "bias (1/sr)",
    "unexplained": "Σr² over a diffuser's",
    "largest_albedo": "largest albedo",
    "reduced_chi2": "reduced χ²",
}
COUNT_NAMES = {
    "negative": "negative (used as they are)",
    "missing": "missing",
    "copies": "copies of others among them",
    "left_out": "left out as asked",
}
CANDIDATE_COLUMNS: tuple[tuple[str, str, Callable[[Any], str]], ...] = (
    ("free", "free numbers", lambda v: str(v)),
    ("bic_above_best", "BIC above best", lambda v: number(v, 5)),
    ("held_out_above_best", "held-out error above best", lambda v: percent(v)),
    ("relative_rms", "relative rms", lambda v: number(v, 3)),
    ("scene_error", "error in the scene", lambda v: percent(v)),
    ("cost_ns", "ns an evaluation", lambda v: number(v, 3)),
    ("seconds", "s", lambda v: f"{v:.2f}"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    files = "a table in any format that can be read, or a profile (measure --scan offsets); several tables, or folders "
    files += "of them, are fitted one after another, on all processors, and a killed run goes on where it stopped"
    parser.add_argument("files", nargs="+", metavar="FILE", help=files)
    add_options(parser.add_argument, OPTIONS | DESCRIPTION | MERL | READING | FORCE)
    parser.set_defaults(bootstrap=0, starts=8, seed=0, aperture="average")


def streamed(args: argparse.Namespace) -> str:
    return ".fit.toml"


def run(args: argparse.Namespace) -> int:
    if args.theta_max == 0:
        raise GonioError("--theta-max is 0; give degrees above 0 and up to 90")
    require_degrees("--theta-max", args.theta_max, 0, 90)
    batch = is_batch(args.files)
    if not args.nuisance and (args.uncertainty or args.instrument):
        raise GonioError("stated uncertainties hold nuisance numbers; give --nuisance too")
    if args.nuisance and (batch or len(args.model or []) > 1 or args.per_channel or args.scene):
        raise GonioError("--nuisance goes with one table and at most one model, without --per-channel and --scene")
    return run_batch(args, _options(args)) if batch else _run_one(args, args.files[0])


def _options(args: argparse.Namespace) -> dict[str, Any]:
    from gonio.fitting.options import OLD_KINDS, FitOptions

    options = {name: getattr(args, name) for name in FitOptions.__annotations__ if hasattr(args, name)}
    kind = options.pop("bootstrap_kind")
    if kind in OLD_KINDS:
        log(f"gonio: --bootstrap-kind {kind} is called {OLD_KINDS[kind]} now")
    return options | ({"bootstrap_kind": OLD_KINDS.get(kind, kind)} if kind is not None else {})


def _run_one(args: argparse.Namespace, file: str) -> int:
    output = args.output or f"{Path(file).stem}{SUFFIX}"
    from gonio.data.files import refuse_outputs
    from gonio.data.profile_files import holds_profile

    if holds_profile(file):
        from gonio.cli.profile_fits import run_profile_fit

        return run_profile_fit(args, file, output)
    refuse_outputs([output, args.json], [file, args.scene, args.instrument, *(args.model or [])], args.force)
    from gonio.fitting.fit_table import fit
    from gonio.fitting.problem.arrow import Sizes
    from gonio.fitting.programs_ahead import ahead
    from gonio.fitting.solver.compiled_steps import compile_steps

    # To load the program of a step takes as long as to read a large file; what goes into it is known already.
    few = Sizes(1, 0, 0)
    ahead(("step", few), lambda: compile_steps(few))
    options = _options(args)
    if not args.model or len(args.model) > 1:
        options["log"] = log
    table = table_of(file, args)
    result = _with_nuisance(table, args, options) if args.nuisance else fit(table, args.model, **options)
    with writing_json(args, result.to_dict() | {"written": output}, result.exit_status):
        result.save(output, args.force)
    if is_verbose():
        show("\n".join([*summary(result), f"written: {output}"]))
    else:
        from gonio.cli.fit_screen import screen

        show("\n".join(screen(result, file, output)))
    return result.exit_status


def _with_nuisance(table: "Table", args: argparse.Namespace, options: dict[str, Any]) -> "FitResult":
    from gonio.instrument.description import read_instrument
    from gonio.metrology.nuisance import fit_with_nuisance

    instrument = None if args.instrument is None else read_instrument(args.instrument)
    stated = stated_terms(args.uncertainty) if args.uncertainty else {}
    names = [name.strip() for name in args.nuisance.split(",")]
    return fit_with_nuisance(table, args.model[0] if args.model else None, names, instrument, stated, **options)


def kept(args: argparse.Namespace) -> str:
    """What an interrupted fit has kept: of many files the results so far."""
    return kept_results(args) if is_batch(args.files) else "nothing was written"


def summary(r: "FitResult") -> list[str]:
    """What is known of a fit, the numbers first."""
    from gonio.fitting.uncertainty.identifiability import listed

    floor = f" (floor {number(max(r.floor), 3)})" if r.loss in ("cbrt", "log") and r.floor else ""
    weighting = [f"{name} {kind}" for name, kind in (("weight", r.weight), ("robust", r.robust)) if kind]
    verdict = "converged" if r.converged else "NOT converged"
    unusual = {k: n for k, n in r.counts.items() if n and k not in ("used", "below_horizon")}
    counts = [f"{n} {COUNT_NAMES.get(k, f'masked as {k}')}" for k, n in unusual.items()]
    return [
        r.judgement.sentence,
        f"{r.requested} on {r.table}: {r.readings_in_words}, {', '.join([f'loss {r.loss}{floor}', *weighting])}",
        f"{verdict}: {r.reason}; {r.starts_agreed} of {r.starts} starts agree",
        *_free_numbers(r),
        "; ".join(f"{METRIC_NAMES.get(k, k)} {number(v, 3)}" for k, v in r.metrics.items()),
        *(
            f"a lit sphere: {c['name']} {number(c['mean'], 3)} in the mean, {number(c['p95'], 3)} at most over 95 %"
            for c in [r.colour_difference]
            if c
        ),
        *([f"readings: {', '.join(counts)}"] if counts else []),
        *([f"active bound{'s' * (len(r.active_bounds) > 1)}: {listed(r.active_bounds)}"] if r.active_bounds else []),
        *(f"undetermined: {sentence}" for sentence in r.undetermined),
        *(f"correlated: {c['a']} and {c['b']} by {number(c['correlation'], 4)}" for c in r.correlated),
        *([f"apertures: {r.apertures['sentence']}"] if r.apertures else []),
        *(f"residuals: {sentence}" for sentence in (r.residuals.sentences if r.residuals else [])),
        *(f"note: {note}" for note in r.notes),
        *([candidate_table(r.alternatives)] if r.alternatives else []),
    ]


def candidate_table(alternatives: Sequence[dict[str, Any]]) -> str:
    """One line for each model that was fitted, with whatever is known of it and why it was taken or refused."""
    known = [c for c in CANDIDATE_COLUMNS if any(c[0] in a for a in alternatives)]
    rows: list[list[str]] = []
    for a in alternatives:
        why = a.get("refused") or a.get("verdict") or ("" if a["converged"] else "not converged")
        rows.append([a["model"], *(form(a[key]) if key in a else "–" for key, _, form in known), why])
    return columns(rows, ["tried", *(heading for _, heading, _ in known), ""])


def _free_numbers(r: "FitResult") -> list[str]:
    """The table of free numbers, and a line on the bootstrap."""
    b = r.bootstrap
    refits = {n["name"]: n for n in b["numbers"]} if b else {}
    rows: list[list[str]] = []
    free = [p for p in r.parameters if p.status != "fixed"]
    for p in free:
        if p.channel and len(free) > MOST_ROWS:
            if p.channel == r.channels.names[0]:
                rows.append(_summed_up([other for other in free if other.name == p.name], bool(refits)))
            continue
        spread = [_interval(p.interval95)]
        if p.label in refits:
            spread = [number(refits[p.label]["standard_uncertainty"], 2), _interval(refits[p.label]["interval95"])]
        rows.append([p.label, number(p.value, 8), number(p.standard_uncertainty, 2), *spread, p.status])
    spread = ["bootstrap", "95 % of refits"] if refits else ["95 % interval"]
    lines = [columns(rows, ["number", "value", "std. unc.", *spread, "status"])] if rows else []
    if b:
        lines.append(
            f"bootstrap ({b['kind']}): {b['refits']} refits, {b['failed']} failed; "
            f"{max(b['blocks'])} blocks of {max(b['block_cells'])} neighbouring cells"
        )
    return lines


def _summed_up(estimates: "Sequence[ParameterEstimate]", refits: bool) -> list[str]:
    """One row for a number that many channels have: least and largest value, and how many have which status."""
    values, known = ([getattr(p, name) for p in estimates] for name in ("value", "standard_uncertainty"))
    known = [u for u in known if math.isfinite(u)]
    statuses = collections.Counter(p.status for p in estimates)
    return [
        f"{estimates[0].name} ({len(estimates)} channels)",
        f"{number(min(values), 4)} to {number(max(values), 4)}",
        f"up to {number(max(known), 2)}" if known else "not known",
        *(["", ""] if refits else []),
        "each in the file",
        ", ".join(f"{n} {status}" for status, n in statuses.items()),
    ]


def _interval(ends: Sequence[float]) -> str:
    return f"[{number(ends[0])}, {number(ends[1])}]"
