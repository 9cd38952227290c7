"""Figures of what is judged (albedo, reciprocity, p-values, residuals, correlations), and of subjects side by side."""

import base64
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.checks.certificate import Property
from gonio.figures.diagnostics import (
    CORRELATIONS_SIZE,
    SCATTER_SIZE,
    AlbedoCurve,
    AlbedoSeries,
    albedo_series,
    draw_albedo,
    draw_correlations,
    draw_p_values,
    draw_reciprocity,
    draw_residual_histogram,
    draw_residual_map,
    median_grid,
    residual_density,
)
from gonio.figures.lobes import Curve, draw_in_plane
from gonio.figures.spheres import png, sphere_pixels
from gonio.figures.style import colour_of, picture, size_for
from gonio.figures.values import COMPARED, evenly_chosen, fit_residuals, plane_angles
from gonio.reports.subject import Evaluation, ReportFigure, ReportSubject, rounded

MOST_PAIRS = 1500


class ReciprocityPairs(NamedTuple):
    """f, 1/sr, of pairs of directions and of the same exchanged, (n,) each, and which pairs they are."""

    f: np.ndarray
    exchanged: np.ndarray
    choice: str


def property_of(s: ReportSubject, name: str) -> Property | None:
    """A property of a subject's certificate, if it has one."""
    properties = [] if s.certificate is None else s.certificate.properties
    return next((p for p in properties if p.name == name), None)


def albedo_of(s: ReportSubject) -> AlbedoSeries | None:
    """The directional albedos of a subject's certificate."""
    energy = property_of(s, "energy")
    return None if energy is None else albedo_series(energy, s.channels)


def albedo_figures(s: ReportSubject) -> list[ReportFigure]:
    """Directional albedo by channel."""
    series = albedo_of(s)
    if series is None:
        return []
    curves = series.curves(colour_of(s.number).colour, "o" if s.table is not None else None)
    caption = "Directional albedo (the share of light that is reflected) with its bound; the dashed line is 1."
    if len(curves) < len(series.names):
        caption += f" {len(curves)} of {len(series.names)} channels."
    if not all(np.isfinite(c.bound).all() for c in curves):
        caption += " Where no band is image the albedo has no bound: the grid does not resolve the lobe there."
    data = {
        "theta_i_deg": rounded(series.theta_i), "channels": list(series.names), "albedo": rounded(series.albedo),
        "bound": rounded(series.bound),
    }  # fmt: skip
    label = f"Directional albedo of {s.name} against the angle of incidence"
    return [
        ReportFigure(
            "albedo", caption, picture(label, draw_albedo, curves, size=size_for([c.label for c in curves])), data
        )
    ]


def reciprocity_figures(s: ReportSubject) -> list[ReportFigure]:
    """f(wi, wo) against f(wo, wi), and the p-values over angles where uncertainties are stored."""
    verdict = property_of(s, "reciprocity")
    pairs = None if verdict is None else _pairs(s)
    if verdict is None or pairs is None:
        return []
    return _scatter(s, pairs, verdict.tolerance) + _p_values(s, verdict)


def _scatter(s: ReportSubject, pairs: ReciprocityPairs, tolerance: float | None) -> list[ReportFigure]:
    a, b = pairs.f, pairs.exchanged
    usable = np.isfinite(a) & np.isfinite(b)
    positive = np.flatnonzero(usable & (a > 0) & (b > 0))
    not_positive = int(usable.sum()) - positive.size
    shown = evenly_chosen(positive, MOST_PAIRS)
    if not shown.size:
        return []
    caption = (
        f"Reciprocity, channel {s.channel}: light and detector exchanged; {shown.size:,} of {positive.size:,} "
        f"{pairs.choice}."
    )
    if not_positive:
        caption += f" {not_positive:,} pairs with a value of 0 or less cannot be image."
    if tolerance is not None and tolerance >= 1e-3:
        caption += f" Grey: within {tolerance:.3g}."
    label = f"f of {s.name} with the directions exchanged against f"
    colour = colour_of(s.number).colour
    image = picture(label, draw_reciprocity, a[shown], b[shown], tolerance, colour, size=SCATTER_SIZE)
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
    caption = (
        "p-values of reciprocity by both polar angles, each corrected for the pairs in its square; bold: below the "
        f"level {level:g}."
    )
    label = f"p-values of the reciprocity of {s.name}"
    image = picture(label, draw_p_values, np.array(p["theta_deg"]), np.array(p["p"], float), level)
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
    a, b = both_ways(s.model, angles)
    k = s.shown if a.shape[1] > 1 else 0
    return ReciprocityPairs(a[:, k], b[:, k], "random pairs, half of them about the mirror direction")


def residual_figures(s: ReportSubject, theta_max: float | None) -> list[ReportFigure]:
    """Residuals of the fit, by angles and by size; `theta_max`, radians, as in the fit."""
    if s.table is None or s.fitted is None:
        return []
    residuals = fit_residuals(s.table, s.fitted, theta_max)
    if not residuals.relative.size:
        return []
    limits = "" if theta_max is None else f", polar angles up to {np.degrees(theta_max):.4g}° as in the fit"
    figures = []
    for slug, axes, words in (
        ("residuals-half", ("theta_h", "theta_d"), "half and difference angle"),
        ("residuals-polar", ("theta_i", "theta_o"), "incident and outgoing angle"),
    ):
        across, up = (getattr(residuals.angles, a) for a in axes)
        grid = median_grid(across, up, residuals.relative, axes[0] == "theta_h")
        image = picture(f"Residuals of the fit to {s.name} by {words}", draw_residual_map, grid, axes)
        caption = f"Fit residuals by {words}, all channels{limits}: red: model brighter."
        edges = {f"{a}_edges_deg": rounded(edge, 5) for a, edge in zip(axes, grid, strict=False)}
        figures.append(ReportFigure(slug, caption, image, edges | {"median_percent": rounded(grid.median, 4)}))
    in_u = residuals.standardised.size > 0.5 * residuals.relative.size
    values = residuals.standardised if in_u else 100 * residuals.relative
    caption = "Residuals in standard uncertainties of the readings" if in_u else "Relative residuals, all channels"
    label = f"Histogram of residuals of {s.name}"
    image = picture(label, draw_residual_histogram, values, in_u, colour_of(s.number).colour)
    edges, density = residual_density(values, in_u)
    data = {"unit": "u_f" if in_u else "%", "edges": rounded(edges), "share_per_unit": rounded(density)}
    return [*figures, ReportFigure("residuals", f"{caption}{limits}.", image, data)]


def correlation_figures(s: ReportSubject, fit: dict | None) -> list[ReportFigure]:
    """Correlations of the free parameters of a fit that holds them."""
    names = (fit or {}).get("free_names") or []
    rows = (fit or {}).get("correlation") or []
    if len(names) < 2 or [len(row) for row in rows] != [len(names)] * len(names):
        return []
    correlation = np.array(rows, float)
    caption = "Correlations of the fitted numbers; empty where a number is not determined by the readings."
    label = f"Correlations of the numbers fitted to {s.name}"
    image = picture(label, draw_correlations, names, correlation, size=CORRELATIONS_SIZE)
    return [ReportFigure("correlations", caption, image, {"names": names, "correlation": rounded(correlation, 4)})]


LONGEST = 22


def shortened(name: str) -> str:
    """A name that fits a legend of two columns."""
    return name if len(name) <= LONGEST else name[: LONGEST - 9] + "…" + name[-8:]


def comparison_figures(evaluated: Sequence[tuple[ReportSubject, Evaluation]]) -> list[ReportFigure]:
    """Figures of several subjects at once; none for a single one."""
    if len(evaluated) < 2:
        return []
    lobes = [_lobes(evaluated, k, theta_i) for k, theta_i in enumerate(COMPARED)]
    return [f for f in (*lobes, _albedo([s for s, _ in evaluated])) if f is not None]


def _lobes(evaluated: Sequence[tuple[ReportSubject, Evaluation]], k: int, theta_i: float) -> ReportFigure | None:
    curves, data = [], []
    for s, e in evaluated:
        sources = e.sources(s)
        if sources:
            name, values = sources[-1]
            style = colour_of(s.number)
            f = values.compared[k]
            curves.append(Curve(plane_angles(theta_i), f, shortened(s.name), style.colour, style.dash))
            data.append({"subject": s.name, "channel": s.channel, "of": name, "f_per_sr": rounded(f)})
    if len(curves) < 2:
        return None
    caption = (
        f"In the plane of incidence, θᵢ = {theta_i:g}°, the middle channel of each. Tables: the fitted model "
        "where there is one, else the readings, interpolated."
    )
    label = f"f of all subjects in the plane of incidence, incidence {theta_i:g}°"
    image = picture(label, draw_in_plane, curves, True, size=size_for([c.label for c in curves]))
    angles = np.round(plane_angles(theta_i), 4)
    data = {"theta_i_deg": theta_i, "theta_o_deg": angles, "all": data}
    return ReportFigure(f"lobes-{theta_i:g}", caption, image, data)


def _albedo(subjects: Sequence[ReportSubject]) -> ReportFigure | None:
    curves, data = [], []
    for s in subjects:
        series = albedo_of(s)
        if series is not None:
            k = s.shown if len(series.names) > 1 else 0
            style = colour_of(s.number)
            albedo, bound = series.albedo[k], series.bound[k]
            curves.append(AlbedoCurve(series.theta_i, albedo, bound, shortened(s.name), style.colour, dash=style.dash))
            data.append(
                {"subject": s.name, "channel": series.names[k], "theta_i_deg": rounded(series.theta_i),
                 "albedo": rounded(albedo), "bound": rounded(bound)}
            )  # fmt: skip
    if len(curves) < 2:
        return None
    caption = "Directional albedo, the middle channel of each, with its bound where there is one; the dashed line is 1."
    size = size_for([c.label for c in curves])
    image = picture("Directional albedo of all subjects", draw_albedo, curves, size=size)
    return ReportFigure("albedo", caption, image, {"all": data})


def sphere_of(s: ReportSubject, e: Evaluation) -> str | None:
    """A small sphere under the first light as the data of an image; None where there is none."""
    sources = e.sources(s)
    if not sources:
        return None
    pixels = sphere_pixels(sources[0][1].spheres[0])
    return "data:image/png;base64," + base64.b64encode(png(pixels)).decode()
