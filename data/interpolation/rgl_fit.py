"""The arrays of an RGL file [Dupuy 2018] that stand for a BRDF: weighted least squares of the file's own interpolant.

f·cosθo = S(x, y; wi) · D(m) / (4 σ(wi)), with S linear between samples and incidences: S, D and σ are fitted in turns
to f at random pairs of directions, by relative error. D and σ take what depends on the half vector or on the light
alone, so that S is smooth; they are then no distribution of normals, and no projected area.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import sparse

from gonio.data.channels import Channels
from gonio.data.interpolation.inverse_distance import Scattered
from gonio.data.interpolation.rgl_data import RGLData, bilinear, direction, half_vector_at, warped
from gonio.data.interpolation.rgl_layout import RGLLayout
from gonio.data.interpolation.rgl_pairs import BAND, LEAST_COSINE, RGLPairs, horizon_pairs, spread_pairs
from gonio.data.interpolation.scattered import Kriged
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction, dot

Covers = Callable[[Direction, Direction], np.ndarray]
"""Whether a source has values for pairs of directions (n,)."""
MAP_SIDE = 128
"""Nodes of the density of half vectors along an axis, as published."""
NDF_COLUMNS, SIGMA_COLUMNS, TURNING_ROWS, TURNING_COLUMNS = 1024, 256, 65, 257
"""Of D and σ: polar angles, and azimuths of anisotropic files."""
LOBE_SHARE = 0.2
"""Of the samples, those spread as the reflected light; the others evenly over the map of half vectors."""
FALL = 0.2
"""Cosine below the horizon over which the density of samples falls by e."""
LAST_INCIDENCE = np.radians(88.0)
"""Whose density stands for incidences beyond."""
PAIRS_A_NODE, ENOUGH_PAIRS, FEWEST_A_NODE = 30, 120_000, 12
"""Pairs of directions for each sample; no more than enough, but for the fewest."""
LIGHTS, FEW_LIGHTS = 256, 64
"""Directions of the light whose average f by half vector D begins with; fewer of an anisotropic or slow source."""
ENOUGH_COVERED = 0.5
"""Share of the directions that a table must have readings for."""
ROUNDS, STEPS = 5, 80
"""Rounds of fitting in turns; steps of conjugate gradients in each."""
ROBUST = 4.0
"""Relative errors beyond so many times the median count less."""
DIMMEST = 1e-2
"""Of the median S: what is darker is fitted by absolute error."""
ENOUGH = 1e-8
"""Of the first residual's square, at which conjugate gradients end."""
SMOOTH = 1e-4
"""Weight of second differences between samples: it decides those that hardly any pair of directions reads."""
DAMPING, MOST_CHANGE = 8.0, 0.3
"""Of D and σ: pairs that stand against a change; largest change in one round."""
GROUP = 8
"""Channels that are fitted at once; so many of them decide D and σ."""
LEAST_SHARE, LIFT = 0.02, 1.1
"""Weight of a sample from which on it is positive with a negative value; by so much of what lacks."""
LEAST_LIGHT = 1e-30
"""f·cos of a black surface."""
MARGIN, CHECKED_PAIRS = 1e-3, 300_000
"""Of the terms of a sum, by which it is above 0 where some are negative; pairs along the horizon that are looked at."""


@dataclasses.dataclass(frozen=True)
class RGLFit:
    """Arrays for a file."""

    data: RGLData
    luminance: np.ndarray
    """(phi, theta, r, r): density of reflected light over the samples, for importance sampling."""
    valid: np.ndarray
    """(phi, theta, r, r): whether a sample is above the horizon and the source has a value there."""
    covered: float
    """Share of the pairs of directions for which the source has a value."""


def fit_rgl(brdf: AbstractBRDF, channels: Channels, layout: RGLLayout, covers: Covers, description: str) -> RGLFit:
    """The arrays of a file whose interpolant is nearest to f·cosθo, and never negative.

    Args:
        brdf: the model; pairs of directions without a finite value do not count.
        channels: of its values.
        layout: incidences and samples.
        covers: where the model stands for readings, not for what was made up between or beyond them.
        description: text of the file.

    Raises:
        GonioError: the model stands for readings in less than half of the directions.
    """
    rng = np.random.default_rng(0)
    data = _beginning(brdf, channels, layout, description, rng)
    count = max(FEWEST_A_NODE * layout.nodes, min(PAIRS_A_NODE * layout.nodes, ENOUGH_PAIRS))
    pairs = spread_pairs(data, count, rng)
    above = pairs.wo.z > LEAST_COSINE
    luminance_base = pairs.samples.T @ np.ones(above.size)
    pairs = pairs.part(above)
    covered = float(np.mean(covers(pairs.wi, pairs.wo)))
    if covered < ENOUGH_COVERED:
        raise GonioError(
            f"the table has readings for {percent(covered)} of the directions that an RGL file holds, expected "
            f"{percent(ENOUGH_COVERED)} at least; scan more of both hemispheres, or fit a model and convert that"
        )
    f_cos = evaluate_in_blocks(brdf, pairs.wi, pairs.wo) * pairs.wo.z[:, None]
    known = np.isfinite(f_cos).all(axis=1)
    pairs, f_cos = pairs.part(known), f_cos[known]
    data = _with_scales(data, pairs, f_cos, rng)
    light = pairs.samples.T @ _density_ratio(data, pairs, f_cos)
    luminance = (light / np.where(luminance_base > 0, luminance_base, 1.0)).reshape(layout.shape)
    luminance[luminance.sum(axis=(2, 3)) <= 0] = 1.0  # a density is never black
    return RGLFit(data, luminance, _valid(data, covers), covered)


def _beginning(
    brdf: AbstractBRDF, channels: Channels, layout: RGLLayout, description: str, rng: np.random.Generator
) -> RGLData:
    """A file without samples: its density of half vectors, D as the average of f by half vector, σ = 1/4."""
    rows = MAP_SIDE
    u_x, u_y = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, rows)))
    m = half_vector_at(u_x, u_y)
    vndf = np.empty((layout.phi_i.size, layout.theta_i.size, rows, rows))
    for p, t in np.ndindex(vndf.shape[:2]):
        wi = direction(min(layout.theta_i[t], LAST_INCIDENCE), layout.phi_i[p])
        facing = np.maximum(wi @ m, 0.0)
        wo = 2 * facing * m - wi[:, None]
        up = np.where(facing > 0, wo[2], -1.0)
        light = (
            np.where(up > LEAST_COSINE, _grey(brdf, wi[:, None], wo) * up, 0.0) * facing * np.sin(u_x**2 * np.pi / 2)
        )
        light *= u_x
        even = np.exp(np.minimum(up, 0.0) / FALL)
        share = LOBE_SHARE if light.sum() > 0 else 0.0
        density = share * light / max(light.sum(), 1e-300) + (1 - share) * even / even.sum()
        vndf[p, t] = (density / density.max()).reshape(rows, rows)
    ndf, sigma = (2, NDF_COLUMNS), (2, SIGMA_COLUMNS)
    if not layout.isotropic:
        ndf, sigma = (TURNING_ROWS, TURNING_COLUMNS), (TURNING_ROWS, SIGMA_COLUMNS)
    spectra = np.zeros((*layout.shape[:2], len(channels), layout.side, layout.side))
    vndf = vndf.astype(np.float32).astype(float)
    empty = RGLData(layout.theta_i, layout.phi_i, np.ones(ndf), np.full(sigma, 0.25), vndf, spectra, channels,
                    description, True)  # fmt: skip
    return dataclasses.replace(empty, ndf=_mean_by_half_vector(brdf, ndf, layout.isotropic, rng))


def _grey(brdf: AbstractBRDF, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Mean of f over the channels (n,), 0 where it is not finite."""
    f = evaluate_in_blocks(brdf, Direction(*wi), Direction(*wo)).mean(axis=1)
    return np.where(np.isfinite(f), np.maximum(f, 0.0), 0.0)


def _mean_by_half_vector(
    brdf: AbstractBRDF, shape: tuple[int, int], isotropic: bool, rng: np.random.Generator
) -> np.ndarray:
    rows, columns = (1, shape[1]) if isotropic else shape
    u_x, u_y = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows)))
    m = half_vector_at(u_x, u_y)
    total, weight = np.zeros(u_x.size), np.zeros(u_x.size)
    slow = isinstance(brdf, Kriged | Scattered)
    lights = LIGHTS if isotropic and not slow else FEW_LIGHTS
    theta = np.arccos(np.sqrt((np.arange(lights) + 0.5) / lights))
    for wi in direction(theta, rng.uniform(0, 2 * np.pi, lights)).T:
        facing = wi @ m
        wo = 2 * facing * m - wi[:, None]
        here = np.flatnonzero((facing > 0) & (wo[2] > 1e-3))
        share = wi[2] * wo[2, here]
        total[here] += share * _grey(brdf, np.broadcast_to(wi[:, None], (3, here.size)), wo[:, here])
        weight[here] += share
    mean = np.where(total > 0, total / np.where(weight > 0, weight, 1.0), np.nan).reshape(rows, columns)
    # Where no half vector was reached, or all is black: as at the next one.
    for row in mean:
        known = np.flatnonzero(np.isfinite(row))
        row[:] = np.interp(np.arange(columns), known, row[known]) if known.size else 1.0
    return np.broadcast_to(mean, shape).copy()


def _with_scales(data: RGLData, pairs: RGLPairs, f_cos: np.ndarray, rng: np.random.Generator) -> RGLData:
    """The file with D and σ by some of the channels, and the samples of all of them."""
    count = f_cos.shape[1]
    some = np.unique(np.linspace(0, count - 1, min(count, GROUP)).astype(int))
    data = dataclasses.replace(data, sigma=_first_sigma(data, pairs, f_cos[:, some]))
    scales = _Scales(data, pairs)
    samples = np.zeros((data.spectra.size // count, some.size))
    weight = 1 / scales.sizes(f_cos[:, some], DIMMEST)
    for _ in range(ROUNDS):
        samples = scales.solve(f_cos[:, some], weight, samples)
        scales.change(f_cos[:, some], samples)
        weight = scales.robust(f_cos[:, some], samples)
    groups = [some] if count <= GROUP else np.array_split(np.arange(count), -(-count // GROUP))
    begun = [samples] if count <= GROUP else [np.zeros((len(samples), group.size)) for group in groups]
    solved = [_relative_fit(scales, f_cos[:, group], start) for group, start in zip(groups, begun, strict=True)]
    checked = sparse.vstack([pairs.samples, horizon_pairs(data, CHECKED_PAIRS, rng).samples]).tocsr()
    shape = (*data.spectra.shape[:2], *data.spectra.shape[-2:], count)
    samples = np.concatenate(solved, axis=1).reshape(shape)
    samples[:, -1] = np.maximum(samples[:, -1], 0.0)  # where light and detector both graze, few pairs tell
    positive = [_without_negatives(checked, channel) for channel in samples.reshape(-1, count).T]
    spectra = np.moveaxis(np.stack(positive, axis=1).reshape(shape), -1, 2)
    maps = {"ndf": scales.ndf.reshape(data.ndf.shape), "sigma": scales.sigma.reshape(data.sigma.shape)}
    return dataclasses.replace(data, spectra=spectra, **maps)


def _first_sigma(data: RGLData, pairs: RGLPairs, f_cos: np.ndarray) -> np.ndarray:
    """σ for which S is 1 in the (geometric) mean at each polar angle of the light."""
    ratio = np.log(np.maximum(f_cos.mean(axis=1), 1e-300)) - np.log(pairs.ndf @ data.ndf.ravel())
    theta = np.arccos(np.clip(pairs.wi.z, -1.0, 1.0))
    cell = np.abs(theta[:, None] - data.theta_i).argmin(axis=1)
    usable = (f_cos.mean(axis=1) > 0) & (pairs.wo.z > BAND[1])
    count = np.bincount(cell[usable], minlength=data.theta_i.size)
    mean = np.bincount(cell[usable], ratio[usable], data.theta_i.size) / np.maximum(count, 1)
    known = np.flatnonzero(count)
    polar = np.linspace(0, 1, data.sigma.shape[1]) ** 2 * np.pi / 2
    level = np.interp(polar, data.theta_i[known], mean[known]) if known.size else np.zeros(polar.size)
    return np.broadcast_to(np.exp(-level) / 4, data.sigma.shape).copy()


class _Scales:
    """D and σ of a file, and the weighted least squares for its samples that they leave."""

    def __init__(self, data: RGLData, pairs: RGLPairs) -> None:
        self.pairs, self.ndf, self.sigma = pairs, data.ndf.ravel().copy(), data.sigma.ravel().copy()
        self.transposed = pairs.samples.T.tocsr()
        self.bending = _bending((*data.vndf.shape[:2], *data.spectra.shape[-2:]))

    @property
    def factor(self) -> np.ndarray:
        """D/(4σ) of each pair (n, 1)."""
        return (self.pairs.ndf @ self.ndf / (4 * (self.pairs.sigma @ self.sigma)))[:, None]

    def sizes(self, f_cos: np.ndarray, floor: float) -> np.ndarray:
        """|f·cos| (n, channels), at least `floor` of the median S."""
        return np.maximum(np.abs(f_cos), floor * self.usual(f_cos))

    def usual(self, f_cos: np.ndarray) -> np.ndarray:
        """f·cos (n, channels) of the median S."""
        factor = self.factor
        return np.median(np.abs(f_cos / factor), axis=0) * factor + LEAST_LIGHT

    def solve(self, f_cos: np.ndarray, weight: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Samples (nodes, channels) for which f·cos is right within 1/`weight`.

        Conjugate gradients on the normal equations of all channels at once, from `samples`.
        """
        factor, matrix = self.factor, self.pairs.samples
        square = (weight * factor) ** 2
        diagonal = matrix.power(2).T @ square
        usual = np.median(diagonal, axis=0) + 1e-300
        diagonal = diagonal + SMOOTH * usual

        def normal(x: np.ndarray) -> np.ndarray:
            return self.transposed @ (square * (matrix @ x)) + SMOOTH * usual * (self.bending @ x)

        residual = self.transposed @ (square * f_cos / factor) - normal(samples)
        step = residual / diagonal
        product = first = np.sum(residual * step, axis=0)
        for _ in range(STEPS):
            if (product <= ENOUGH * first).all():
                break
            image = normal(step)
            length = product / np.maximum(np.sum(step * image, axis=0), 1e-300)
            samples = samples + length * step
            residual = residual - length * image
            scaled = residual / diagonal
            product, before = np.sum(residual * scaled, axis=0), product
            step = scaled + product / np.maximum(before, 1e-300) * step
        return samples

    def robust(self, f_cos: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Weights (n, channels) for the next round: 1 over |f·cos|, less where it is far off."""
        size = self.sizes(f_cos, DIMMEST)
        error = np.abs(self.factor * (self.pairs.samples @ samples) - f_cos) / size
        usual = ROBUST * np.maximum(np.median(error, axis=0), 1e-12)
        return 1 / (size * np.sqrt(1 + (error / usual) ** 2))

    def change(self, f_cos: np.ndarray, samples: np.ndarray) -> None:
        """Moves D and σ towards f·cos over what the file makes of it, in the mean over the channels."""
        made = self.factor * (self.pairs.samples @ samples)
        off = np.clip(f_cos / np.where(np.abs(made) > 1e-300, made, 1e-300) - 1, -MOST_CHANGE, MOST_CHANGE)
        weight = (self.robust(f_cos, samples) * self.sizes(f_cos, DIMMEST)) ** 2
        total = np.sum(weight, axis=1)
        off, total = np.sum(off * weight, axis=1) / np.maximum(total, 1e-300), total / weight.shape[1]
        for _ in range(2):
            for matrix, values, power in ((self.pairs.sigma, self.sigma, -1.0), (self.pairs.ndf, self.ndf, 1.0)):
                change = (matrix.T @ (total * off)) / (matrix.T @ total + DAMPING)
                values *= (1 + change) ** power
                off = off - matrix @ change


def _bending(shape: tuple[int, int, int, int]) -> Any:
    """Sum of squares of second differences of samples along rows and columns, and of first ones between incidences."""
    total: Any = sparse.csr_array((int(np.prod(shape)),) * 2)
    for axis, n in enumerate(shape):
        order = 2 if axis > 1 else 1
        if n > order:
            difference = sparse.csr_array(np.diff(np.eye(n), order, axis=0))
            before, after = (sparse.eye_array(int(np.prod(part))) for part in (shape[:axis], shape[axis + 1 :]))
            whole = sparse.kron(sparse.kron(before, difference), after).tocsr()
            total = total + (1.0 if order == 2 else 0.01) * (whole.T @ whole)
    return total


def _relative_fit(scales: _Scales, f_cos: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Samples (nodes, channels) of least relative error, fitted from others."""
    weight = 1 / scales.sizes(f_cos, DIMMEST)
    if samples.any():
        weight = scales.robust(f_cos, samples)
    for _ in range(ROUNDS):
        samples = scales.solve(f_cos, weight, samples)
        weight = scales.robust(f_cos, samples)
    return samples


def _without_negatives(matrix: Any, samples: np.ndarray) -> np.ndarray:
    """Samples (nodes,) positive until their interpolant is negative for none of the pairs, in single precision too."""
    samples = samples.copy()
    while True:
        lacking = MARGIN * (matrix @ np.abs(samples)) - matrix @ samples
        low = np.flatnonzero(lacking > 0)
        if not low.size:
            return samples
        part = matrix[low].tocoo()
        near = part.data > LEAST_SHARE
        increase = np.zeros_like(samples)
        np.maximum.at(increase, part.col[near], LIFT * lacking[low][part.row[near]])
        samples += increase


def _density_ratio(data: RGLData, pairs: RGLPairs, f_cos: np.ndarray) -> np.ndarray:
    """Reflected light over the density of samples, up to a factor (n,), by the nearest incidence of the file."""
    m = np.array([a + b for a, b in zip(pairs.wi, pairs.wo, strict=True)])
    m /= np.linalg.norm(m, axis=0)
    theta = np.arctan2(np.hypot(m[0], m[1]), m[2])
    u_x, u_y = np.sqrt(theta * 2 / np.pi), np.mod(np.arctan2(m[1], m[0]) / (2 * np.pi) + 0.5, 1.0)
    theta_i, phi_i = np.arccos(np.clip(pairs.wi.z, -1, 1)), np.arctan2(pairs.wi.y, pairs.wi.x)
    p, t = (np.abs(a[:, None] - nodes).argmin(axis=1) for a, nodes in ((phi_i, data.phi_i), (theta_i, data.theta_i)))
    density = np.empty(u_x.size)
    for key in np.ndindex(data.vndf.shape[:2]):
        here = (p == key[0]) & (t == key[1])
        density[here] = bilinear(data.warp[0][key], u_x[here], u_y[here])
    light = np.maximum(f_cos, 0.0).mean(axis=1) * dot(pairs.wi, Direction(*m)) * np.sin(theta) * u_x
    return light / np.where(density > 0, density, np.inf)


def _valid(data: RGLData, covers: Covers) -> np.ndarray:
    r = data.spectra.shape[-1]
    y, x = (axis.ravel() for axis in np.meshgrid(*2 * (np.linspace(0.0, 1.0, r),), indexing="ij"))
    valid = np.zeros((*data.vndf.shape[:2], r * r), bool)
    for p, t in np.ndindex(data.vndf.shape[:2]):
        wi = direction(data.theta_i[t], data.phi_i[p])
        m = half_vector_at(*warped(data, p, t, x, y))
        wo = 2 * (wi @ m) * m - wi[:, None]
        up = np.flatnonzero((wo[2] > LEAST_COSINE) & (wi @ m > 0) & (wi[2] > LEAST_COSINE))
        light = Direction(*np.broadcast_to(wi[:, None], (3, up.size)))
        valid[p, t, up] = covers(light, Direction(*wo[:, up]))
    return valid.reshape(*data.vndf.shape[:2], r, r)
