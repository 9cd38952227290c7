"""A fit on one screen: verdict, numbers, what is worst, what to do next; all of it is what ``-v`` prints."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from gonio.text import columns, number

if TYPE_CHECKING:
    from gonio.fitting.result import FitResult
    from gonio.fitting.uncertainty.optimum import ParameterEstimate

WIDTH, LINES = 100, 24
MOST_NUMBERS = 8
"""Free numbers that stand in lines of their own."""


class Passage(NamedTuple):
    """Some lines of the screen; those of the largest `rank` are left out first."""

    rank: int
    lines: list[str]


def screen(r: "FitResult", file: str, output: str) -> list[str]:
    """What a user needs to know of a fit, in at most `LINES` lines of `WIDTH` columns.

    Args:
        r: the fit.
        file: the table's name, for the commands to try next.
        output: where the fitted material is.
    """
    verdict = "converged" if r.converged else "NOT converged"
    of = f"{r.requested} on {r.table}: {r.readings_in_words}, loss {r.loss}"
    of += "".join(f", {name} {kind}" for name, kind in (("weight", r.weight), ("robust", r.robust)) if kind)
    words = {"relative_rms": "relative rms", "bias": "bias (1/sr)", "reduced_chi2": "reduced χ²"}
    words["largest_albedo"] = "largest albedo"
    metrics = "; ".join(f"{word} {number(r.metrics[k], 3)}" for k, word in words.items() if k in r.metrics)
    nuisance = [f"nuisance: {row['sentence']}" for row in r.nuisance or []]
    passages = [
        Passage(0, wrapped(r.judgement.sentence, 3)),
        Passage(1, wrapped(of, 2)),
        Passage(1, wrapped(f"{verdict}: {r.reason}; {r.starts_agreed} of {r.starts} starts agree", 2)),
        Passage(0, _numbers(r)),
        Passage(1, [line for s in nuisance for line in wrapped(s, 2)]),
        Passage(2, wrapped(metrics, 1)),
        Passage(4, _of_refits(r)),
        *(Passage(3, wrapped(f"undetermined: {s}", 2)) for s in r.undetermined[:1]),
        *(Passage(2, wrapped(f"residuals: {s}", 2)) for s in (r.residuals.sentences if r.residuals else [])[:1]),
        *(Passage(5, wrapped(f"note: {s}", 2)) for s in [s for s in r.notes if s not in nuisance][:2]),
        Passage(6, _of_candidates(r)),
        Passage(1, _next(r, file, output)),
        Passage(0, [f"written: {output}"]),
    ]
    while sum(len(p.lines) for p in passages) > LINES:
        passages.remove(max(reversed(passages), key=lambda p: p.rank))
    return [line for p in passages for line in p.lines]


def wrapped(text: str, most: int) -> list[str]:
    """A text in at most so many lines of `WIDTH` columns, the next ones indented."""
    return textwrap.wrap(text, WIDTH, subsequent_indent="  ", max_lines=most, placeholder=" ...")


def _numbers(r: "FitResult") -> list[str]:
    free = [p for p in r.parameters if p.status != "fixed"]
    groups: dict[str, list[ParameterEstimate]] = {}
    for p in free:
        groups.setdefault(p.label if len(free) <= MOST_NUMBERS or not p.channel else p.name, []).append(p)
    rows = [_row(name, estimates) for name, estimates in list(groups.items())[:MOST_NUMBERS]]
    if not rows:
        return []
    lines = columns(rows, ["number", "value", "std. unc.", "95 % interval", "status"]).splitlines()
    more = len(groups) - len(rows)
    return [line[:WIDTH] for line in lines] + ([f"{more} more numbers: -v lists them"] if more else [])


def _row(name: str, estimates: "Sequence[ParameterEstimate]") -> list[str]:
    """One number, or those of many channels: least and largest value, and largest uncertainty."""
    if len(estimates) == 1:
        p = estimates[0]
        low, high = p.interval95
        spread = f"[{number(low)}, {number(high)}]"
        return [p.label, number(p.value, 7), number(p.standard_uncertainty, 2), spread, p.status]
    values = [p.value for p in estimates]
    largest = max((p.standard_uncertainty for p in estimates), key=lambda u: (u == u, u))
    status = ", ".join(dict.fromkeys(p.status for p in estimates))
    ends = f"{number(min(values), 4)} to {number(max(values), 4)}"
    return [f"{name} ({len(estimates)} channels)", ends, f"up to {number(largest, 2)}", "-v lists them", status]


def _of_refits(r: "FitResult") -> list[str]:
    b = r.bootstrap
    return [] if not b else [f"bootstrap ({b['kind']}): {b['refits']} refits, {b['failed']} failed; -v shows them"]


def _of_candidates(r: "FitResult") -> list[str]:
    return [f"{len(r.alternatives)} models were tried; -v lists them, and why"] if r.alternatives else []


def _next(r: "FitResult", file: str, output: str) -> list[str]:
    """Commands to try next, by the verdict."""
    from gonio.fitting.judgement import FAILED, POOR

    if r.judgement.verdict in (FAILED, POOR):
        other = [] if r.alternatives else [f"gonio fit {file}  (without -m: selects a model)"]
        tries = [*other, f"gonio report {file} --fit {output} -o page.html  (where it is off)"]
    else:
        tries = [f"gonio check {output}", f"gonio report {file} --fit {output} -o page.html"]
        tries.append(f"gonio convert {output} scene.xml --to mitsuba  (or another renderer)")
    return [f"{'next: ' if k == 0 else '      '}{command}" for k, command in enumerate(tries)]
