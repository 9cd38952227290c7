"""Plots of a material, a table or a fit on matplotlib axes: lobe, slice, sphere, albedo, residuals, and a thumbnail.

Readings of a table are dots where they were measured. Only a sphere needs values in between: it shows the table's own
interpolation. Angles are radians in the arguments and degrees on the axes.
"""

import functools
import math
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gonio.data.files import new_file, refuse_existing
from gonio.data.flags import Flag
from gonio.data.interpolation.coverage import covered
from gonio.data.polarisation import shown_channel
from gonio.data.subject import Subject, SubjectLike, resolve_subject
from gonio.data.table import Table
from gonio.figures import diagnostics, maps, readings, sampling, spheres, style
from gonio.figures.diagnostics import AlbedoCurve, draw_albedo, draw_residual_histogram, draw_residual_map
from gonio.figures.legible import make_legible
from gonio.figures.lobes import Curve, draw_in_plane, draw_polar
from gonio.figures.sampling import INCIDENCES, of_channel, plane_angles, plane_values
from gonio.figures.style import HEIGHT, PALETTE, WIDTH, shades, styled
from gonio.fitting.residuals.pair_angles import pair_angles
from gonio.models.display import percent
from gonio.models.errors import GonioError, nearest
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import to_half_difference
from gonio.models.geometry.sides import Hemispheres

if TYPE_CHECKING:
    from gonio.fitting.result import FitResult

MOST_READINGS = 1 << 14
NEAR_SLICE = 10.0
"""Degrees of difference azimuth about 90° within which readings are in the slice."""
ALBEDO_TOLERANCE = 1e-6
MOST_LETTERS = 60
PICTURES = (".png", ".svg", ".pdf")
LIGHTS = {"front": 1, "back": -1}
LIT_BEHIND = ", lit from behind"


def plot_lobe(
    subject: SubjectLike,
    theta_i: float | Sequence[float] | None = None,
    *,
    channel: str | int | None = None,
    polar: bool = True,
    log: bool = True,
    lit: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """f in the plane of incidence, as a polar diagram or against the signed outgoing angle.

    Args:
        subject: a material, a model, a table, or what names one.
        theta_i: angles of incidence, radians, in [0, π/2); of a table the measured ones nearest to them.
        channel: name or number of the channel; the middle one by default.
        polar: a polar diagram, whose largest ring has radius 1; else f, 1/sr, against degrees.
        log: a logarithmic radius or axis.
        lit: the side of the light, "front" or "back", from whose normal angles are counted; by default the front,
            where any light came from there.
        ax: where to draw; a new figure by default.

    Returns:
        The axes.

    Raises:
        GonioError: for a side from which no light was read, or from which a model sends none on.
    """
    s = resolve_subject(subject)
    light = _light(s, lit)
    curves = _lobe_curves(s, _degrees(theta_i), _channel(s, channel), light)
    return draw_on(ax, s.name + LIT_BEHIND * (light < 0), draw_polar if polar else draw_in_plane, curves, log)


def plot_slice(
    subject: SubjectLike, *, channel: str | int | None = None, lit: str | None = None, ax: Axes | None = None
) -> Axes:
    """f over half and difference angle at a difference azimuth of 90°; of a table its readings within 10° of that.

    `lit`: the side of light and detector, "front" or "back", as of `plot_lobe`.
    """
    s = resolve_subject(subject)
    light = _light(s, lit)
    title = s.name + LIT_BEHIND * (light < 0)
    if s.table is None:
        f = of_channel(sampling.slice_values(s.brdf, light), _channel(s, channel))
        return draw_on(ax, title, maps.draw_slice, f, maps.slice_range([f]))
    theta_h, theta_d, f = _slice_readings(s.table, _channel(s, channel), light)
    return draw_on(ax, title, maps.draw_slice_readings, theta_h, theta_d, f, maps.colour_range(f))


def plot_sphere(subject: SubjectLike, *, channel: str | int | None = None, ax: Axes | None = None) -> Axes:
    """Lit spheres under two lights, in colour where the channels have one; a table by its own interpolation.

    Raises:
        GonioError: for a table that cannot be interpolated over the hemisphere.
    """
    s = resolve_subject(subject)
    pixels = [spheres.sphere_pixels(p) for p in _sphere(s, _channel(s, channel))]
    row = ("" if s.table is None else "readings, interpolated", pixels)
    return draw_on(ax, s.name, spheres.draw_spheres, [row], size=spheres.spheres_size(1))


def plot_albedo(subject: SubjectLike, *, ax: Axes | None = None) -> Axes:
    """Directional albedo of each channel (six at most) with the bound on its error, against the angle of incidence.

    Raises:
        GonioError: for a table whose readings do not cover the hemisphere.
    """
    s = resolve_subject(subject)
    return draw_on(ax, s.name, draw_albedo, _albedo_curves(s))


def plot_residuals(
    result: "FitResult", *, angles: tuple[str, str] | None = ("theta_h", "theta_d"), ax: Axes | None = None
) -> Axes:
    """Residuals of a fit: medians of (model − reading)/|reading| by two angles, or their distribution.

    Args:
        result: what `gonio.fit` returned.
        angles: ``("theta_h", "theta_d")`` or ``("theta_i", "theta_o")``; None: a histogram.
        ax: where to draw; a new figure by default.

    Returns:
        The axes.
    """
    if result.evidence is None:
        raise GonioError("this fit keeps no readings, so it has no residuals to plot; fit the table again")
    readings, model = result.evidence.readings, result.evidence.model_f
    valid = readings.valid & (readings.f != 0)
    relative = ((model - readings.f) / np.where(valid, np.abs(readings.f), 1.0))[valid]
    title = f"{result.requested}, fitted to {result.table or 'a table'}"
    if angles is None:
        return draw_on(ax, title, draw_residual_histogram, 100 * relative, False, PALETTE[0])
    if angles not in (("theta_h", "theta_d"), ("theta_i", "theta_o")):
        raise GonioError(f"there is no map of residuals by {angles!r}; give theta_h, theta_d or theta_i, theta_o")
    of_pair = pair_angles(readings.wi, readings.wo)
    across, up = (np.broadcast_to(getattr(of_pair, a)[:, None], valid.shape)[valid] for a in angles)
    grid = diagnostics.median_grid(across, up, relative, angles[0] == "theta_h")
    return draw_on(ax, title, draw_residual_map, grid, angles)


def write_lobe(expression: str, output: str | os.PathLike[str], force: bool = False) -> None:
    """Writes polar diagrams of a model's lobe, linear and logarithmic, in the plane of incidence, as PNG, SVG or PDF.

    Raises GonioError for another ending, or an existing file.
    """
    ending = Path(output).suffix.lower()
    if ending not in PICTURES:
        raise GonioError(f"{output} is no picture that can be written; end its name in {', '.join(PICTURES)}")
    refuse_existing(output, force)
    # The grey of the channels: their mean, as one line an incidence is what a small picture holds.
    brdf = build(expression)
    values, behind = [f.mean(axis=1) for f in plane_values(brdf, INCIDENCES)], sampling.transmits(brdf)
    curves = _curves([plane_angles(t, behind) for t in INCIDENCES], values, INCIDENCES, None)
    with styled(), new_file(output, force) as temporary:
        fig = Figure(figsize=(2 * WIDTH, HEIGHT + 0.3), layout="constrained")
        for ax, log, scale in zip(fig.subplots(1, 2), (False, True), ("linear", "logarithmic"), strict=True):
            draw_polar(ax, curves, log)
            ax.text(1.0, -0.06, scale, transform=ax.transAxes, va="top", ha="right", fontsize=9)
        fig.suptitle(expression, fontsize=10)
        make_legible(fig).savefig(temporary, format=ending[1:])


def thumbnail_svg(subject: SubjectLike) -> str:
    """A small polar diagram of the lobe as an SVG element, for a notebook."""
    s = resolve_subject(subject)
    curves = _lobe_curves(s, list(INCIDENCES), _channel(s, None), _light(s, None))
    small = style.picture(f"Lobe of {s.name} in the plane of incidence", draw_polar, curves, log=True)
    return small.svg().replace("<svg ", '<svg width="240" height="174" ', 1)


def draw_on(
    ax: Axes | None, title: str, draw: Callable[..., None], *args: Any,
    size: tuple[float, float] = (WIDTH, HEIGHT), **options: Any,
) -> Axes:  # fmt: skip
    """`draw(axes, *args, **options)` and a title on the axes, or on those of a new figure of this size in inches."""
    with styled():
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.subplots(figsize=size, layout="constrained")[1]
        draw(ax, *args, **options)
        legend = ax.get_legend()
        labels = [] if legend is None else [text.get_text() for text in legend.get_texts()]
        rows = math.ceil(len(labels) / style.legend_columns(labels)) if labels else 0
        short = title if len(title) <= MOST_LETTERS else title[: MOST_LETTERS - 1] + "…"
        ax.set_title(short, fontsize=10, pad=6.0 + 13.0 * rows)
    return ax


def _channel(s: Subject, channel: str | int | None) -> int:
    names = s.channels.names
    if channel is None:
        return shown_channel(names)
    if channel in names:
        return names.index(str(channel))
    if isinstance(channel, int | np.integer) and 0 <= channel < len(names):
        return int(channel)
    raise GonioError(f"there is no channel {channel!r}; {nearest(str(channel), names)}")


def _light(s: Subject, lit: str | None) -> int:
    """The side of the light by its name, 1 in front or −1 behind."""
    if lit not in (None, *LIGHTS):
        raise GonioError(f"lit is {lit!r}; give 'front' or 'back'")
    if s.table is not None:
        lights = {light for light, _ in s.table.sides}
    else:
        of_light = {1: Hemispheres.REFLECTION, -1: Hemispheres.BACK}
        lights = {light for light, way in of_light.items() if s.brdf.hemispheres & (way | Hemispheres.TRANSMISSION)}
    if lit is None:
        return 1 if 1 in lights else -1
    if LIGHTS[lit] not in lights:
        other = next(name for name in LIGHTS if name != lit)
        does = "sends no light on that comes" if s.table is None else "has no readings of light"
        raise GonioError(f"{s.name} {does} from the {lit}; give lit='{other}'")
    return LIGHTS[lit]


def _degrees(theta_i: float | Sequence[float] | None) -> list[float]:
    if theta_i is None:
        return list(INCIDENCES)
    angles = np.atleast_1d(np.asarray(theta_i, float))
    if not (angles.size and np.all((angles >= 0) & (angles < math.pi / 2))):
        raise GonioError(f"theta_i is {theta_i!r} rad; give angles of incidence from 0 to below π/2, in radians")
    return np.degrees(angles).tolist()


def _sphere(s: Subject, channel: int) -> list[np.ndarray]:
    if s.table is None:
        return sampling.sphere_values(s.brdf, s.channels, channel)
    if s.table.layout.in_one_plane:
        raise GonioError(f"the readings of {s.name} lie in one plane; a sphere needs them over the hemisphere")
    table, channel = sampling.fewer_channels(s.table, channel)
    values = sampling.sphere_values(
        resolve_subject(table).brdf, table.channels, channel, functools.partial(covered, table)
    )
    if (share := sampling.known_of_lit(values)) < sampling.LEAST_KNOWN:
        raise GonioError(f"the readings of {s.name} cover {percent(share)} of a sphere; it needs at least half")
    return values


def _lobe_curves(s: Subject, incidences: list[float], channel: int, light: int) -> list[Curve]:
    if s.table is None:
        values = [of_channel(f, channel) for f in plane_values(s.brdf, incidences, light)]
        behind = sampling.transmits(s.brdf)
        return _curves([plane_angles(t, behind) for t in incidences], values, incidences, None)
    incidences = readings.table_incidences(s.table, incidences, light)
    near = [readings.in_plane_readings(n) for n in readings.readings_near(s.table, incidences, light)]
    return _curves([n.theta_o for n in near], [n.f[:, channel] for n in near], incidences, "o")


def _curves(
    theta_o: Iterable[np.ndarray], f: Iterable[np.ndarray], incidences: Sequence[float], marker: str | None
) -> list[Curve]:
    tones = shades(PALETTE[0], len(incidences))
    return [
        Curve(x, y, f"θᵢ {t:.4g}°", tone, marker=marker, theta_i=t)
        for x, y, tone, t in zip(theta_o, f, tones, incidences, strict=True)
    ]


def _slice_readings(table: Table, channel: int, light: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(theta_h, theta_d, degrees, f) of the readings of one channel near a difference azimuth of 90°."""
    block = table.samples(limit=MOST_READINGS)
    wi, wo = (w._replace(z=light * w.z) for w in (block.wi, block.wo))
    angles = pair_angles(wi, wo)
    _, _, _, phi_d = jax.jit(to_half_difference)(wi, wo)
    off = np.abs(np.degrees(np.asarray(phi_d)) % 180 - 90)
    # At a difference angle of 0 there is no azimuth.
    near = ((off <= NEAR_SLICE) | (angles.theta_d < 1e-6)) & (block.flag[:, channel] == Flag.VALID)
    index = np.flatnonzero(near & (np.minimum(wi.z, wo.z) > 0))  # half angles are of reflection
    return angles.theta_h[index], angles.theta_d[index], block.f[index, channel]


def _albedo_curves(s: Subject) -> list[AlbedoCurve]:
    from gonio.checks.model.energy import ModelEvidence, model_energy
    from gonio.checks.table.energy import TableEvidence, table_energy

    if s.table is None:
        energy = model_energy(ModelEvidence(s.brdf), ALBEDO_TOLERANCE)
    else:
        energy = table_energy(TableEvidence(s.table), ALBEDO_TOLERANCE)
    series = diagnostics.albedo_series(energy, s.channels)
    if series is None:
        raise GonioError(energy.detail.rstrip("."))
    return series.curves(PALETTE[0], None if s.table is None else "o")
