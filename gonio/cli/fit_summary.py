"""What a fit says of itself on a terminal."""

from gonio.cli.tried import tried
from gonio.text import columns, number

METRIC_NAMES = {
    "relative_rms": "relative rms",
    "relative_rms_cosine": "with cosines",
    "median_relative": "median |Δ|/f",
    "log_rms": "log rms",
    "cbrt_rms": "cube-root rms",
    "bias": "bias (1/sr)",
    "reduced_chi2": "reduced χ²",
}


def summary(r) -> list[str]:
    """What a fit says of itself, in lines."""
    how = [
        f"loss {r.loss}" + (f" (floor {number(max(r.floor), 3)})" if r.loss in ("cbrt", "log") and r.floor else ""),
        *([f"weight {r.weight}"] if r.weight else []),
        *([f"robust {r.robust}"] if r.robust else []),
    ]
    lines = [f"{r.asked} on {r.table}: {r.samples} readings, {', '.join(how)}"]
    lines.append(
        f"{'converged' if r.converged else 'NOT converged'}: {r.reason}; {r.starts_agreed} of {r.starts} starts agree"
    )
    drawn = {n["name"]: n for n in (r.bootstrap or {}).get("numbers", [])}
    rows = []
    for p in (p for p in r.parameters if p.status != "fixed"):
        row = [p.label, number(p.value, 8), number(p.standard_uncertainty, 2), _interval(p.interval95), p.status]
        if again := drawn.get(p.label):
            row[3:3] = [number(again["standard_uncertainty"], 2), _interval(again["interval95"])]
            row.pop(5)
        rows.append(row)
    if rows:
        of_draws = ["bootstrap", "95 % of refits"] if drawn else ["95 % interval"]
        lines.append(columns(rows, ["number", "value", "std. unc.", *of_draws, "status"]))
    if r.bootstrap:
        b = r.bootstrap
        lines.append(
            f"bootstrap ({b['kind']}): {b['refits']} refits, {b['failed']} failed; "
            f"{max(b['blocks'])} blocks of {max(b['block_cells'])} neighbouring cells"
        )
    lines.append("; ".join(f"{METRIC_NAMES.get(k, k)} {number(v, 3)}" for k, v in r.metrics.items()))
    if r.colour_difference:
        c = r.colour_difference
        lines.append(
            f"a lit sphere: {c['name']} {number(c['mean'], 3)} in the mean, {number(c['p95'], 3)} at most over 95 %"
        )
    lines += [_counted(r)] if _counted(r) else []
    lines += [f"active bound: {name}" for name in r.active_bounds]
    lines += [f"undetermined: {words}" for words in r.undetermined]
    lines += [f"correlated: {c['a']} and {c['b']} by {number(c['correlation'], 4)}" for c in r.correlated]
    lines += [f"residuals: {words}" for words in (r.residuals.sentences if r.residuals else [])]
    lines += [f"note: {words}" for words in r.notes]
    if r.alternatives:
        lines.append(tried(r.alternatives))
    return lines


def _interval(ends) -> str:
    return f"[{number(ends[0])}, {number(ends[1])}]"


def _counted(r) -> str:
    """What became of readings that are no ordinary ones; empty where there are none."""
    words = {"negative": "negative (used as they are)", "missing": "missing", "left_out": "left out as asked"}
    said = []
    for key, count in r.counts.items():
        if count and key not in ("used", "below_horizon"):
            said.append(f"{count} {words.get(key, f'masked as {key}')}")
    return f"readings: {', '.join(said)}" if said else ""
