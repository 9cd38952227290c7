"""What the certificate says of a table's energy: which incidences were judged, what is missing, what may be hidden."""

import math

import numpy as np

from gonio.checks.albedos import Albedos
from gonio.checks.certificate import PASS, UNDECIDED
from gonio.checks.hidden_lobes import ALPHAS, alpha_of, at_width, width_of
from gonio.data.layouts import Layout

OR_THROUGH = ", or where light goes straight through or is refracted to"


def least_width(albedos: Albedos, tolerance: float) -> float | None:
    """The least width, radians, such that energy passes if no lobe is narrower; None where it does not for any."""
    if albedos.partial.any() or not np.isfinite(albedos.value).all():
        return None
    known = (albedos.value + albedos.below)[:, None]
    passes = np.all(known + albedos.hidden <= 1 + tolerance, axis=(0, 2))
    return width_of(float(ALPHAS[np.argmax(passes)])) if passes.any() else None


def degrees_up(width: float) -> float:
    """A width, radians, in degrees, rounded up to two digits."""
    degrees = math.degrees(width)
    unit = 10.0 ** (math.floor(math.log10(degrees)) - 1)
    return round(math.ceil(degrees / unit - 1e-9) * unit, 9)


def what_may_hide(albedos: Albedos, verdict: str, width: float, least: float | None) -> str:
    """What lobes may hide where the mirror direction was not read, and of which width on energy would pass."""
    text = f" The readings leave out the mirror direction{OR_THROUGH * bool(albedos.shares)}"
    most = float(np.max(at_width(albedos.hidden, width)))
    if verdict == PASS and not width:
        return f"{text}; further readings limit what a lobe may hide there to {most:.2g}."
    if verdict == PASS:
        return (
            f"{text}: this assumes that no lobe is narrower than {math.degrees(width):.3g}° (full width at half maximum"
            f" at normal incidence); a wider one hides at most {most:.2g} between them."
        )
    text += ", where a lobe narrower than the grid may hide"
    if verdict == UNDECIDED and least is not None:
        words = degrees_up(least)
        text += (
            f": it passes if no lobe is narrower than {words:g}° (full width at half maximum; facets of a Gaussian α "
            f"of {alpha_of(least):.2g}). Whoever knows that states it: --feature-width {words:g}; else read there"
        )
        return f"{text} (gonio plan --for energy)."
    return f"{text}: read there too, or state the width of the narrowest feature."


def incidences_judged(albedos: Albedos) -> str:
    """Which incidences were judged, and which were read too little for it."""
    whole, part = (np.degrees(np.unique(np.round(albedos.theta_i[p], 6))) for p in (~albedos.partial, albedos.partial))
    ranges = [f"{a[0]:.4g}°" if a.size == 1 else f"{a[0]:.4g}–{a[-1]:.4g}° ({a.size})" for a in (whole, part) if a.size]
    text = f" Judged at θi {ranges[0]}." if whole.size else ""
    if part.size:
        text += (
            f" Undecided at θi {ranges[-1]}: too little of the hemisphere was read there; the albedo is at least that."
        )
    return text


def remedy(layout: Layout, needed: float | None) -> str:
    """What would decide, from the step that the lobe needs, radians in degrees; None where it is not known."""
    if needed is None:
        return " The grid does not resolve the lobe well enough: a finer one, or half/difference angles, would."
    step = np.degrees(np.median(np.diff(layout.axes["theta_o"])))
    if needed >= step:
        return " Its noise, its rim or its missing cells leave that open, rather than its resolution."
    return (
        f" The grid does not resolve the lobe: by its height and slopes a step of about {needed:.2g}°"
        f" (here {step:.2g}°) is needed, or half/difference angles."
    )


def series_of(albedos: Albedos) -> dict[str, list]:
    """Largest albedo and its bound by the angle of incidence, for plots."""
    # From the front, or, where all light was behind, by its angles from the normal there.
    lit = albedos.theta_i < np.pi / 2
    from_normal = np.where(lit, albedos.theta_i, np.nan if lit.any() else np.pi - albedos.theta_i)
    theta = np.unique(from_normal[np.isfinite(from_normal)])
    groups = [from_normal == t for t in theta]
    value, bound = (np.stack([v[group].max(axis=0) for group in groups]) for v in (albedos.value, albedos.below))
    return {"theta_i_deg": np.degrees(theta).tolist(), "albedo": value.T.tolist(), "bound": bound.T.tolist()}
