"""Figures of what was judged: albedo with its bound, reciprocity pair by pair, p-values, what a fit leaves over."""

import numpy as np

from gonio.checks.certificate import Property
from gonio.figures.albedo import AlbedoCurve, albedo_figure, channel_colours
from gonio.figures.correlations import correlation_figure
from gonio.figures.reciprocity import p_map, reciprocity_scatter
from gonio.figures.residuals import median_grid, residual_histogram, residual_map, shares
from gonio.figures.style import colour_of
from gonio.reports import views
from gonio.reports.figure import Drawn, short
from gonio.reports.subject import Subject

MOST_PAIRS = 1500
MOST_CURVES = 6


def named(s: Subject, name: str) -> Property | None:
    """A property of a subject's certificate, if it has one."""
    properties = [] if s.certificate is None else s.certificate.properties
    return next((p for p in properties if p.name == name), None)


def albedo_series(s: Subject) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]] | None:
    """(theta_i in degrees, albedo, bound, names of channels) of a certificate; arrays are (channels, n)."""
    energy = named(s, "energy")
    if energy is None or not energy.series.get("theta_i_deg"):
        return None
    theta = np.asarray(energy.series["theta_i_deg"], float)
    albedo, bound = (_by_channel(energy.series[k], theta.size) for k in ("albedo", "bound"))
    return theta, albedo, bound, s.channels.names if albedo.shape[0] == len(s.channels) else ("grey",)


def _by_channel(values: list, size: int) -> np.ndarray:
    a = np.array([[np.nan if v is None else v for v in np.atleast_1d(row)] for row in values], float)
    return a if a.shape[1] == size else a.reshape(-1, size)


def albedo_figures(s: Subject) -> list[Drawn]:
    """Directional albedo by channel."""
    found = albedo_series(s)
    if found is None:
        return []
    theta, albedo, bound, names = found
    pick = np.unique(np.linspace(0, len(names) - 1, min(len(names), MOST_CURVES)).astype(int))
    colours = channel_colours(colour_of(s.number)[0], tuple(names[k] for k in pick))
    marker = "o" if s.table is not None else None
    curves = [AlbedoCurve(theta, albedo[k], bound[k], names[k], c, marker) for k, c in zip(pick, colours, strict=True)]
    caption = "Directional albedo (the share of light that is reflected) with its bound; the dashed line is 1."
    if len(pick) < len(names):
        caption += f" {len(pick)} of {len(names)} channels."
    if not np.isfinite(bound[pick]).all():
        caption += " Where no band is drawn the albedo has no bound: the grid does not resolve the lobe there."
    data = {"theta_i_deg": short(theta), "channels": list(names), "albedo": short(albedo), "bound": short(bound)}
    picture = albedo_figure(curves, f"Directional albedo of {s.name} against the angle of incidence")
    return [Drawn("albedo", caption, picture, data)]


def reciprocity_figures(s: Subject) -> list[Drawn]:
    """f(wi, wo) against f(wo, wi), and the p-values over angles where uncertainties are stored."""
    judged = named(s, "reciprocity")
    found = _pairs(s)
    if judged is None or found is None:
        return []
    drawn = []
    a, b, how = found
    usable = np.isfinite(a) & np.isfinite(b)
    positive = usable & (a > 0) & (b > 0)
    left_out = int(usable.sum() - positive.sum())
    at = np.flatnonzero(positive)
    at = at[np.linspace(0, at.size - 1, min(at.size, MOST_PAIRS)).astype(int)] if at.size else at
    if at.size:
        caption = (
            f"Reciprocity, channel {s.channel}: light and detector exchanged; {at.size:,} of "
            f"{int(positive.sum()):,} {how}."
        )
        if left_out:
            caption += f" {left_out:,} pairs with a value of 0 or less cannot be drawn."
        tolerance = judged.tolerance
        if tolerance is not None and tolerance >= 1e-3:
            caption += f" Grey: within {tolerance:.3g}."
        colour, _ = colour_of(s.number)
        picture = reciprocity_scatter(
            a[at], b[at], tolerance, colour, f"f of {s.name} with the directions exchanged against f"
        )
        data = {
            "channel": s.channel, "f_per_sr": short(a[at]), "f_exchanged_per_sr": short(b[at]),
            "pairs": int(positive.sum()), "not_positive": left_out,
        }  # fmt: skip
        drawn.append(Drawn("reciprocity", caption, picture, data))
    p = judged.series.get("p_map")
    if p and p.get("theta_deg"):
        level = judged.facts.get("level", 0.01)
        values = np.array([[np.nan if v is None else v for v in row] for row in p["p"]], float)
        caption = (
            "p-values of reciprocity by both polar angles, each corrected for the pairs in its square; bold: below the "
            f"level {level:g}."
        )
        picture = p_map(np.array(p["theta_deg"]), values, level, f"p-values of the reciprocity of {s.name}")
        drawn.append(Drawn("p-values", caption, picture, {"level": level, **p}))
    return drawn


def _pairs(s: Subject) -> tuple[np.ndarray, np.ndarray, str] | None:
    from gonio.checks.direction_search import directions, values
    from gonio.checks.table.reciprocity import reciprocal_pairs
    from gonio.checks.table.scattered_pairs import random_angles

    if s.table is not None:
        found = reciprocal_pairs(s.table)
        return None if found is None else (found[0].a[:, s.shown], found[0].b[:, s.shown], found[2])
    angles = random_angles(np.radians(85.0), 2 * MOST_PAIRS)
    # Every second pair about the mirror direction, where lobes are.
    turn = np.random.default_rng(0).standard_normal((MOST_PAIRS, 2)) * np.radians(6.0)
    angles[::2, 2] = np.clip(np.abs(angles[::2, 0] + turn[:, 0]), 0, np.radians(88))
    angles[::2, 3] = angles[::2, 1] + np.pi + turn[:, 1]
    wi, wo = directions(angles[:, 0], angles[:, 1]), directions(angles[:, 2], angles[:, 3])
    a, b = values(s.brdf, wi, wo), values(s.brdf, wo, wi)
    k = s.shown if a.shape[1] > 1 else 0
    return a[:, k], b[:, k], "random pairs, half of them about the mirror direction"


def residual_figures(s: Subject, theta_max: float | None) -> list[Drawn]:
    """What the fit leaves over, by angles and by size; `theta_max`, radians, as in the fit."""
    if s.table is None or s.fitted is None:
        return []
    r = views.residuals(s.table, s.fitted, theta_max)
    if not r["relative"].size:
        return []
    cut = "" if theta_max is None else f", polar angles up to {np.degrees(theta_max):.4g}° as in the fit"
    drawn = []
    for slug, axes, words in (
        ("residuals-half", ("theta_h", "theta_d"), "half and difference angle"),
        ("residuals-polar", ("theta_i", "theta_o"), "incident and outgoing angle"),
    ):
        grid = median_grid(r[axes[0]], r[axes[1]], r["relative"], axes[0] == "theta_h")
        picture = residual_map(*grid, f"Residuals of the fit to {s.name} by {words}", axes)
        caption = f"Fit residuals by {words}, all channels{cut}: red: model brighter."
        edges = {f"{a}_edges_deg": short(e, 5) for a, e in zip(axes, grid, strict=False)}
        drawn.append(Drawn(slug, caption, picture, edges | {"median_percent": short(grid[2], 4)}))
    in_u = r["in_u"].size > 0.5 * r["relative"].size
    values, unit = (r["in_u"], "u_f") if in_u else (100 * r["relative"], "%")
    caption = "Residuals in standard uncertainties of the readings" if in_u else "Relative residuals, all channels"
    picture = residual_histogram(values, unit, colour_of(s.number)[0], f"Histogram of residuals of {s.name}")
    edges, share = shares(values, in_u)
    data = {"unit": unit, "edges": short(edges), "share_per_unit": short(share)}
    drawn.append(Drawn("residuals", caption + cut + ".", picture, data))
    return drawn


def correlation_figures(s: Subject, fit: dict | None) -> list[Drawn]:
    """Correlations of the free numbers of a fit that holds them."""
    names = (fit or {}).get("free_names") or []
    rows = (fit or {}).get("correlation") or []
    if len(names) < 2 or [len(row) for row in rows] != [len(names)] * len(names):
        return []
    correlation = np.array([[np.nan if v is None else v for v in row] for row in rows], float)
    caption = "Correlations of the fitted numbers; empty where a number is not determined by the readings."
    picture = correlation_figure(names, correlation, f"Correlations of the numbers fitted to {s.name}")
    return [Drawn("correlations", caption, picture, {"names": names, "correlation": short(correlation, 4)})]
