"""Figures of what is judged (albedo, reciprocity, p-values, residuals, correlations), and of subjects side by side."""

import base64
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.checks.certificate import Property
from gonio.figures import diagnostics, sampling, spheres
from gonio.figures.diagnostics import AlbedoCurve, AlbedoSeries, draw_albedo
from gonio.figures.lobes import Curve, draw_in_plane
from gonio.figures.style import picture, size_for
from gonio.reports.subject import Evaluation, ReportFigure, ReportSubject, rounded

MOST_PAIRS = 1500
LONGEST = 22


class ReciprocityPairs(NamedTuple):
    """f, 1/sr, of pairs of directions and of the same exchanged, (n,) each, and which pairs they are."""

    f: np.ndarray
    exchanged: np.ndarray
    choice: str


def figures(s: ReportSubject, fit: dict[str, Any] | None) -> list[ReportFigure]:
    """The figures of a subject's certificate and of its fit, as far as it has them."""
    judged = _albedo_figures(s) + _reciprocity_figures(s)
    return judged + _residual_figures(s, (fit or {}).get("theta_max")) + _correlation_figures(s, fit or {})


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
    caption = "Directional albedo (the share of light that is reflected) with its bound; the dashed line is 1."
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
    shown = sampling.evenly_chosen(positive, MOST_PAIRS)
    if not shown.size:
        return []
    caption = f"Reciprocity, channel {s.channel}: light and detector exchanged; "
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
    from gonio.checks.table.scattered_pairs import both_ways, random_angles

    if s.table is not None:
        pairs = reciprocal_pairs(s.table)
        return None if isinstance(pairs, str) else ReciprocityPairs(pairs.a[:, s.shown], pairs.b[:, s.shown], pairs.how)
    angles = random_angles(np.radians(85.0), 2 * MOST_PAIRS)
    # Every second pair about the mirror direction, where lobes are.
    turn = np.random.default_rng(0).standard_normal((MOST_PAIRS, 2)) * np.radians(6.0)
    angles[::2, 2] = np.clip(np.abs(angles[::2, 0] + turn[:, 0]), 0, np.radians(88))
    angles[::2, 3] = angles[::2, 1] + np.pi + turn[:, 1]
    a, b = (sampling.of_channel(f, s.shown) for f in both_ways(s.model, angles))
    return ReciprocityPairs(a, b, "random pairs, half of them about the mirror direction")


def _residual_figures(s: ReportSubject, theta_max: float | None) -> list[ReportFigure]:
    """Residuals of the fit, by angles and by size; `theta_max`, radians, as in the fit."""
    if s.table is None or s.fitted is None:
        return []
    residuals = sampling.fit_residuals(s.table, s.fitted, theta_max)
    if not residuals.relative.size:
        return []
    limits = "" if theta_max is None else f", polar angles up to {np.degrees(theta_max):.4g}° as in the fit"
    figures = []
    for slug, axes, words in (
        ("residuals-half", ("theta_h", "theta_d"), "half and difference angle"),
        ("residuals-polar", ("theta_i", "theta_o"), "incident and outgoing angle"),
    ):
        across, up = (getattr(residuals.angles, a) for a in axes)
        grid = diagnostics.median_grid(across, up, residuals.relative, axes[0] == "theta_h")
        image = picture(f"Residuals of the fit to {s.name} by {words}", diagnostics.draw_residual_map, grid, axes)
        caption = f"Fit residuals by {words}, all channels{limits}: red: model brighter."
        edges = {f"{a}_edges_deg": rounded(edge, 5) for a, edge in zip(axes, grid, strict=False)}
        figures.append(ReportFigure(slug, caption, image, edges | {"median_percent": rounded(grid.median, 4)}))
    in_u = residuals.standardised.size > 0.5 * residuals.relative.size
    values = residuals.standardised if in_u else 100 * residuals.relative
    caption = "Residuals in standard uncertainties of the readings" if in_u else "Relative residuals, all channels"
    draw = diagnostics.draw_residual_histogram
    image = picture(f"Histogram of residuals of {s.name}", draw, values, in_u, s.look.colour)
    edges, density = diagnostics.residual_density(values, in_u)
    data = {"unit": "u_f" if in_u else "%", "edges": rounded(edges), "share_per_unit": rounded(density)}
    return [*figures, ReportFigure("residuals", f"{caption}{limits}.", image, data)]


def _correlation_figures(s: ReportSubject, fit: dict[str, Any]) -> list[ReportFigure]:
    """Correlations of the free parameters of a fit that holds them."""
    names, rows = fit.get("free_names") or [], fit.get("correlation") or []
    if len(names) < 2 or [len(row) for row in rows] != [len(names)] * len(names):
        return []
    values = names, np.array(rows, float)
    caption = "Correlations of the fitted numbers; empty where a number is not determined by the readings."
    label, size = f"Correlations of the numbers fitted to {s.name}", diagnostics.CORRELATIONS_SIZE
    image = picture(label, diagnostics.draw_correlations, *values, size=size)
    return [ReportFigure("correlations", caption, image, {"names": names, "correlation": rounded(values[1], 4)})]


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
    curves, data, angles = [], [], sampling.plane_angles(theta_i)
    for s, e in evaluated:
        for name, values in e.sources(s)[-1:]:
            f = values.compared[k]
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
            k = s.shown if len(series.names) > 1 else 0
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
    for _, values in e.sources(s)[:1]:
        pixels = spheres.sphere_pixels(values.spheres[0])
        return "data:image/png;base64," + base64.b64encode(spheres.png(pixels)).decode()
    return None
