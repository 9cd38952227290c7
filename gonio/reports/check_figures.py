"""Figures of what is judged: albedo, reciprocity and its p-values; and of subjects side by side."""

import base64
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.checks.certificate import NOT_TESTABLE, UNDECIDED, Property
from gonio.figures import diagnostics, readings, sampling, spheres
from gonio.figures.diagnostics import AlbedoCurve, AlbedoSeries, draw_albedo
from gonio.figures.lobes import Curve, draw_in_plane
from gonio.figures.style import picture, size_for
from gonio.reports.evaluation import Evaluation, ReportFigure, rounded
from gonio.reports.subject import ReportSubject

MOST_PAIRS = 1500
LONGEST = 22


class ReciprocityPairs(NamedTuple):
    """f, 1/sr, of pairs of directions and of the same exchanged, (n,) each, and which pairs they are."""

    f: np.ndarray
    exchanged: np.ndarray
    choice: str


def few_pairs(s: ReportSubject) -> dict[str, Any] | None:
    """The reciprocal pairs of a table that has too few to be judged, one by one; None where it has none, or many."""
    from gonio.checks.table.evidence import reciprocal_pairs
    from gonio.checks.table.pairs.pairs import FEWEST
    from gonio.checks.table.polarisations import with_exchanged_states

    verdict = property_of(s, "reciprocity")
    if s.table is None or verdict is None or verdict.verdict not in (UNDECIDED, NOT_TESTABLE):
        return None
    pairs = reciprocal_pairs(s.table)
    if isinstance(pairs, str) or not 0 < len(pairs) < FEWEST:
        return None
    a, b, u_a, u_b, _ = with_exchanged_states(pairs, s.channels.names).column(s.shown)
    u = np.hypot(u_a, u_b)
    with np.errstate(divide="ignore", invalid="ignore"):
        over_u = np.where(u > 0, (a - b) / u, np.nan)
        percent = 200 * (a - b) / (np.abs(a) + np.abs(b))
    columns = zip(np.degrees(pairs.angles), a, b, percent, over_u, strict=True)
    rows = [
        {"angles_deg": rounded(angles), "f_per_sr": rounded(f), "exchanged_per_sr": rounded(g),
         "difference_percent": rounded(p, 4), "difference_over_u": rounded(d, 4)}
        for angles, f, g, p, d in columns if np.isfinite(f + g)
    ]  # fmt: skip
    return {"channel": s.in_channel, "how": pairs.how, "rows": rows} if rows else None


def figures(s: ReportSubject) -> list[ReportFigure]:
    """The figures of a subject's certificate, as far as it has them."""
    return _albedo_figures(s) + _reciprocity_figures(s)


def property_of(s: ReportSubject, name: str) -> Property | None:
    """A property of a subject's certificate, if it has one."""
    properties = [] if s.certificate is None else s.certificate.properties
    return next((p for p in properties if p.name == name), None)


def _albedo_of(s: ReportSubject) -> AlbedoSeries | None:
    energy = property_of(s, "energy")
    return None if energy is None else diagnostics.albedo_series(energy, s.channels)


def _albedo_figures(s: ReportSubject) -> list[ReportFigure]:
    series = _albedo_of(s)
    if series is None:
        return []
    curves = series.curves(s.look.colour, "o" if s.table is not None else None)
    energy = property_of(s, "energy")
    both = energy is not None and "transmittance" in energy.facts
    share = "sent out into the hemispheres that were read" if both else "reflected"
    caption = f"Directional albedo (the share of light that is {share}) with its bound; the dashed line is 1."
    if len(curves) < len(series.names):
        caption += f" {len(curves)} of {len(series.names)} channels."
    if not all(np.isfinite(c.bound).all() for c in curves):
        caption += " Where no band is drawn the albedo has no bound: the grid does not resolve the lobe there."
    data = {
        "theta_i_deg": rounded(series.theta_i), "channels": list(series.names), "albedo": rounded(series.albedo),
        "bound": rounded(series.bound),
    }  # fmt: skip
    label = f"Directional albedo of {s.name} against the angle of incidence"
    image = picture(label, draw_albedo, curves, size=size_for([c.label for c in curves]))
    return [ReportFigure("albedo", caption, image, data)]


def _reciprocity_figures(s: ReportSubject) -> list[ReportFigure]:
    """f(wi, wo) against f(wo, wi), and the p-values over angles where uncertainties are stored."""
    verdict = property_of(s, "reciprocity")
    pairs = None if verdict is None else _pairs(s)
    return [] if verdict is None or pairs is None else _scatter(s, pairs, verdict.tolerance) + _p_values(s, verdict)


def _scatter(s: ReportSubject, pairs: ReciprocityPairs, tolerance: float | None) -> list[ReportFigure]:
    a, b = pairs.f, pairs.exchanged
    usable = np.isfinite(a) & np.isfinite(b)
    positive = np.flatnonzero(usable & (a > 0) & (b > 0))
    not_positive = int(usable.sum()) - positive.size
    shown = readings.evenly_chosen(positive, MOST_PAIRS)
    if not shown.size:
        return []
    caption = f"Reciprocity, {s.in_channel}: light and detector exchanged; "
    caption += f"{shown.size:,} of {positive.size:,} {pairs.choice}."
    if not_positive:
        caption += f" {not_positive:,} pairs with a value of 0 or less cannot be drawn."
    if tolerance is not None and tolerance >= 1e-3:
        caption += f" Grey: within {tolerance:.3g}."
    label = f"f of {s.name} with the directions exchanged against f"
    values = a[shown], b[shown], tolerance, s.look.colour
    image = picture(label, diagnostics.draw_reciprocity, *values, size=diagnostics.SCATTER_SIZE)
    data = {
        "channel": s.channel, "f_per_sr": rounded(a[shown]), "f_exchanged_per_sr": rounded(b[shown]),
        "pairs": positive.size, "not_positive": not_positive,
    }  # fmt: skip
    return [ReportFigure("reciprocity", caption, image, data)]


def _p_values(s: ReportSubject, verdict: Property) -> list[ReportFigure]:
    p: Any = verdict.series.get("p_map")
    if not p or not p.get("theta_deg"):
        return []
    level = verdict.facts.get("level", 0.01)
    caption = "p-values of reciprocity by both polar angles, each corrected for the pairs in its square; "
    caption += f"bold: below the level {level:g}."
    values = np.array(p["theta_deg"]), np.array(p["p"], float), level
    image = picture(f"p-values of the reciprocity of {s.name}", diagnostics.draw_p_values, *values)
    return [ReportFigure("p-values", caption, image, {"level": level, **p})]


def _pairs(s: ReportSubject) -> ReciprocityPairs | None:
    from gonio.checks.table.evidence import reciprocal_pairs
    from gonio.checks.table.pairs.warped_pairs import both_ways, random_angles
    from gonio.checks.table.polarisations import with_exchanged_states

    if s.table is not None:
        pairs = reciprocal_pairs(s.table)
        if isinstance(pairs, str):
            return None
        a, b = with_exchanged_states(pairs, s.channels.names).column(s.shown)[:2]
        return None if len(pairs) and np.isnan(a).all() else ReciprocityPairs(a, b, pairs.how)
    angles = random_angles(np.radians(85.0), 2 * MOST_PAIRS)
    # Every second pair about the mirror direction, where lobes are.
    turn = np.random.default_rng(0).standard_normal((MOST_PAIRS, 2)) * np.radians(6.0)
    angles[::2, 2] = np.clip(np.abs(angles[::2, 0] + turn[:, 0]), 0, np.radians(88))
    angles[::2, 3] = angles[::2, 1] + np.pi + turn[:, 1]
    a, b = (sampling.of_channel(f, s.shown) for f in both_ways(s.model, angles))
    return ReciprocityPairs(a, b, "random pairs, half of them about the mirror direction")


def shortened(name: str) -> str:
    """A name that fits a legend of two columns."""
    return name if len(name) <= LONGEST else name[: LONGEST - 9] + "…" + name[-8:]


def comparison_figures(evaluated: Sequence[tuple[ReportSubject, Evaluation]]) -> list[ReportFigure]:
    """Lobes and albedo of several subjects in one colour each; none for a single one."""
    in_plane = [_compared_lobes(evaluated, k, theta_i) for k, theta_i in enumerate(sampling.COMPARED)]
    return [f for f in (*in_plane, _compared_albedos([s for s, _ in evaluated])) if f is not None]


def _compared_lobes(
    evaluated: Sequence[tuple[ReportSubject, Evaluation]], k: int, theta_i: float
) -> ReportFigure | None:
    shown = [values for _, e in evaluated for _, values in (e.models or e.sources)[:1]]
    behind = bool(shown) and all(values.maps_behind for values in shown)
    curves, data, angles = [], [], sampling.plane_angles(theta_i, behind)
    for s, e in evaluated:
        for name, values in (e.models or e.sources)[:1]:
            f = values.compared[k]
            if f.size > angles.size:  # beside what only reflects
                f = f[np.abs(sampling.plane_angles(theta_i, behind=True)) < 90]
            if not np.isfinite(f).any():
                continue
            curves.append(Curve(angles, f, shortened(s.name), s.look.colour, s.look.dash))
            data.append({"subject": s.name, "channel": s.channel, "of": name, "f_per_sr": rounded(f)})
    if len(curves) < 2:
        return None
    caption = f"In the plane of incidence, θᵢ = {theta_i:g}°, the middle channel of each. Tables: the fitted model "
    caption += "where there is one, else the readings, interpolated."
    label = f"f of all subjects in the plane of incidence, incidence {theta_i:g}°"
    image = picture(label, draw_in_plane, curves, True, size=size_for([c.label for c in curves]))
    data = {"theta_i_deg": theta_i, "theta_o_deg": np.round(angles, 4), "all": data}
    return ReportFigure(f"lobes-{theta_i:g}", caption, image, data)


def _compared_albedos(subjects: Sequence[ReportSubject]) -> ReportFigure | None:
    curves, data = [], []
    for s in subjects:
        series = _albedo_of(s)
        if series is not None:
            k = series.names.index(s.channel) if s.channel in series.names else len(series.names) // 2
            x, albedo, bound = series.theta_i, series.albedo[k], series.bound[k]
            curves.append(AlbedoCurve(x, albedo, bound, shortened(s.name), s.look.colour, dash=s.look.dash))
            numbers = {"theta_i_deg": rounded(x), "albedo": rounded(albedo), "bound": rounded(bound)}
            data.append({"subject": s.name, "channel": series.names[k], **numbers})
    if len(curves) < 2:
        return None
    caption = "Directional albedo, the middle channel of each, with its bound where there is one; the dashed line is 1."
    size = size_for([c.label for c in curves])
    image = picture("Directional albedo of all subjects", draw_albedo, curves, size=size)
    return ReportFigure("albedo", caption, image, {"all": data})


def sphere_of(s: ReportSubject, e: Evaluation) -> str | None:
    """A small sphere under the first light as the data of an image; None where there is none."""
    for _, values in [source for source in e.sources if source[1].known_of_sphere >= sampling.LEAST_KNOWN][:1]:
        pixels = spheres.sphere_pixels(values.spheres[0])
        return "data:image/png;base64," + base64.b64encode(spheres.png(pixels)).decode()
    return None
