"""``gonio quantities``: albedos and reflectance factors, and where their uncertainty comes from."""

import argparse
import math
from typing import TYPE_CHECKING, Any

from gonio.cli.arguments import (
    DESCRIPTION,
    FORCE,
    MERL,
    READING,
    Options,
    add_options,
    as_stated,
    beside_stated,
    stated_terms,
    write_json,
)
from gonio.cli.quantities_text import (
    EVERYTHING,
    other_groups,
    plain_list,
    shown_channels,
    shown_groups,
    shown_rows,
    undecided_lines,
)
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.text import columns, show

if TYPE_CHECKING:
    from gonio.metrology.budget import Budget, Contribution
    from gonio.metrology.quantities import Quantities

OPTIONS: Options = {
    "--budget": "tables: each source's contribution to the standard uncertainty of every quantity, in the form of the "
    "GUM; what is neither stored nor stated is listed as not known",
    "--fit MODEL|FIT.toml|auto": "tables and profiles: the numbers of a fit too: of a model such as "
    "'lambert + ggx(eta=1.5)', of the model of a fit's file, or of a selected one",
    "--uncertainty NAME=U,...": "standard uncertainties of single terms, such as 'gain=0.5 %%, tilt=0.05 deg "
    "rectangular, theta_i=0.02 deg dof 12'; they go before those of --instrument and of the table",
    "--geometry G,...": "more reflectance factors, at theta_i:theta_o or theta_i:theta_o:delta_phi in degrees, such "
    "as 30:30:180 (the mirror direction); angles beyond 90 are behind the sample, such as 0:180 (straight through)",
    "--only GROUP,...": "groups to print, with the geometry that is integrated: albedo, reflectance, transmission, "
    "gloss, colour, multi-angle, scatter, retroreflection, 'remote sensing', 'scatter law', subsurface, or all",
    "--feature-width ANGLE": {
        "type": float,
        "default": 0.0,
        "help": "tables: nothing in f is narrower, degrees; where the mirror direction was not read",
    },
    "--port ANGLE": {
        "type": float,
        "default": 5.0,
        "help": "half-angle about the mirror direction, degrees, that 8°:de leaves out (default 5)",
    },
    "--illuminant NAME,...": "of colours: D65, A, or both (the default)",
    "--observer DEGREES": {"type": int, "choices": (2, 10), "default": 10, "help": "of colours (default 10)"},
    "--linear-srgb": "the channels R, G, B are linear sRGB, and have a colour by that",
    "--against FILE|MATERIAL": "colour differences (CIEDE2000) from another subject",
    "--monte-carlo N": "check the linear budget by N draws of all errors at once (JCGM 101:2008), such as 1000",
    "--seed SEED": {"default": 0, "help": "of these draws (default 0)"},
}
NOTHING = 5e-5
"""Per cent."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "What standards name, of a material or a table: albedos, reflectance factors (45°a:0°, 8°:di, 8°:de), "
        "gloss at 20, 60 and 85°, reflection haze, colour, the multi-angle set, total integrated scatter, "
        "retroreflection; of what transmits also transmittance, absorptance and haze. Each with the expanded "
        "uncertainty (k = 2) by the stored noise, the covariance of a fit and the bound of the integral, and undecided "
        "where the data do not reach; with --budget where it comes from."
    )
    what = "a table, a profile, a material's name, or an expression"
    parser.add_argument("subject", metavar="FILE|MATERIAL", help=what)
    add_options(parser.add_argument, OPTIONS | DESCRIPTION | READING | MERL | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.files import refuse_outputs

    refuse_outputs([args.json], [args.subject, args.instrument, args.fit], args.force)
    if args.monte_carlo is not None and not args.budget:
        raise GonioError("--monte-carlo checks a budget; give --budget too")
    if not args.budget and (args.uncertainty or args.instrument):
        raise GonioError("stated uncertainties belong to a budget; give --budget too")
    from gonio.instrument.description import read_instrument
    from gonio.metrology.quantities import quantities

    options: dict[str, Any] = {
        "budget": args.budget,
        "fit": args.fit,
        "monte_carlo": args.monte_carlo or 0,
        "seed": args.seed,
        "instrument": None if args.instrument is None else read_instrument(args.instrument),
        "uncertainty": stated_terms(args.uncertainty) if args.uncertainty else {},
        "geometries": _listed(args.geometry),
        "feature_width": args.feature_width,
        "port": args.port,
        "observer": args.observer,
        "linear_srgb": args.linear_srgb,
        "against": None if args.against is None else beside_stated(args.against, args),
    }
    only = _listed(args.only)
    if only and EVERYTHING not in only:
        options["only"] = only
    if args.illuminant:
        options["illuminants"] = _listed(args.illuminant)
    result = quantities(as_stated(args.subject, args), **options)
    show("\n".join(summary(result, only)))
    return write_json(args, result.to_dict())


def _listed(text: str | None) -> list[str]:
    return [part.strip() for part in text.split(",")] if text else []


def summary(result: "Quantities", only: list[str]) -> list[str]:
    """The quantities of some groups; with a budget what each source contributes to them, and what the sources are."""
    groups = shown_groups(result, only)
    lines = [f"{result.subject} ({result.kind})", ""]
    if result.budget is None:
        lines += plain_list(result, groups, bool(only))
    else:
        channels, rows = shown_channels(result), shown_rows(result, groups)
        heading = ["quantity", "at", *(["channel"] if len(channels) > 1 else [])]
        shown = [result.quantities[k] for k in rows]
        labels = [[q.name, q.place, q.channel][: len(heading)] for q in shown]
        lines += _with_budget(result, result.budget, rows, labels, heading)
    remarks = [*undecided_lines(result, groups), *(f"note: {note}" for note in result.notes)]
    blank = [""] if lines[-1] else []
    return [*lines, *blank, *remarks, *other_groups(result, groups)]


def _with_budget(
    result: "Quantities", b: "Budget", rows: list[int], labels: list[list[str]], heading: list[str]
) -> list[str]:
    cells: list[list[str]] = []
    parts: list[list[str]] = []
    known = [c for c in b.contributions if c.values.any() or (c.name == "interpolation" and b.unbounded.any())]
    for k in rows:
        value, u, expanded = result.quantities[k].value, float(b.standard[k]), float(b.expanded[k])
        relative = percent(expanded / abs(value)) if value else "–"
        cells.append(
            [result.quantities[k].text(expanded), _size(u), _freedom(float(b.dof[k])), _size(expanded), relative]
        )
        parts.append([_part(b, c, k, value) for c in known])
    titles = [*heading, "value", "u", "ν eff", "U (k = 2)", "U, relative"]
    lines = [columns([a + c for a, c in zip(labels, cells, strict=True)], titles), ""]
    lines += ["standard uncertainty by its sources, % of the value:"]
    lines += [columns([a + p for a, p in zip(labels, parts, strict=True)], [*heading, *(c.name for c in known)]), ""]
    sources = [[c.name, c.meaning, _input(c), c.shape, _freedom(c.dof), c.origin, _kind(c)] for c in known]
    titles = ["source", "what it is", "u of it", "distribution", "ν", "from", "errors of the readings"]
    lines += [columns(sources, titles), ""]
    if b.simulated is not None:
        lines += [*_simulated(b, rows, labels, heading), ""]
    if b.missing:
        lines += ["not known, and not in the above:"]
        lines += [f"  {name}: {why}" for name, why in b.missing.items()]
    return lines


def _simulated(b: "Budget", rows: list[int], labels: list[list[str]], heading: list[str]) -> list[str]:
    """What Monte Carlo gives beside the linear budget."""
    s = b.simulated
    assert s is not None
    cells: list[list[str]] = []
    for k in rows:
        low, high = (float(end) for end in s["interval_95.45_percent"][k])
        half = float(b.factor[k] * b.standard[k])
        agrees = "yes" if s["linear_agrees"][k] else "no"
        u, shift = float(s["standard_uncertainty"][k]), float(s["shift"][k])
        cells.append([_size(u), f"{shift:+.2g}", f"{low:+.3g} to {high:+.3g}", f"±{_size(half)}", agrees])
    titles = [*heading, "u", "shift", "95.45 %", "linear", "agrees"]
    return [
        f"Monte Carlo, {s['draws']:,} draws:",
        columns([a + c for a, c in zip(labels, cells, strict=True)], titles),
    ]


def _part(b: "Budget", c: "Contribution", k: int, value: float) -> str:
    if c.name == "interpolation" and b.unbounded[k]:
        return "no bound"
    share = 100 * abs(float(c.values[k])) / abs(value) if value else math.nan
    return "–" if math.isnan(share) else "0" if share < NOTHING else f"{share:.2g}"


def _kind(c: "Contribution") -> str:
    return "the same in all" if c.shared else "between them" if c.name == "interpolation" else "independent"


def _input(c: "Contribution") -> str:
    if c.standard is None:
        return "–"
    return f"{math.degrees(c.standard):.3g}°" if c.unit == "rad" else percent(c.standard, 3)


def _freedom(dof: float) -> str:
    return "∞" if math.isinf(dof) else f"{dof:.3g}"


def _size(u: float) -> str:
    return "no bound" if math.isinf(u) else f"{u:.2g}"
