"""Subjects side by side: lobes and albedo of all of them in one colour each, and a sphere of each."""

import base64

import numpy as np

from gonio.figures.albedo import AlbedoCurve, albedo_figure
from gonio.figures.lobes import Curve, in_plane
from gonio.figures.spheres import png, sphere_pixels
from gonio.figures.style import colour_of
from gonio.reports import views
from gonio.reports.check_figures import albedo_series
from gonio.reports.evaluations import Seen
from gonio.reports.figure import Drawn, short
from gonio.reports.subject import Subject

LONGEST = 22


def shortened(name: str) -> str:
    """A name that fits a legend of two columns."""
    return name if len(name) <= LONGEST else name[: LONGEST - 9] + "…" + name[-8:]


def together(subjects: list[Subject], seen: list[Seen]) -> list[Drawn]:
    """Figures of several subjects at once; none for a single one."""
    if len(subjects) < 2:
        return []
    drawn = []
    for k, theta_i in enumerate(views.COMPARED):
        curves, data = [], []
        for s, look in zip(subjects, seen, strict=True):
            name_and_view = next(iter(look.sources(s)[::-1]), None)
            if name_and_view is None:
                continue
            f = name_and_view[1].compared[k]
            colour, dash = colour_of(s.number)
            curves.append(Curve(views.plane_angles(theta_i), f, shortened(s.name), colour, dash))
            data.append({"subject": s.name, "channel": s.channel, "of": name_and_view[0], "f_per_sr": short(f)})
        if len(curves) < 2:
            continue
        caption = (
            f"In the plane of incidence, θᵢ = {theta_i:g}°, the middle channel of each. Tables: the fitted model "
            "where there is one, else the readings, interpolated."
        )
        picture = in_plane(curves, f"f of all subjects in the plane of incidence, incidence {theta_i:g}°", True)
        angles = np.round(views.plane_angles(theta_i), 4)
        drawn.append(
            Drawn(f"lobes-{theta_i:g}", caption, picture, {"theta_i_deg": theta_i, "theta_o_deg": angles, "all": data})
        )
    albedo = _albedo(subjects)
    return drawn + ([albedo] if albedo else [])


def _albedo(subjects: list[Subject]) -> Drawn | None:
    curves, data = [], []
    for s in subjects:
        found = albedo_series(s)
        if found is None:
            continue
        theta, albedo, bound, names = found
        k = s.shown if len(names) > 1 else 0
        colour, dash = colour_of(s.number)
        curves.append(AlbedoCurve(theta, albedo[k], bound[k], shortened(s.name), colour, dash=dash))
        data.append(
            {"subject": s.name, "channel": names[k], "theta_i_deg": short(theta), "albedo": short(albedo[k]),
             "bound": short(bound[k])}
        )  # fmt: skip
    if len(curves) < 2:
        return None
    caption = "Directional albedo, the middle channel of each, with its bound where there is one; the dashed line is 1."
    return Drawn("albedo", caption, albedo_figure(curves, "Directional albedo of all subjects"), {"all": data})


def sphere_of(s: Subject, seen: Seen) -> str | None:
    """A small sphere as the data of an image, as seen under the first light; None where there is none."""
    sources = seen.sources(s)
    if not sources:
        return None
    pixels = sphere_pixels(sources[0][1].spheres[0])
    return "data:image/png;base64," + base64.b64encode(png(pixels)).decode()
