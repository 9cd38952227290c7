"""What a report shows of one subject, as numbers: slices, maps, albedo, residuals. The figures draw nothing else."""

import dataclasses
import itertools
from typing import Any

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Channels, Table
from gonio.figures.half_difference_slice import slice_pairs
from gonio.figures.hemisphere import disc_points
from gonio.figures.lobe3d import mesh_angles
from gonio.figures.spheres import sphere_pairs
from gonio.fitting.residuals.colour_difference import LINEAR_SRGB, colour_matrix
from gonio.fitting.residuals.pair_angles import PairAngles, pair_angles
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction

INCIDENCES = (0.0, 30.0, 60.0, 80.0)
MAP_INCIDENCES = (30.0, 60.0)
COMPARED = (30.0, 60.0)
MOST_CHANNELS = 24
OFF_PLANE = 2.5  # degrees within which a scattered sample counts as in the plane
NEAR_INCIDENCE = 1.0
MOST_POINTS = 400
RESIDUALS = 1 << 16


def plane_angles(theta_i: float) -> np.ndarray:
    """Signed outgoing angles, degrees, of a model's curve: every degree, and closer around the mirror direction."""
    near = np.concatenate([-np.geomspace(8, 0.01, 30), [0.0], np.geomspace(0.01, 8, 30)])
    every = np.concatenate([np.linspace(-89.5, 89.5, 180), np.clip(theta_i + near, -89.5, 89.5)])
    return np.sort(every)


def directions(theta: np.ndarray, phi: np.ndarray) -> Direction:
    """Unit vectors of angles in radians, as NumPy arrays."""
    return Direction(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) * np.ones_like(phi))


def model_views(brdf: AbstractBRDF, incidences: list[float], map_incidences: list[float]) -> tuple[list, list]:
    """(curves, maps) of a model: f, 1/sr, of shape (n, channels) in the plane and on the discs of `disc_points`."""
    parts = [_plane(t) for t in incidences] + [_disc(t) for t in map_incidences]
    pieces = _evaluated(brdf, parts)
    return pieces[: len(incidences)], pieces[len(incidences) :]


@dataclasses.dataclass(frozen=True)
class Views:
    """What a BRDF shows wherever it is looked at: f, 1/sr, of one channel, each of shape (n,)."""

    curves: list[np.ndarray]
    """In the plane, at `plane_angles` of each incidence."""
    compared: list[np.ndarray]
    """The same at `COMPARED`, where subjects stand side by side."""
    maps: list[np.ndarray]
    meshes: list[np.ndarray]
    """At `mesh_angles` of each incidence."""
    slice: np.ndarray
    """At `slice_pairs`."""
    spheres: list[np.ndarray]
    """For each of `LIGHTS`: linear sRGB (pixels, 3) of a sphere."""


def views(
    brdf: AbstractBRDF, channels: Channels, shown: int, incidences: list[float], map_incidences: list[float]
) -> Views:
    """All of it by one evaluation, of one size for every subject: one compiled program a kind of model.

    `shown`: the number of the channel, among `channels`; the spheres need all of them.
    """
    incidences = [*incidences, *[incidences[-1]] * (len(INCIDENCES) - len(incidences))]
    maps = [*map_incidences, *[map_incidences[-1]] * (len(MAP_INCIDENCES) - len(map_incidences))]
    parts = [_plane(t) for t in (*incidences, *COMPARED)] + [_disc(t) for t in maps]
    parts += [_mesh(t) for t in incidences]
    parts.append(tuple(Direction(*w) for w in slice_pairs()))
    _, eye, lights = sphere_pairs()
    # Pixels in the shade are dark whatever the surface does.
    for light in lights:
        lit = light.z > 0
        parts.append((Direction(*(np.where(lit, c, e) for c, e in zip(light, eye, strict=True))), eye))
    pieces = _evaluated(brdf, parts)
    spheres = [
        _linear(np.where((light.z > 0)[:, None], f, 0.0) * light.z[:, None], channels, shown)
        for f, light in zip(pieces[-len(lights) :], lights, strict=True)
    ]
    one = [f[:, shown if f.shape[1] > 1 else 0] for f in pieces]
    at = np.cumsum([0, len(incidences), len(COMPARED), len(maps), len(incidences)])
    curves, compared, discs, meshes = (one[a:b] for a, b in itertools.pairwise(at))
    return Views(curves, compared, discs, meshes, one[at[-1]], spheres)


def _linear(f_cos: np.ndarray, channels: Channels, shown: int) -> np.ndarray:
    """Linear sRGB (n, 3) of f cosθi (n, channels), 1/sr; grey of the shown channel where they have no colour."""
    radiance = np.pi * np.nan_to_num(f_cos)
    to_xyz = colour_matrix(channels)
    if to_xyz is None or radiance.shape[1] != to_xyz.shape[1]:
        k = shown if radiance.shape[1] > 1 else 0
        return np.repeat(radiance[:, k : k + 1], 3, axis=1)
    white = LINEAR_SRGB.sum(axis=1) / to_xyz.sum(axis=1)  # equal reflectances are grey
    return radiance @ (np.linalg.inv(LINEAR_SRGB) @ (white[:, None] * to_xyz)).T


def fewer_channels(table: Table, shown: int) -> tuple[Table, int]:
    """(table, number of the shown channel) with no more channels than pictures need: of spectra some are enough."""
    count = len(table.channels)
    if count <= MOST_CHANNELS or table.interpolant is not None:
        return table, shown
    kept = np.unique(np.append(np.linspace(0, count - 1, MOST_CHANNELS - 1).round().astype(int), shown))
    return table.only([table.channels.names[k] for k in kept]), int(np.searchsorted(kept, shown))


def _plane(theta_i):
    signed = np.radians(plane_angles(theta_i))
    return _spherical(theta_i, np.abs(signed), np.where(signed >= 0, np.pi, 0.0))


def _disc(theta_i):
    _, theta, phi = disc_points()
    return _spherical(theta_i, theta, phi)


def _mesh(theta_i):
    theta, phi = (np.radians(a) for a in mesh_angles(theta_i))
    return _spherical(theta_i, *(a.ravel() for a in np.meshgrid(theta, phi, indexing="ij")))


def _spherical(theta_i, theta_o, phi):
    t = np.full_like(theta_o, np.radians(theta_i))
    return directions(t, np.zeros_like(t)), directions(theta_o, phi)


def _evaluated(brdf, parts) -> list[np.ndarray]:
    wi, wo = (Direction(*(np.concatenate(c) for c in zip(*w, strict=True))) for w in zip(*parts, strict=True))
    f = np.asarray(evaluate(brdf, wi, wo))
    sizes = [np.size(p[0].z) for p in parts]
    return np.split(f.reshape(sum(sizes), -1), np.cumsum(sizes)[:-1])


def table_incidences(table: Table, wanted: tuple[float, ...]) -> list[float]:
    """The measured angles of incidence, degrees, nearest to those wanted; the wanted ones where all are measured."""
    if table.layout.name == "half_difference":
        return list(wanted)
    there = np.unique(np.degrees(table.layout.axes["theta_i"]))
    there = there[there < 89.0]
    if not there.size or there.size > 500:
        return list(wanted)
    return sorted({round(float(there[np.argmin(np.abs(there - w))]), 9) for w in wanted})


def readings_near(table: Table, incidences: list[float]) -> list[dict[str, Any]]:
    """For each incidence, degrees, the valid readings near it: theta_o, delta_phi (degrees), f (n, channels)."""
    found: list[list] = [[] for _ in incidences]
    exact = table.layout.name != "half_difference"
    for start, stop in table.blocks():
        theta_i, phi_i, theta_o, phi_o = (np.degrees(a) for a in table.layout.angles(start, stop))
        block = table.read_values(start, stop)
        valid = (block["flag"] == Flag.VALID).any(axis=1)
        for k, wanted in enumerate(incidences):
            at = np.flatnonzero(valid & (np.abs(theta_i - wanted) <= (1e-3 if exact else NEAR_INCIDENCE)))
            f = np.where(block["flag"][at] == Flag.VALID, block["f"][at], np.nan)
            found[k].append((theta_o[at], (phi_o[at] - phi_i[at]) % 360.0, f))
    return [
        dict(zip(("theta_o", "delta_phi", "f"), map(np.concatenate, zip(*f, strict=True)), strict=True)) for f in found
    ]


def in_plane_points(near: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """(signed theta_o, f) of the readings in the plane of incidence, or near it; at most `MOST_POINTS`."""
    theta_o, phi = near["theta_o"], np.radians(near["delta_phi"])
    off = np.degrees(np.arcsin(np.clip(np.sin(np.radians(theta_o)) * np.abs(np.sin(phi)), 0, 1)))
    at = np.flatnonzero(off <= 1e-3)
    if at.size < 8:
        at = np.flatnonzero(off <= OFF_PLANE)
    at = at[np.linspace(0, at.size - 1, min(at.size, MOST_POINTS)).astype(int)] if at.size else at
    signed = np.where(np.cos(phi[at]) <= 0, theta_o[at], -theta_o[at])
    order = np.argsort(signed, kind="stable")
    return signed[order], near["f"][at][order]


def residuals(table: Table, brdf: AbstractBRDF, theta_max: float | None) -> dict[str, np.ndarray]:
    """Residuals at readings, all channels: (model − reading)/|reading|, the same over u(f), and angles in degrees."""
    block = table.samples(limit=RESIDUALS, theta_max=theta_max)
    n = block.f.shape[0]
    if not n:
        return {name: np.empty(0) for name in ("relative", "in_u", *PairAngles._fields)}
    index = np.resize(np.arange(n), RESIDUALS)  # repeated to one size, so that one compiled program serves
    wi, wo = (Direction(*(np.asarray(c)[index] for c in w)) for w in (block.wi, block.wo))
    model = np.asarray(evaluate(brdf, wi, wo)).reshape(RESIDUALS, -1)[:n]
    valid = (block.flag == Flag.VALID) & np.isfinite(block.f) & (block.f != 0)
    angles = pair_angles(block.wi, block.wo)._asdict()
    difference = np.broadcast_to(model, block.f.shape) - np.where(valid, block.f, 0.0)
    known = valid & np.isfinite(block.u_f) & (np.nan_to_num(block.u_f) > 0)
    return {
        "relative": (difference / np.where(valid, np.abs(block.f), 1.0))[valid],
        "in_u": (difference / np.where(known, block.u_f, 1.0))[known],
        **{name: np.broadcast_to(a[:, None], block.f.shape)[valid] for name, a in angles.items()},
    }
