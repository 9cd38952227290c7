"""Pictures of light below a surface: a profile with its fits, their residuals, and what spots lose of a BRDF."""

import numpy as np

from gonio.data.material import Material
from gonio.data.profile import Profile
from gonio.figures.diagnostics import MOST_CURVES, channel_colours
from gonio.figures.profile_plots import Curve, ProfilePoints, draw_edge_loss, draw_profile, draw_profile_residuals
from gonio.figures.style import DASHES, Dash, picture, size_for
from gonio.instrument.offsets_scan import spot_means
from gonio.models.subsurface.base import AbstractBSSRDF
from gonio.models.subsurface.spots import kept_share
from gonio.models.subsurface.wide_spots import WideSpots
from gonio.reports.evaluation import ReportFigure, rounded
from gonio.reports.subject import ReportSubject

CURVE = 80
SPOTS = 32
"""Radii of the lit spot."""
NEAR, FAR = 0.02, 30.0
"""A model's own picture: in reduced mean free paths, in diffusion lengths (at most `WIDE` mean free paths)."""
WIDE = 300.0


def figures(s: ReportSubject) -> list[ReportFigure]:
    """R by the distance, residuals of each fit, and edge loss, of a profile or a translucent material."""
    if s.profile is not None:
        fits = [_below(fit) for fit in s.fits]
        known = [b for b in fits if b is not None]
        made = [] if s.empty else [_profile(s, s.profile, known)]
        made += [f for k, b in enumerate(known) if (f := _residuals(s, s.profile, k, b)) is not None]
        return made + ([_edge_loss(s, known[0], s.profile)] if known else [])
    below = None if s.material is None else _below(s.material)
    return [] if below is None else [_model(s, below), _edge_loss(s, below, None)]


def _below(material: Material) -> AbstractBSSRDF | None:
    return material.brdf.bssrdf if isinstance(material.brdf, WideSpots) else None


def _channels(s: ReportSubject) -> list[tuple[int, str, str]]:
    """(number, name, colour) of at most `MOST_CURVES` channels."""
    count = len(s.channels)
    index = np.unique(np.linspace(0, count - 1, min(count, MOST_CURVES)).astype(int))
    names = [s.channels.names[k] for k in index]
    return list(zip(index.tolist(), names, channel_colours(s.look.colour, names), strict=True))


def _of(values: np.ndarray, c: int) -> np.ndarray:
    """A channel (n,) of values (n, channels), which may be the same in all."""
    return values[:, min(c, values.shape[1] - 1)]


def _profile(s: ReportSubject, p: Profile, fits: list[AbstractBSSRDF]) -> ReportFigure:
    r, points, curves = np.abs(p.offsets), [], []
    fine = np.geomspace(*_ends(r), CURVE) if (r > 0).any() else r
    means = [spot_means(b, fine, p.illuminated_radius, p.viewed_radius)[0] for b in fits]
    for c, name, colour in _channels(s):
        use = p.valid[:, c]
        points.append(ProfilePoints(r[use], p.value[use, c], p.u[use, c], name, colour))
        for k, mean in enumerate(means):
            dash: Dash = (0, DASHES[k % len(DASHES)]) if k else "-"
            label = (s.fit_name(k) if c == 0 else "") or "_"
            curves.append(Curve(fine, _of(mean, c), label, colour, dash))
    labels = [q.label for q in points] + [c.label for c in curves if c.label != "_"]
    image = picture(f"R of {s.name} by the distance of the spots", draw_profile, points, curves, size=size_for(labels))
    two_sided = bool((p.offsets < 0).any() and (p.offsets > 0).any())
    both = " Readings on both sides are drawn over each other." if two_sided else ""
    missing = int(np.count_nonzero(p.valid & ~(p.value > 0)))
    below = f" {missing} readings at or below 0 have no place on a logarithmic axis." if missing else ""
    lines = " Lines: the fits as these spots read them." if fits else ""
    caption = (
        f"π times the radiance over the flux, by the distance of the viewed from the lit spot; bars of one standard "
        f"uncertainty.{lines}{both}{below}"
    )
    data = {"sets": [{"channel": q.label, "r_mm": rounded(q.r), "R_per_mm2": rounded(q.value), "u_R": rounded(q.u, 3)}
                     for q in points]}  # fmt: skip
    return ReportFigure("profile", caption, image, data)


def _ends(r: np.ndarray) -> tuple[float, float]:
    low, high = float(r[r > 0].min()), float(r.max())
    return low, high if high > low else 1.01 * low


def _residuals(s: ReportSubject, p: Profile, k: int, b: AbstractBSSRDF) -> ReportFigure | None:
    """Residuals of a fit, by the stored uncertainties or relative."""
    mean = spot_means(b, p.offsets, p.illuminated_radius, p.viewed_radius)[0]
    known = bool((np.nan_to_num(p.u[p.valid]) > 0).any())
    unit, points = "u" if known else "reading", []
    for c, name, colour in _channels(s):
        size = np.where(p.u[:, c] > 0, p.u[:, c], np.nan) if known else np.abs(p.value[:, c])
        with np.errstate(divide="ignore", invalid="ignore"):
            residual = (_of(mean, c) - p.value[:, c]) / size
        use = p.valid[:, c] & np.isfinite(residual)
        points.append(ProfilePoints(np.abs(p.offsets[use]), residual[use], np.full(use.sum(), np.nan), name, colour))
    if not sum(q.r.size for q in points):
        return None
    which = s.fit_name(k) if len(s.fits) > 1 else "the fit"
    scale = "in standard uncertainties of the readings" if known else "relative to the readings"
    image = picture(
        f"Residuals of {s.name}, {which}",
        draw_profile_residuals,
        points,
        unit,
        size=size_for([q.label for q in points]),
    )
    data = {"sets": [{"channel": q.label, "r_mm": rounded(q.r), "residual": rounded(q.value, 4)} for q in points]}
    return ReportFigure(f"profile-residuals-{k + 1}", f"Residuals of {which}, {scale}.", image, data)


def _model(s: ReportSubject, b: AbstractBSSRDF) -> ReportFigure:
    """R of a material beside a narrow beam."""
    from gonio.models.subsurface.evaluation import evaluated

    extinction, absorption = (np.atleast_1d(np.asarray(v, float)) for v in (b.extinction, b.absorption))
    length = 1 / np.sqrt(3 * np.maximum(absorption * extinction, 1e-300)).min()
    free = 1 / extinction
    r = np.geomspace(NEAR * free.min(), min(FAR * length, WIDE * free.max()), CURVE)
    values = evaluated(b, "profile", r)
    curves = [Curve(r, _of(values, c), name, colour) for c, name, colour in _channels(s)]
    image = picture(
        f"R of {s.name} by the distance", draw_profile, [], curves, size=size_for([c.label for c in curves])
    )
    data = {"r_mm": rounded(r), "R_per_mm2": {c.label: rounded(c.y) for c in curves}}
    return ReportFigure(
        "profile", "R: the exitance beside a narrow beam of unit flux that passed the surface.", image, data
    )


def _edge_loss(s: ReportSubject, b: AbstractBSSRDF, p: Profile | None) -> ReportFigure:
    """What a BRDF of the material loses, over the lit spot's radius; viewed as in the profile, or much of a spot."""
    size = float(np.max(1 / np.asarray(b.extinction, float)))
    viewed = p.viewed_radius if p is not None and p.viewed_radius > 0 else size
    lit = np.geomspace(viewed / 10, 100 * max(viewed, size), SPOTS)
    lost = np.stack([1 - kept_share(b, float(a), viewed).value for a in lit])
    curves = [Curve(lit, _of(lost, c), name, colour) for c, name, colour in _channels(s)]
    spot = None if p is None else p.illuminated_radius or None
    image = picture(
        f"Edge loss of {s.name}", draw_edge_loss, curves, spot, size=size_for([c.label for c in curves])
    )  # fmt: skip
    where = " The broken line is the lit spot of the profile." if spot else ""
    caption = (
        f"The light that a BRDF read with a viewed spot of {viewed:.3g} mm radius misses, by the radius of the lit one."
        f"{where}"
    )
    data = {"viewed_radius_mm": viewed, "illuminated_radius_mm": rounded(lit),
            "lost": {c.label: rounded(c.y, 4) for c in curves}}  # fmt: skip
    return ReportFigure("edge-loss", caption, image, data)
