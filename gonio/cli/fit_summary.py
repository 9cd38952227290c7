"""A fit's result as lines for a terminal."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from gonio.text import columns, number

if TYPE_CHECKING:
    from gonio.fitting.result import FitResult

METRIC_NAMES = {
    "relative_rms": "relative rms",
    "relative_rms_cosine": "with cosines",
    "median_relative": "median |Δ|/f",
    "log_rms": "log rms",
    "cbrt_rms": "cube-root rms",
    "bias": "bias (1/sr)",
    "reduced_chi2": "reduced χ²",
}
COUNT_NAMES = {"negative": "negative (used as they are)", "missing": "missing", "left_out": "left out as asked"}
CANDIDATE_COLUMNS: tuple[tuple[str, str, Callable[[Any], str]], ...] = (
    ("free", "free numbers", lambda v: str(v)),
    ("bic_above_best", "BIC above best", lambda v: number(v, 5)),
    ("held_out_above_best", "held-out error above best", lambda v: f"{100 * v:.2f} %"),
    ("relative_rms", "relative rms", lambda v: number(v, 3)),
    ("scene_error", "error in the scene", lambda v: f"{100 * v:.2g} %"),
    ("cost_ns", "ns an evaluation", lambda v: number(v, 3)),
    ("seconds", "s", lambda v: f"{v:.2f}"),
)


def summary(r: "FitResult") -> list[str]:
    """What is known of a fit, the numbers first."""
    floor = f" (floor {number(max(r.floor), 3)})" if r.loss in ("cbrt", "log") and r.floor else ""
    weighting = [f"{name} {kind}" for name, kind in (("weight", r.weight), ("robust", r.robust)) if kind]
    verdict = "converged" if r.converged else "NOT converged"
    unusual = {k: n for k, n in r.counts.items() if n and k not in ("used", "below_horizon")}
    counts = [f"{n} {COUNT_NAMES.get(k, f'masked as {k}')}" for k, n in unusual.items()]
    return [
        f"{r.requested} on {r.table}: {r.samples} readings, {', '.join([f'loss {r.loss}{floor}', *weighting])}",
        f"{verdict}: {r.reason}; {r.starts_agreed} of {r.starts} starts agree",
        *_free_numbers(r),
        "; ".join(f"{METRIC_NAMES.get(k, k)} {number(v, 3)}" for k, v in r.metrics.items()),
        *_colour_difference(r),
        *([f"readings: {', '.join(counts)}"] if counts else []),
        *(f"active bound: {name}" for name in r.active_bounds),
        *(f"undetermined: {sentence}" for sentence in r.undetermined),
        *(f"correlated: {c['a']} and {c['b']} by {number(c['correlation'], 4)}" for c in r.correlated),
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
    for p in (p for p in r.parameters if p.status != "fixed"):
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


def _colour_difference(r: "FitResult") -> list[str]:
    c = r.colour_difference
    if not c:
        return []
    return [f"a lit sphere: {c['name']} {number(c['mean'], 3)} in the mean, {number(c['p95'], 3)} at most over 95 %"]


def _interval(ends: Sequence[float]) -> str:
    return f"[{number(ends[0])}, {number(ends[1])}]"
