"""Values that figures show: of a BRDF in planes, on maps, meshes, slices and spheres."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np

from gonio.data.table import Channels, Table
from gonio.figures.lobes import mesh_angles
from gonio.figures.maps import disc_points, slice_pairs
from gonio.figures.spectral_colour import VISIBLE, channel_colour
from gonio.figures.spheres import sphere_pairs
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.sides import Hemispheres

INCIDENCES = (0.0, 30.0, 60.0, 80.0)
MAP_INCIDENCES = (30.0, 60.0)
COMPARED = (30.0, 60.0)
"""Incidences, degrees, of lobes, of maps, and of lobes of several subjects in one figure."""
MOST_CHANNELS = 24
LEAST_KNOWN = 0.5
"""Share of a picture that the readings cover, below which it is not drawn."""

Pairs = tuple[Direction, Direction]
Covers = Callable[[Direction, Direction], np.ndarray]
"""Which pairs of directions (n,) a table interpolates; elsewhere its values are NaN, which pictures leave blank."""


@dataclasses.dataclass(frozen=True)
class ModelValues:
    """Values of a BRDF for all figures: f, 1/sr, of one channel, each of shape (n,), of light on one side.

    "Behind" is the other side than the light's: what goes through.
    """

    curves: list[np.ndarray]
    """In the plane, at `plane_angles` of each incidence."""
    compared: list[np.ndarray]
    """The same at `COMPARED`."""
    maps: list[np.ndarray]
    """At `disc_points` for each incidence of the maps."""
    maps_behind: list[np.ndarray]
    """The same behind the sample, mirrored into the front; empty where nothing is there."""
    meshes: list[np.ndarray]
    """At `mesh_angles` of each incidence, on both sides where something is behind."""
    slice: np.ndarray
    """At `slice_pairs`."""
    spheres: list[np.ndarray]
    """For each of `LIGHTS`: linear sRGB (pixels, 3) of a sphere."""

    @property
    def known_of_sphere(self) -> float:
        """Share of the spheres' lit pixels that have a value."""
        return known_of_lit(self.spheres)


def plane_angles(theta_i: float, behind: bool = False) -> np.ndarray:
    """Signed outgoing angles, degrees, of a model's curve: every degree, and closer around the mirror direction.

    `behind`: those behind the sample too, beyond ±90°, and closer around straight through.
    """
    near = np.concatenate([-np.geomspace(8, 0.01, 30), [0.0], np.geomspace(0.01, 8, 30)])
    every = np.sort(np.concatenate([np.linspace(-89.5, 89.5, 180), np.clip(theta_i + near, -89.5, 89.5)]))
    if not behind:
        return every
    # A gap at the horizon breaks the line there; the lobe behind goes on from 180° at −180°.
    mirrored = np.where(every < 0, -180.0 - every, 180.0 - every)
    low, high = mirrored[every < 0], mirrored[every >= 0]
    return np.concatenate([np.sort(low), [-90.0], every, [90.0], np.sort(high)])


def transmits(brdf: AbstractBRDF) -> bool:
    """Whether there is something to be shown on the other side than the light's."""
    return Hemispheres.TRANSMISSION in brdf.hemispheres


def plane_values(brdf: AbstractBRDF, incidences: Sequence[float], light: int = 1) -> list[np.ndarray]:
    """f, 1/sr, of shape (n, channels), at `plane_angles` of each incidence, degrees, of light on a side, 1 or −1."""
    return _evaluated(brdf, [_plane(t, transmits(brdf)) for t in incidences], light=light)


def slice_values(brdf: AbstractBRDF, light: int = 1) -> np.ndarray:
    """f, 1/sr, of shape (n, channels), at `slice_pairs`, light and detector on a side, 1 or −1."""
    return _evaluated(brdf, [slice_pairs()], light=light)[0]


def known_share(values: Sequence[np.ndarray]) -> float:
    """Share of the values that are finite."""
    known = np.concatenate([np.isfinite(v).ravel() for v in values])
    return float(known.mean()) if known.size else 0.0


def known_of_lit(spheres: Sequence[np.ndarray]) -> float:
    """Share of the lit pixels of `sphere_values` that are known."""
    _, _, lights = sphere_pairs()
    return known_share([linear[light.z > 0] for linear, light in zip(spheres, lights, strict=True)])


def sphere_values(
    brdf: AbstractBRDF, channels: Channels, channel: int, covers: Covers | None = None
) -> list[np.ndarray]:
    """Linear sRGB (pixels, 3) of a sphere under each of `LIGHTS`; grey of the channel where there is no colour."""
    return _lit(_evaluated(brdf, _sphere_pairs(), covers), channels, channel)


def model_values(
    brdf: AbstractBRDF,
    channels: Channels,
    channel: int,
    incidences: Sequence[float],
    map_incidences: Sequence[float],
    covers: Covers | None = None,
    light: int = 1,
) -> ModelValues:
    """All values for figures by one evaluation, of one size for every subject: one compiled program a kind of model.

    Args:
        brdf: a model, or the interpolant of a table.
        channels: of the BRDF; the spheres need all of them.
        channel: the number of the one that all else shows.
        incidences: of lobes, degrees.
        map_incidences: of maps, degrees.
        covers: where the BRDF has values; everywhere if None.
        light: its side, 1 in front or −1 behind; all polar angles are counted from the normal there.
    """
    incidences = [*incidences, *[incidences[-1]] * (len(INCIDENCES) - len(incidences))]
    maps = [*map_incidences, *[map_incidences[-1]] * (len(MAP_INCIDENCES) - len(map_incidences))]
    groups: list[list[Pairs]] = [
        [_plane(t, transmits(brdf)) for t in incidences],
        [_plane(t, transmits(brdf)) for t in COMPARED],
        [_disc(t) for t in maps],
        [_disc(t, behind=True) for t in maps if transmits(brdf)],
        [_mesh(t, transmits(brdf)) for t in incidences],
        [slice_pairs()],
        _sphere_pairs(),
    ]
    pieces = iter(_evaluated(brdf, list(itertools.chain(*groups)), covers, light))
    *values, spheres = [[next(pieces) for _ in group] for group in groups]
    curves, compared, discs, behind, meshes, (the_slice,) = [
        [of_channel(f, channel) for f in group] for group in values
    ]
    return ModelValues(curves, compared, discs, behind, meshes, the_slice, _lit(spheres, channels, channel))


def fewer_channels(table: Table, channel: int) -> tuple[Table, int]:
    """(table, number of the shown channel) with no more channels than figures need: of spectra some are enough."""
    count = len(table.channels)
    if count <= MOST_CHANNELS or table.interpolant is not None:
        return table, channel
    # Those that make the colour, where there are such.
    wavelengths = table.channels.wavelengths_nm
    inside = np.arange(count)
    if wavelengths is not None:
        visible = np.flatnonzero((np.asarray(wavelengths) >= VISIBLE[0]) & (np.asarray(wavelengths) <= VISIBLE[-1]))
        inside = visible if visible.size else inside
    few = inside[np.linspace(0, inside.size - 1, min(inside.size, MOST_CHANNELS - 1)).round().astype(int)]
    kept = np.unique(np.append(few, channel))
    return table.only([table.channels.names[k] for k in kept]), int(np.searchsorted(kept, channel))


def of_channel(f: np.ndarray, channel: int) -> np.ndarray:
    """One channel of values (n, channels), or the only one of a grey model."""
    return f[:, channel if f.shape[1] > 1 else 0]


def _sphere_pairs() -> list[Pairs]:
    # Pixels in the shade are dark whatever the surface does.
    _, eye, lights = sphere_pairs()
    return [
        (Direction(*(np.where(light.z > 0, c, e) for c, e in zip(light, eye, strict=True))), eye) for light in lights
    ]


def _lit(pieces: list[np.ndarray], channels: Channels, channel: int) -> list[np.ndarray]:
    _, _, lights = sphere_pairs()
    cosines = [np.maximum(light.z, 0.0)[:, None] for light in lights]
    # The shade is dark whether or not the surface is known.
    lit = [np.where(cos_i > 0, f * cos_i, 0.0) for f, cos_i in zip(pieces, cosines, strict=True)]
    return [_linear_srgb(f_cos, channels, channel) for f_cos in lit]


def _linear_srgb(f_cos: np.ndarray, channels: Channels, channel: int) -> np.ndarray:
    """Linear sRGB (n, 3) of f cosθi (n, channels), 1/sr; grey of the shown channel where there is no colour."""
    radiance = np.pi * f_cos
    to_srgb = channel_colour(channels).matrix
    if to_srgb is None or radiance.shape[1] != to_srgb.shape[1]:
        return np.repeat(of_channel(radiance, channel)[:, None], 3, axis=1)
    return radiance @ to_srgb.T


def _plane(theta_i: float, behind: bool) -> Pairs:
    signed = np.radians(plane_angles(theta_i, behind))
    return _pairs(theta_i, np.abs(signed), np.where(signed >= 0, np.pi, 0.0))


def _disc(theta_i: float, behind: bool = False) -> Pairs:
    _, theta, phi = disc_points()
    return _pairs(theta_i, np.pi - theta if behind else theta, phi)


def _mesh(theta_i: float, through: bool) -> Pairs:
    theta, phi = (np.radians(a) for a in mesh_angles(theta_i, through))
    return _pairs(theta_i, *(a.ravel() for a in np.meshgrid(theta, phi, indexing="ij")))


def _pairs(theta_i: float, theta_o: np.ndarray, delta_phi: np.ndarray) -> Pairs:
    t = np.full_like(theta_o, np.radians(theta_i))
    return from_spherical(t, np.zeros_like(t), np), from_spherical(theta_o, delta_phi, np)


def _evaluated(
    brdf: AbstractBRDF, pairs: Sequence[Pairs], covers: Covers | None = None, light: int = 1
) -> list[np.ndarray]:
    """f (n, channels) at each set of pairs, by one evaluation; NaN where the BRDF is not known.

    With the light behind, −1, the pairs are those of the sample turned over.
    """
    wi, wo = (Direction(*(np.concatenate(c) for c in zip(*w, strict=True))) for w in zip(*pairs, strict=True))
    wi, wo = (w._replace(z=light * w.z) for w in (wi, wo))
    sizes = [np.size(w.z) for w, _ in pairs]
    f = np.asarray(evaluate(brdf, wi, wo)).reshape(sum(sizes), -1)
    if covers is not None:
        f = np.where(covers(wi, wo)[:, None], f, np.nan)
    return np.split(f, np.cumsum(sizes)[:-1])
