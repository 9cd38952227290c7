"""The picture that stray light is read from: f against |sinθs − sinθi|, log-log, with ABg and Harvey–Shack's law."""

import numpy as np

from gonio.data.channels import Channels
from gonio.figures.reading_plots import MOST_GROUPS, Points
from gonio.figures.scatter_plots import LawCurve, draw_scatter
from gonio.figures.style import colour_of, picture, size_for
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards import scatter_law
from gonio.reports.evaluation import ReportFigure, rounded
from gonio.reports.subject import ReportSubject

MOST_POINTS = 1500
FALLS = 10.0
"""Largest over smallest f from which on there is something to see."""
NEAREST = 1e-4
"""Offsets below it are the mirror direction itself."""
CURVE = 60


def figures(s: ReportSubject) -> list[ReportFigure]:
    """The picture of a model, or of readings in the plane of incidence; none of what hardly depends on the offset."""
    profile = _profile(s)
    if profile is None:
        return []
    x, f = profile.offset, profile.f[:, s.shown]
    use = np.flatnonzero((f > 0) & (x > NEAREST))
    if use.size < scatter_law.FEWEST or f[use].max() < FALLS * f[use].min():
        return []
    use = use[:: -(-use.size // MOST_POINTS)]
    theta = np.round(np.degrees(profile.theta_i[use]), 3)
    nodes = np.unique(theta)
    if nodes.size > MOST_GROUPS:
        nodes = nodes[np.linspace(0, nodes.size - 1, MOST_GROUPS).astype(int)]
    places = [(use[theta == t], f"θᵢ {t:g}°", colour_of(s.number + k).colour) for k, t in enumerate(nodes)]
    points = [Points(x[k], f[k], np.full(k.size, np.nan), label, colour) for k, label, colour in places]
    one = scatter_law.Profile(profile.theta_i, x, f[:, None])
    rows = scatter_law.scatter_laws(one, Channels.grey())[0]
    laws = _curves(rows, float(x[use].min()), float(x[use].max()))
    numbers = {q.name: q.value for q in rows if q.unit == "1"}
    named = " and ".join(f"{law.label}, {_scatter_about(rows, law.label)}" for law in laws) or "no law follows it"
    caption = f"f in the plane of incidence against |sinθₛ − sinθᵢ|, {s.in_channel}; fitted in log f: {named}."
    data = {
        "channel": s.channel, "laws": {k: rounded(v) for k, v in numbers.items()},
        "sets": [{"theta_i_deg": float(t), "offset": rounded(p.x), "f_per_sr": rounded(p.f)}
                 for t, p in zip(nodes, points, strict=True)],
    }  # fmt: skip
    image = picture(
        f"f of {s.name} against the difference of sines", draw_scatter, points, laws,
        size=size_for([p.label for p in points] + [law.label for law in laws]),
    )  # fmt: skip
    return [ReportFigure("scatter", caption, image, data)]


def _profile(s: ReportSubject) -> scatter_law.Profile | None:
    if s.table is None:
        return scatter_law.of_model(s.model)
    if s.empty or s.table.layout.in_half_vectors or s.table.interpolant is not None:
        return None
    return scatter_law.of_table(s.table)


def _scatter_about(rows: list[Quantity], law: str) -> str:
    """How far readings are from a law, in words."""
    geometry = next(q.geometry for q in rows if q.name.startswith(law))
    return geometry.split(";")[0].removeprefix("fitted in log f, ")


def _curves(rows: list[Quantity], low: float, high: float) -> list[LawCurve]:
    """The fitted laws between two offsets."""
    x, known = np.geomspace(low, high, CURVE), {q.name: q.value for q in rows}
    curves = []
    if "ABg A" in known:
        a, b, g = (known[f"ABg {n}"] for n in "ABg")
        curves.append(LawCurve(x, a / (b + x**g), "ABg", "-"))
    if "Harvey–Shack b0" in known:
        b0, length, slope = (known[f"Harvey–Shack {n}"] for n in ("b0", "l", "s"))
        curves.append(LawCurve(x, b0 * (1 + (x / length) ** 2) ** (slope / 2), "Harvey–Shack", "--"))
    return curves
