"""The picture that stray light is read from: f against |sinθs − sinθi|, log-log, with ABg and Harvey–Shack's law."""

import numpy as np

from gonio.data.channels import Channels
from gonio.figures.reading_plots import MOST_GROUPS, Points
from gonio.figures.scatter_plots import LawCurve, draw_scatter
from gonio.figures.style import colour_of, picture, size_for
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards import scatter_law
from gonio.models.folded import seen_from
from gonio.models.geometry.sides import FRONT, Hemispheres, side_in_words
from gonio.reports.evaluation import Evaluation, ReportFigure, rounded
from gonio.reports.subject import ReportSubject

MOST_POINTS = 1500
FALLS = 10.0
"""Largest over smallest f from which on there is something to see."""
NEAREST = 1e-4
"""Offsets below it are the mirror direction itself."""
CURVE = 60


def figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """A picture for each pair of sides of the light and the detector; none of what hardly depends on the offset."""
    return [figure for pair in _sides(s, e) if (figure := _figure(s, *pair)) is not None]


def _sides(s: ReportSubject, e: Evaluation) -> list[tuple[int, int]]:
    """Of light from the front, and from behind where that differs; not of what is refracted, nowhere straight on."""
    if s.table is not None:
        present, (index_front, index_behind) = s.table.sides, s.table.media
        refracts = bool(np.any(index_front != index_behind))
    else:
        into = s.model.hemispheres
        of = {(1, 1): Hemispheres.REFLECTION, (-1, -1): Hemispheres.BACK}
        of |= dict.fromkeys(((1, -1), (-1, 1)), Hemispheres.TRANSMISSION)
        present = frozenset(pair for pair, way in of.items() if way in into)
        refracts = bool(np.any(np.asarray(s.model.index_behind) != 1.0))
    lit = (1,) if s.table is None and e.behind is None else (1, -1)
    pairs = [(light, detector) for light in lit for detector in (light, -light)]
    return [pair for pair in pairs if pair in present and not (refracts and pair[0] != pair[1])]


def _figure(s: ReportSubject, light: int, detector: int) -> ReportFigure | None:
    profile = _profile(s, light, detector)
    if profile is None:
        return None
    x, f = profile.offset, profile.f[:, min(s.shown, profile.f.shape[1] - 1)]
    use = np.flatnonzero((f > 0) & (x > NEAREST))
    if use.size < scatter_law.FEWEST or f[use].max() < FALLS * f[use].min():
        return None
    use = use[:: -(-use.size // MOST_POINTS)]
    points = _points(s, profile, f, use)
    one = scatter_law.Profile(profile.theta_i, x, f[:, None])
    rows = scatter_law.scatter_laws(one, Channels.grey())[0]
    laws = _curves(rows, float(x[use].min()), float(x[use].max()))
    numbers = {q.name: q.value for q in rows if q.unit == "1"}
    named = " and ".join(f"{law.label}, {_scatter_about(rows, law.label)}" for law in laws) or "no law follows it"
    front = (light, detector) == (1, 1)
    way = "" if front else f"{side_in_words(light, detector)}; "
    title = f"f of {s.name} against the difference of sines" + ("" if front else f", {side_in_words(light, detector)}")
    caption = f"f in the plane of incidence against |sinθₛ − sinθᵢ|, {way}{s.in_channel}; fitted in log f: {named}."
    data = {
        "channel": s.channel, "laws": {k: rounded(v) for k, v in numbers.items()},
        "sets": [{"theta_i_deg": theta, "offset": rounded(p.x), "f_per_sr": rounded(p.f)} for theta, p in points],
    } | ({} if front else {"sides": [light, detector]})  # fmt: skip
    image = picture(
        title, draw_scatter, [p for _, p in points], laws,
        size=size_for([p.label for _, p in points] + [law.label for law in laws]),
    )  # fmt: skip
    slug = "scatter" + "-through" * (light != detector) + "-lit-behind" * (light < 0)
    return ReportFigure(slug, caption, image, data)


def _points(
    s: ReportSubject, profile: scatter_law.Profile, f: np.ndarray, use: np.ndarray
) -> list[tuple[float, Points]]:
    """(incidence in degrees, its points) of the places that are drawn."""
    theta = np.round(np.degrees(profile.theta_i[use]), 3)
    nodes = np.unique(theta)
    if nodes.size > MOST_GROUPS:
        nodes = nodes[np.linspace(0, nodes.size - 1, MOST_GROUPS).astype(int)]
    each = [(float(t), use[theta == t], colour_of(s.number + k).colour) for k, t in enumerate(nodes)]
    unknown = np.full(use.size, np.nan)
    return [(t, Points(profile.offset[k], f[k], unknown[: k.size], f"θᵢ {t:g}°", colour)) for t, k, colour in each]


def _profile(s: ReportSubject, light: int, detector: int) -> scatter_law.Profile | None:
    if s.table is None:
        return scatter_law.of_model(seen_from(s.model, light, detector))
    if s.empty or s.table.layout.in_half_vectors or s.table.interpolant is not None:
        return None
    return scatter_law.of_table(s.table if s.table.sides == FRONT else s.table.parts()[light, detector])


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
