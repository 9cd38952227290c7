"""Figures of the fits of a table: the residuals of each on one scale, and the correlations of its numbers."""

from typing import Any

import numpy as np

from gonio.figures import diagnostics, readings
from gonio.figures.style import picture
from gonio.reports.evaluation import ReportFigure, rounded
from gonio.reports.subject import ReportSubject

MAPS = (
    ("residuals-half", ("theta_h", "theta_d"), "half and difference angle"),
    ("residuals-polar", ("theta_i", "theta_o"), "incident and outgoing angle"),
)


def figures(s: ReportSubject, fits: list[dict[str, Any]]) -> list[ReportFigure]:
    """The figures of the fits of a subject, those of one kind side by side."""
    of_fits = [_residuals(s, k, fit) for k, fit in enumerate(fits)] if s.table is not None else []
    made = [figure for kind in MAPS for figure in _residual_maps(s, kind, of_fits)]
    made += [_histogram(s, k, *f) for k, f in enumerate(of_fits) if f[0].relative.size]
    return made + [figure for k, fit in enumerate(fits) for figure in _correlations(s, k, fit)]


def _residuals(s: ReportSubject, number: int, fit: dict[str, Any]) -> tuple[readings.Residuals, str]:
    """The residuals of a fit, at the polar angles of the fit, and these in words."""
    assert s.table is not None
    limit = fit.get("theta_max")
    words = "" if limit is None else f", polar angles up to {np.degrees(limit):.4g}° as in the fit"
    return readings.fit_residuals(s.table, s.fits[number].brdf, limit), words


def _slug(slug: str, number: int) -> str:
    return f"{slug}-{number + 1}" if number else slug


def _of(s: ReportSubject, number: int) -> str:
    return f", {s.fit_name(number)}" if len(s.fits) > 1 else ""


def _residual_maps(
    s: ReportSubject, kind: tuple[str, tuple[str, str], str], of_fits: list[tuple[readings.Residuals, str]]
) -> list[ReportFigure]:
    slug, axes, words = kind
    grids = {}
    for k, (residuals, _) in enumerate(of_fits):
        if residuals.relative.size:
            across, up = (getattr(residuals.angles, a) for a in axes)
            grids[k] = diagnostics.median_grid(across, up, residuals.relative, axes[0] == "theta_h")
    limit, made = diagnostics.residual_limit(list(grids.values())), []
    for k, grid in grids.items():
        label = f"Residuals of the fit to {s.name} by {words}{_of(s, k)}"
        image = picture(label, diagnostics.draw_residual_map, grid, axes, limit)
        caption = f"Fit residuals by {words}{_of(s, k)}, all channels{of_fits[k][1]}: red: model brighter."
        edges = {f"{a}_edges_deg": rounded(edge, 5) for a, edge in zip(axes, grid, strict=False)}
        made.append(ReportFigure(_slug(slug, k), caption, image, edges | {"median_percent": rounded(grid.median, 4)}))
    return made


def _histogram(s: ReportSubject, number: int, residuals: readings.Residuals, limits: str) -> ReportFigure:
    in_u = residuals.standardised.size > 0.5 * residuals.relative.size
    values = residuals.standardised if in_u else 100 * residuals.relative
    caption = "Residuals in standard uncertainties of the readings" if in_u else "Relative residuals, all channels"
    draw = diagnostics.draw_residual_histogram
    image = picture(f"Histogram of residuals of {s.name}{_of(s, number)}", draw, values, in_u, s.look.colour)
    edges, density = diagnostics.residual_density(values, in_u)
    data = {"unit": "u_f" if in_u else "%", "edges": rounded(edges), "share_per_unit": rounded(density)}
    return ReportFigure(_slug("residuals", number), f"{caption}{_of(s, number)}{limits}.", image, data)


def _correlations(s: ReportSubject, number: int, fit: dict[str, Any]) -> list[ReportFigure]:
    """Correlations of the free parameters of a fit that holds them."""
    names, rows = fit.get("free_names") or [], fit.get("correlation") or []
    if len(names) < 2 or [len(row) for row in rows] != [len(names)] * len(names):
        return []
    values = names, np.array(rows, float)
    caption = "Correlations of the fitted numbers; empty where a number is not determined by the readings"
    label, size = f"Correlations of the numbers fitted to {s.name}", diagnostics.CORRELATIONS_SIZE
    image = picture(label, diagnostics.draw_correlations, *values, size=size)
    data = {"names": names, "correlation": rounded(values[1], 4)}
    return [ReportFigure(_slug("correlations", number), f"{caption}{_of(s, number)}.", image, data)]
