"""Values that figures show: of a BRDF in planes, on maps, meshes, slices and spheres; readings of a table."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Channels, Table
from gonio.figures.lobes import mesh_angles
from gonio.figures.maps import disc_points, slice_pairs
from gonio.figures.spheres import sphere_pairs
from gonio.fitting.residuals.colour_difference import LINEAR_SRGB, colour_matrix
from gonio.fitting.residuals.pair_angles import PairAngles, pair_angles
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical

INCIDENCES = (0.0, 30.0, 60.0, 80.0)
MAP_INCIDENCES = (30.0, 60.0)
COMPARED = (30.0, 60.0)
"""Incidences, degrees, of lobes, of maps, and of lobes of several subjects in one figure."""
MOST_CHANNELS = 24

Pairs = tuple[Direction, Direction]


@dataclasses.dataclass(frozen=True)
class ModelValues:
    """Values of a BRDF for all figures: f, 1/sr, of one channel, each of shape (n,)."""

    curves: list[np.ndarray]
    """In the plane, at `plane_angles` of each incidence."""
    compared: list[np.ndarray]
    """The same at `COMPARED`."""
    maps: list[np.ndarray]
    """At `disc_points` for each incidence of the maps."""
    meshes: list[np.ndarray]
    """At `mesh_angles` of each incidence."""
    slice: np.ndarray
    """At `slice_pairs`."""
    spheres: list[np.ndarray]
    """For each of `LIGHTS`: linear sRGB (pixels, 3) of a sphere."""


def plane_angles(theta_i: float) -> np.ndarray:
    """Signed outgoing angles, degrees, of a model's curve: every degree, and closer around the mirror direction."""
    near = np.concatenate([-np.geomspace(8, 0.01, 30), [0.0], np.geomspace(0.01, 8, 30)])
    every = np.concatenate([np.linspace(-89.5, 89.5, 180), np.clip(theta_i + near, -89.5, 89.5)])
    return np.sort(every)


def plane_values(brdf: AbstractBRDF, incidences: Sequence[float]) -> list[np.ndarray]:
    """f, 1/sr, of shape (n, channels), at `plane_angles` of each incidence, degrees."""
    return _evaluated(brdf, [_plane(t) for t in incidences])


def slice_values(brdf: AbstractBRDF) -> np.ndarray:
    """f, 1/sr, of shape (n, channels), at `slice_pairs`."""
    return _evaluated(brdf, [slice_pairs()])[0]


def sphere_values(brdf: AbstractBRDF, channels: Channels, channel: int) -> list[np.ndarray]:
    """Linear sRGB (pixels, 3) of a sphere under each of `LIGHTS`; grey of the channel where there is no colour."""
    return _lit(_evaluated(brdf, _sphere_pairs()), channels, channel)


def model_values(
    brdf: AbstractBRDF,
    channels: Channels,
    channel: int,
    incidences: Sequence[float],
    map_incidences: Sequence[float],
) -> ModelValues:
    """All values for figures by one evaluation, of one size for every subject: one compiled program a kind of model.

    `channel`: the number of the shown one among `channels`; the spheres need all of them.
    """
    incidences = [*incidences, *[incidences[-1]] * (len(INCIDENCES) - len(incidences))]
    maps = [*map_incidences, *[map_incidences[-1]] * (len(MAP_INCIDENCES) - len(map_incidences))]
    groups: list[list[Pairs]] = [
        [_plane(t) for t in incidences],
        [_plane(t) for t in COMPARED],
        [_disc(t) for t in maps],
        [_mesh(t) for t in incidences],
        [slice_pairs()],
        _sphere_pairs(),
    ]
    pieces = iter(_evaluated(brdf, list(itertools.chain(*groups))))
    *values, spheres = [[next(pieces) for _ in group] for group in groups]
    curves, compared, discs, meshes, (the_slice,) = [[of_channel(f, channel) for f in group] for group in values]
    return ModelValues(curves, compared, discs, meshes, the_slice, _lit(spheres, channels, channel))


def fewer_channels(table: Table, channel: int) -> tuple[Table, int]:
    """(table, number of the shown channel) with no more channels than figures need: of spectra some are enough."""
    count = len(table.channels)
    if count <= MOST_CHANNELS or table.interpolant is not None:
        return table, channel
    kept = np.unique(np.append(np.linspace(0, count - 1, MOST_CHANNELS - 1).round().astype(int), channel))
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
    return [_linear_srgb(f * cos_i, channels, channel) for f, cos_i in zip(pieces, cosines, strict=True)]


def _linear_srgb(f_cos: np.ndarray, channels: Channels, channel: int) -> np.ndarray:
    """Linear sRGB (n, 3) of f cosθi (n, channels), 1/sr; grey of the shown channel where there is no colour."""
    radiance = np.pi * np.nan_to_num(f_cos)
    to_xyz = colour_matrix(channels)
    if to_xyz is None or radiance.shape[1] != to_xyz.shape[1]:
        return np.repeat(of_channel(radiance, channel)[:, None], 3, axis=1)
    white = LINEAR_SRGB.sum(axis=1) / to_xyz.sum(axis=1)  # equal reflectances are grey
    return radiance @ (np.linalg.inv(LINEAR_SRGB) @ (white[:, None] * to_xyz)).T


def _plane(theta_i: float) -> Pairs:
    signed = np.radians(plane_angles(theta_i))
    return _pairs(theta_i, np.abs(signed), np.where(signed >= 0, np.pi, 0.0))


def _disc(theta_i: float) -> Pairs:
    _, theta, phi = disc_points()
    return _pairs(theta_i, theta, phi)


def _mesh(theta_i: float) -> Pairs:
    theta, phi = (np.radians(a) for a in mesh_angles(theta_i))
    return _pairs(theta_i, *(a.ravel() for a in np.meshgrid(theta, phi, indexing="ij")))


def _pairs(theta_i: float, theta_o: np.ndarray, delta_phi: np.ndarray) -> Pairs:
    t = np.full_like(theta_o, np.radians(theta_i))
    return from_spherical(t, np.zeros_like(t), np), from_spherical(theta_o, delta_phi, np)


def _evaluated(brdf: AbstractBRDF, pairs: Sequence[Pairs]) -> list[np.ndarray]:
    """f (n, channels) at each set of pairs, by one evaluation."""
    wi, wo = (Direction(*(np.concatenate(c) for c in zip(*w, strict=True))) for w in zip(*pairs, strict=True))
    sizes = [np.size(w.z) for w, _ in pairs]
    f = np.asarray(evaluate(brdf, wi, wo)).reshape(sum(sizes), -1)
    return np.split(f, np.cumsum(sizes)[:-1])


OFF_PLANE = 2.5
"""Degrees within which a scattered reading counts as in the plane."""
NEAR_INCIDENCE = 1.0
"""Degrees within which a reading on half/difference angles counts as at an incidence."""
MOST_POINTS = 400
RESIDUALS = 1 << 16


class Readings(NamedTuple):
    """Readings near one incidence: angles, degrees (n,), and f, 1/sr, (n, channels), NaN where it is not valid."""

    theta_o: np.ndarray
    delta_phi: np.ndarray
    f: np.ndarray

    def of_channel(self, channel: int, most: int) -> "Readings":
        """The valid readings of one channel, f of shape (n,); at most so many, evenly chosen."""
        index = np.flatnonzero(np.isfinite(self.f[:, channel]))
        index = evenly_chosen(index, most)
        return Readings(self.theta_o[index], self.delta_phi[index], self.f[index, channel])


class PlaneReadings(NamedTuple):
    """Readings in the plane of incidence: signed outgoing angles, degrees (n,), and f, 1/sr, (n, channels)."""

    theta_o: np.ndarray
    f: np.ndarray


class Residuals(NamedTuple):
    """Residuals of all channels: relative to |reading|, over u(f) where that is known, and angles of the former."""

    relative: np.ndarray
    standardised: np.ndarray
    angles: PairAngles


def evenly_chosen(index: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the entries, at even steps from the first to the last."""
    return index[np.linspace(0, index.size - 1, min(index.size, most)).astype(int)] if index.size else index


def table_incidences(table: Table, wanted: Sequence[float]) -> list[float]:
    """The measured angles of incidence, degrees, nearest to those wanted; the wanted ones where all are measured."""
    if "theta_i" not in table.layout.axes:
        return list(wanted)
    measured = np.unique(np.degrees(table.layout.axes["theta_i"]))
    measured = measured[measured < 89.0]
    if not measured.size or measured.size > 500:
        return list(wanted)
    return sorted({round(float(measured[np.argmin(np.abs(measured - w))]), 9) for w in wanted})


def readings_near(table: Table, incidences: Sequence[float]) -> list[Readings]:
    """For each incidence, degrees, the readings near it that are valid in any channel."""
    pieces: list[list[Readings]] = [[] for _ in incidences]
    tolerance = 1e-3 if "theta_i" in table.layout.axes else NEAR_INCIDENCE
    for start, stop in table.blocks():
        theta_i, phi_i, theta_o, phi_o = (np.degrees(a) for a in table.layout.angles(start, stop))
        block = table.read_values(start, stop)
        valid = (block["flag"] == Flag.VALID).any(axis=1)
        for near, wanted in zip(pieces, incidences, strict=True):
            index = np.flatnonzero(valid & (np.abs(theta_i - wanted) <= tolerance))
            f = np.where(block["flag"][index] == Flag.VALID, block["f"][index], np.nan)
            near.append(Readings(theta_o[index], (phi_o[index] - phi_i[index]) % 360.0, f))
    return [Readings(*map(np.concatenate, zip(*near, strict=True))) for near in pieces]


def in_plane_readings(near: Readings) -> PlaneReadings:
    """The readings in the plane of incidence, or near it; at most `MOST_POINTS`."""
    phi = np.radians(near.delta_phi)
    off = np.degrees(np.arcsin(np.clip(np.sin(np.radians(near.theta_o)) * np.abs(np.sin(phi)), 0, 1)))
    index = np.flatnonzero(off <= 1e-3)
    if index.size < 8:
        index = np.flatnonzero(off <= OFF_PLANE)
    index = evenly_chosen(index, MOST_POINTS)
    signed = np.where(np.cos(phi[index]) <= 0, near.theta_o[index], -near.theta_o[index])
    order = np.argsort(signed, kind="stable")
    return PlaneReadings(signed[order], near.f[index][order])


def fit_residuals(table: Table, brdf: AbstractBRDF, theta_max: float | None) -> Residuals:
    """Residuals of a model at readings up to `theta_max`, radians; at most `RESIDUALS` cells."""
    block = table.samples(limit=RESIDUALS, theta_max=theta_max)
    n = block.f.shape[0]
    if not n:
        return Residuals(np.empty(0), np.empty(0), PairAngles(*[np.empty(0)] * len(PairAngles._fields)))
    index = np.resize(np.arange(n), RESIDUALS)  # repeated to one size, so that one compiled program serves
    wi, wo = (Direction(*(np.asarray(c)[index] for c in w)) for w in (block.wi, block.wo))
    model = np.asarray(evaluate(brdf, wi, wo)).reshape(RESIDUALS, -1)[:n]
    valid = (block.flag == Flag.VALID) & np.isfinite(block.f) & (block.f != 0)
    difference = np.broadcast_to(model, block.f.shape) - np.where(valid, block.f, 0.0)
    known = valid & np.isfinite(block.u_f) & (np.nan_to_num(block.u_f) > 0)
    return Residuals(
        (difference / np.where(valid, np.abs(block.f), 1.0))[valid],
        (difference / np.where(known, block.u_f, 1.0))[known],
        PairAngles(*(np.broadcast_to(a[:, None], block.f.shape)[valid] for a in pair_angles(block.wi, block.wo))),
    )
