"""The adaptive measurement of the RGL instrument [Dupuy 2018]: retro-reflection, normals, then readings by them.

A retro-reflection scan gives the distribution of normals D, an eigenvector: f(w, w) cosθ ∝ D(w)/σ(w), with the
projected area σ(w) = ∫ D(m) ⟨w, m⟩ dm. D, weighted by ⟨wi, m⟩, is the density of normals visible from each incidence;
an even grid of the unit square, warped by it, says where to read.
"""

import dataclasses
import functools
import warnings
from typing import Any, Unpack

import numpy as np

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.formats.rgl_write import LUMINANCE, rgl_channels
from gonio.data.interpolation.rgl_data import RGLData, bilinear, direction, half_vector_at, samples_of
from gonio.data.interpolation.rgl_fit import RGLFit
from gonio.data.interpolation.rgl_layout import RGLLayout, sectors_of
from gonio.data.interpolation.rgl_pairs import bilinear_matrix
from gonio.data.layouts import Layout, spherical_angles
from gonio.data.subject import SubjectLike, load_material
from gonio.data.table import Block, Table
from gonio.instrument.instrument import Instrument
from gonio.instrument.measurement import measure
from gonio.instrument.scans import THETA_MAX
from gonio.instrument.sinks import MeasureOptions
from gonio.models.display import percent
from gonio.models.errors import GonioError

INCIDENCES, SAMPLES = 8, 32
"""Polar angles of the light, and samples along a side for each, as published."""
RETRO_POLAR, RETRO_AZIMUTHS = 64, 24
"""Half vectors of the retro-reflection scan: polar angles; azimuths for an anisotropic surface."""
BESIDE_SHADOW = 1.05
"""How far apart the arms stand in it, in widths of the detector's shadow."""
MAP_COLUMNS, MAP_ROWS = 128, 64
QUADRATURE, PART = 128, 256
"""Polar angles, and azimuths, of the integral over normals; directions of the light at once."""
MOST_STEPS, CONVERGED = 200, 1e-9
"""Of the power iteration."""
DARKEST = 1e-6
"""Of the largest D: below, a reading of retro-reflection says nothing."""


@dataclasses.dataclass(frozen=True)
class RGLScan:
    """What an adaptive measurement gives: all its readings, those of retro-reflection first, and the file's arrays."""

    table: Table
    fit: RGLFit
    retro_cells: int
    hours: float

    def sentence(self) -> str:
        """Readings and hours."""
        return (
            f"{self.retro_cells} readings of retro-reflection and {self.table.layout.size - self.retro_cells} of "
            f"the warped grid: {self.hours:.3g} hours of moving, settling and counting"
        )


def measure_rgl(
    material: SubjectLike,
    instrument: Instrument | None = None,
    incidences: int = INCIDENCES,
    samples: int = SAMPLES,
    theta_max: float = THETA_MAX,
    **options: Unpack[MeasureOptions],
) -> RGLScan:
    """Readings by the procedure of the RGL instrument, and the arrays of its file.

    The half vector is exactly that of retro-reflection: where the detector would stand in the light, the arms stand
    apart to both sides of it by just more than its shadow. Samples that cannot be read are filled from their
    neighbours, those below the horizon with 0, as in published files; the file's `valid` says which were read.
    Incidences beyond the last are read as the last.

    Args:
        material: any subject; whether it is anisotropic, and by which symmetry, is taken from it.
        instrument: ideal by default.
        incidences: polar angles of the light, evenly from 0 to `theta_max`, at least 2.
        samples: along a side of the unit square, at each incidence, at least 2.
        theta_max: largest polar angle of the light, radians.
        options: of `gonio.measure`: `seed`, `log`, `progress`, `command`, `dtype`.

    Raises:
        GonioError: retro-reflection gives no distribution of normals; a number out of range.
    """
    if not (2 <= incidences <= 1000 and 2 <= samples <= 1000 and 0 < theta_max < np.pi / 2):
        raise GonioError(
            f"{incidences} incidences of {samples} × {samples} samples up to {np.degrees(theta_max):g}° came; give "
            "from 2 to 1000 of each, and an angle between 0 and 90°"
        )
    subject, instrument = load_material(material), instrument or Instrument()
    rgl_channels(subject.channels)  # refuses others before any work
    seed = options.get("seed", 0)
    log = options.get("log") or functools.partial(warnings.warn, stacklevel=2)
    sectors = sectors_of(subject.brdf)
    layout = RGLLayout.of_incidences(incidences, samples, theta_max, sectors)
    retro = retro_layout(sectors is not None, theta_max, instrument.shadow)
    first = measure(subject, instrument, retro, seed=seed, log=lambda text: None)
    data = normals_of_retro(first, layout, f"{subject.name}, measured by gonio with seed {seed}")
    cells = [samples_of(data, *key)[:2] for key in np.ndindex(layout.shape[:2])]
    angles = [np.concatenate(a) for a in zip(*(_angles(wi, wo) for wi, wo in cells), strict=True)]
    # One measurement of both parts: its noise is by the cell's number, so the first readings are the same again.
    whole = layouts.front_samples(*(np.concatenate(pair) for pair in zip(retro.angles(), angles, strict=True)))
    table = measure(subject, instrument, whole, **{**options, "log": log})
    above = whole.readable()
    hours = instrument.pace.path_seconds([a[above] for a in whole.angles()], instrument.seconds) / 3600
    scan = RGLScan(table, _with_readings(data, table.read(retro.size)), retro.size, hours)
    table.provenance["scan"] = {
        "layout": "scattered", "shape": [whole.size], "procedure": "RGL [Dupuy 2018]", "retro_cells": retro.size,
        "incidences": list(layout.shape[:2]), "samples": samples, "hours": hours,
    }  # fmt: skip
    log(scan.sentence())
    if (negative := int(np.count_nonzero(table.read_values(retro.size)["f"] < 0))) > 0:
        log(f"{negative} readings of the warped grid are negative: the table keeps them, a .bsdf file holds 0 there")
    return scan


def retro_layout(anisotropic: bool, theta_max: float, shadow: float) -> Layout:
    """Pairs whose half vectors are spread evenly over the map up to `theta_max`; the arms stand together, or apart
    across the plane of the half vector by a little more than the `shadow`."""
    theta = np.linspace(0, np.sqrt(theta_max), RETRO_POLAR) ** 2
    phi = np.linspace(-np.pi, np.pi, RETRO_AZIMUTHS + 1) if anisotropic else np.zeros(1)
    phi, theta = (a.ravel() for a in np.meshgrid(phi, theta, indexing="ij"))
    m = direction(theta, phi)
    across = np.array([-np.sin(phi), np.cos(phi), 0 * phi])
    half = BESIDE_SHADOW * shadow / 2
    wi, wo = (m * np.cos(half) + side * across * np.sin(half) for side in (1, -1))
    return layouts.scattered(*spherical_angles(*wi), *spherical_angles(*wo))


def normals_of_retro(retro: Table, layout: RGLLayout, description: str) -> RGLData:
    """A file without samples whose D, σ and visible normals are those that readings of retro-reflection tell."""
    signal = _retro_signal(retro, 1 if layout.isotropic else RETRO_AZIMUTHS + 1)
    ndf = _power_iteration(signal, layout.isotropic)
    rows = 2 if layout.isotropic else MAP_ROWS
    u_x, u_y = np.meshgrid(np.linspace(0, 1, MAP_COLUMNS), np.linspace(0, 1, rows))
    shape = (rows, MAP_COLUMNS)
    ndf_map = bilinear(ndf, u_x, u_y)
    sigma = _projected_areas(ndf, half_vector_at(u_x.ravel(), u_y.ravel())).reshape(shape)
    u_x, u_y = (a.ravel() for a in np.meshgrid(*2 * (np.linspace(0, 1, MAP_COLUMNS),)))
    m = half_vector_at(u_x, u_y)
    weight = bilinear(ndf_map, u_x, u_y) * np.sin(u_x**2 * np.pi / 2) * u_x
    vndf = np.array([
        [np.maximum(direction(theta, phi) @ m, 0.0) * weight for theta in layout.theta_i] for phi in layout.phi_i
    ])  # fmt: skip
    vndf = (vndf / vndf.max(axis=-1, keepdims=True)).reshape(*layout.shape[:2], MAP_COLUMNS, MAP_COLUMNS)
    ndf_map, sigma, vndf = (
        a.astype(np.float32).astype(float) for a in (ndf_map, np.maximum(sigma, DARKEST), vndf)
    )  # as the file will hold them
    ones = np.ones((*layout.shape[:2], len(retro.channels), layout.side, layout.side))
    channels = retro.channels
    return RGLData(layout.theta_i, layout.phi_i, ndf_map, sigma, vndf, ones, channels, description, True)


def _retro_signal(retro: Table, azimuths: int) -> np.ndarray:
    """f cosθ of the half vector (azimuths, map columns), the mean of the channels; gaps are bridged."""
    block = retro.read()
    f = np.where(block.flag == Flag.VALID, block.f, np.nan)
    readable = np.isfinite(f).any(axis=1)
    if not readable.any():
        raise GonioError("no reading of retro-reflection is valid; a smaller shadow or wider ranges of the axes help")
    mean = np.full(len(f), np.nan)
    mean[readable] = np.nanmean(f[readable], axis=1)
    half = np.array([a + b for a, b in zip(block.wi, block.wo, strict=True)])
    theta = np.arctan2(np.hypot(half[0], half[1]), half[2])
    columns = np.linspace(0, 1, MAP_COLUMNS)
    rows = []
    for row, polar in zip(mean.reshape(azimuths, -1), theta.reshape(azimuths, -1), strict=True):
        known = np.isfinite(row)
        rows.append(np.interp(columns, np.sqrt(polar[known] * 2 / np.pi), row[known]) if known.any() else None)
    usual = np.mean([row for row in rows if row is not None], axis=0)
    signal = np.array([usual if row is None else row for row in rows])
    if azimuths == 1:
        signal = np.repeat(signal, 2, axis=0)
    if not signal.max() > 0:
        raise GonioError("the surface sends no light back, so retro-reflection tells no distribution of its normals")
    cosine = np.cos(columns**2 * np.pi / 2)
    return np.maximum(signal, DARKEST * signal.max()) * np.maximum(cosine, 0.0)


def _power_iteration(signal: np.ndarray, isotropic: bool) -> np.ndarray:
    """D (rows, columns) for which D = c · signal · σ[D], normalised to ∫ D cosθ dm = 1."""
    columns, rows = np.linspace(0, 1, signal.shape[1]), np.linspace(0, 1, signal.shape[0])
    u_x, u_y = np.meshgrid(columns, rows[:1] if isotropic else rows)
    light = half_vector_at(u_x.ravel(), u_y.ravel())
    kernel = _area_kernel(signal.shape, light)
    ndf = signal.copy()
    for _ in range(MOST_STEPS):
        area = np.broadcast_to((kernel @ ndf.ravel()).reshape(u_x.shape), signal.shape)
        after = signal * area
        after /= after.max()
        change = np.abs(after - ndf / ndf.max()).max()
        ndf = after
        if change < CONVERGED:
            break
    else:
        warnings.warn(
            f"the distribution of normals still changed by {percent(float(change))} of its largest value after "
            f"{MOST_STEPS} steps: the warped grid may miss the highlight",
            stacklevel=2,
        )
    return ndf / _projected_areas(ndf, np.array([[0.0], [0.0], [1.0]]))


def _projected_areas(ndf: np.ndarray, light: np.ndarray) -> np.ndarray:
    """σ = ∫ D(m) ⟨w, m⟩ dm of directions (3, n)."""
    m, weights = _quadrature(ndf.shape)
    density = weights @ ndf.ravel()
    return np.concatenate([np.maximum(part.T @ m, 0.0) @ density for part in _parts(light)])


def _area_kernel(shape: tuple[int, ...], light: np.ndarray) -> np.ndarray:
    """(directions, nodes of D): what each node adds to σ of directions (3, n)."""
    m, weights = _quadrature(shape)
    return np.concatenate([np.maximum(part.T @ m, 0.0) @ weights for part in _parts(light)])


def _parts(light: np.ndarray) -> list[np.ndarray]:
    return np.array_split(light, -(-light.shape[1] // PART), axis=1)


def _quadrature(shape: tuple[int, ...]) -> tuple[np.ndarray, Any]:
    """Half vectors (3, q) of the midpoint rule over the map, and the sparse weights (q, nodes) of a bilinear D."""
    u = (np.arange(QUADRATURE) + 0.5) / QUADRATURE
    u_x, u_y = (a.ravel() for a in np.meshgrid(u, u))
    element = 2 * np.pi * np.pi * u_x * np.sin(u_x**2 * np.pi / 2) / QUADRATURE**2
    return half_vector_at(u_x, u_y), bilinear_matrix(u_x, u_y, shape[1], shape[0]).multiply(element[:, None]).tocsr()


def _angles(wi: np.ndarray, wo: np.ndarray) -> list[np.ndarray]:
    wi = np.broadcast_to(wi.reshape(3, -1), wo.shape)
    return list(np.broadcast_arrays(*spherical_angles(*wi), *spherical_angles(*wo)))


def _with_readings(data: RGLData, block: Block) -> RGLFit:
    """The file with S = f cosθo · 4σ/D of the readings."""
    from scipy.ndimage import distance_transform_edt

    shape = (*data.vndf.shape[:2], *data.spectra.shape[-2:])
    unit = np.concatenate([samples_of(data, *key)[2][:, 0] for key in np.ndindex(shape[:2])])  # D/(4σ cosθo)
    usable = (block.flag == Flag.VALID) & (unit > 0)[:, None]
    values = np.where(usable, block.f / np.where(unit > 0, unit, 1.0)[:, None], 0.0)
    below = (block.flag == Flag.BELOW_HORIZON).all(axis=1)
    values, usable = (a.reshape(*shape, -1) for a in (values, usable))
    for key in np.ndindex(*shape[:2], values.shape[-1]):
        place = (*key[:2], slice(None), slice(None), key[2])
        if usable[place].any():
            nearest: Any = distance_transform_edt(~usable[place], return_distances=False, return_indices=True)
            values[place] = values[place][tuple(nearest)]
    values[below.reshape(shape)] = 0.0
    spectra = np.moveaxis(np.maximum(values, 0.0), -1, 2)
    weight = LUMINANCE if spectra.shape[2] == 3 else np.full(spectra.shape[2], 1 / spectra.shape[2])
    luminance = np.tensordot(spectra, weight, axes=(2, 0))
    luminance[luminance.sum(axis=(2, 3)) <= 0] = 1.0
    valid = np.asarray(usable.all(axis=-1))
    share = float(valid.sum() / max(np.count_nonzero(~below), 1))
    return RGLFit(dataclasses.replace(data, spectra=spectra), luminance, valid, share)
