"""The models that a fit tried, as a table for a terminal."""

from typing import Any

from gonio.text import columns, number

_COLUMNS = (
    ("free", "free numbers", lambda v: str(v)),
    ("bic_above_best", "BIC above best", lambda v: number(v, 5)),
    ("held_out_above_best", "held-out error above best", lambda v: f"{100 * v:.2f} %"),
    ("relative_rms", "relative rms", lambda v: number(v, 3)),
    ("scene_error", "error in the scene", lambda v: f"{100 * v:.2g} %"),
    ("cost_ns", "ns an evaluation", lambda v: number(v, 3)),
    ("seconds", "s", lambda v: f"{v:.2f}"),
)


def tried(alternatives: list[dict[str, Any]]) -> str:
    """One line for each model tried, with whatever is known of it and why it was taken or left."""
    known = [c for c in _COLUMNS if any(c[0] in a for a in alternatives)]
    rows = []
    for a in alternatives:
        why = a.get("refused") or a.get("verdict") or ("" if a["converged"] else "not converged")
        rows.append([a["model"], *(form(a[key]) if key in a else "–" for key, _, form in known), why])
    return columns(rows, ["tried", *(heading for _, heading, _ in known), ""])
