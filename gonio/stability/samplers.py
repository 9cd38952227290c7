"""Importance maps: χ² of drawn directions against the density that is claimed, and the density against ∫ = 1.

Directions are counted in polar cells about the lobe's middle, whose rings hold equal shares of the drawn directions.
The density is integrated over the same cells by adaptive rules that do not use the map.
"""

import itertools
import zlib
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy import special

from gonio.checks.table.statistics.counts import sidak
from gonio.models.brdf import AbstractBRDF, Sample
from gonio.models.evaluation import FEW_DRAWS, rounding_of_draws
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.horizon import Hemispheres
from gonio.stability.directions import unit_vector
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, Cell
from gonio.stability.precision import PRECISIONS, cast, cast_directions
from gonio.stability.rectangle_cubature import integrate

INCIDENCES = {"0°": 0.0, "45°": np.radians(45), "80°": np.radians(80), "89°": np.radians(89)}
RINGS, SECTORS = 16, 12
LEAST = 25.0
"""Least expected count of a cell; cells with less are counted together."""
ENOUGH = 1e-6
"""Error of ∫ of the density at which no cell is halved further."""
LEVEL, TESTS = 0.01, 1000
"""Family-wise level of all tests of the whole atlas [Šidák 1967], and no fewer than it makes: a part has the same."""
WHOLE = {"float64": 1e-5, "float32": 1e-3}
"""How far ∫ of the density may be from 1: in single precision opposite directions have no half vector to the digit."""


@eqx.filter_jit
def _sampled(brdf: AbstractBRDF, wi: Direction, u1: jax.Array, u2: jax.Array) -> Sample:
    return jax.vmap(brdf.sample, in_axes=(None, 0, 0))(wi, u1, u2)


@eqx.filter_jit
def _density(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> jax.Array:
    return jax.vmap(brdf.pdf, in_axes=(None, 0))(wi, wo)


def _frames(wi: np.ndarray) -> list[np.ndarray]:
    # Orthonormal frames (rows x, y, z) about the mirror direction, back to the light, straight on, and the normal.
    frames = []
    for middle in (wi * [-1, -1, 1], wi, -wi, unit_vector(0.0)):
        across = np.cross(middle, [0.0, 1.0, 0.0] if abs(middle[1]) < 0.9 else [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        frames.append(np.stack([across, np.cross(middle, across), middle]))
    return frames


def _polar(frame: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = frame @ w.T
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x) % (2 * np.pi)


class Counts(NamedTuple):
    """Counts of drawn directions in cells (rings, sectors), and the shares that the density claims for them.

    `error` is that of the shares' sum; `not_finite` the share of drawn directions that are no numbers; `lost` the
    number of samples that do not leave the surface.
    """

    counts: np.ndarray
    shares: np.ndarray
    error: float
    not_finite: float
    lost: int

    @property
    def off(self) -> float:
        """How far the density's sum is from 1, or above 1 where some of what is drawn is lost."""
        whole = float(self.shares.sum())
        return max(whole - 1, 0.0) if self.lost else abs(whole - 1)


def _counted(brdf: AbstractBRDF, theta: float, number: int, dtype: Any, seed: int, most: float) -> Counts:
    """The counts in cells about the lobe's middle; what fails there, in cells about the normal.

    A failure needs more than one reference: the rule in cells about another middle may be off by more than it claims,
    as where the horizon crosses them, or, of refraction, the circle on which upright facets end the density. About the
    normal both are rings.
    """
    counts = count_and_expect(brdf, theta, number, dtype, seed)
    if counts.off <= most:
        return counts
    return min(counts, count_and_expect(brdf, theta, number, dtype, seed, about_normal=True), key=lambda c: c.off)


def count_and_expect(
    brdf: AbstractBRDF, theta: float, number: int, dtype: Any = np.float64, seed: int = 0, about_normal: bool = False
) -> Counts:
    """Counts and expected shares of a number of directions that are drawn for light from one incidence, radians.

    `about_normal`: in cells about the normal, whatever the lobe's middle is. In single precision what a reflector sends
    below the horizon is lost: next to the direction straight on, half vectors have no digits there.
    """
    rng = np.random.default_rng(seed)
    wi = cast_directions(unit_vector(theta), dtype)
    u = rng.random((2, number)).astype(dtype)
    u = np.minimum(u, np.nextafter(dtype(1), dtype(0)))
    sampled, leaves = _sampled(brdf, wi, *(jnp.asarray(c) for c in u))
    w = np.stack([np.asarray(c, float) for c in sampled], -1)[np.asarray(leaves)]
    upper = np.dtype(dtype) == np.float32 and Hemispheres.TRANSMISSION not in brdf.hemispheres
    if upper:
        w = w[~(w[:, 2] <= 0)]
    good = np.isfinite(w).all(axis=1)
    lost = number - len(w)
    w = w[good] / np.linalg.norm(w[good], axis=1, keepdims=True)
    frames = _frames(np.array([float(c) for c in wi]))
    frame = frames[-1] if about_normal else min(frames, key=lambda f: np.median(_polar(f, w[:20000])[0]))
    beta, psi = _polar(frame, w)
    edges = np.quantile(beta, np.linspace(0, 1, RINGS + 1))
    edges[0], edges[-1] = 0.0, np.pi
    edges = np.maximum.accumulate(edges)
    sectors = np.linspace(0, 2 * np.pi, SECTORS + 1)
    counts = np.histogram2d(beta, psi, bins=(edges + 1e-300 * np.arange(edges.size), sectors))[0]

    def integrand(beta: np.ndarray, psi: np.ndarray) -> np.ndarray:
        s = np.sin(beta)
        local = np.stack([s * np.cos(psi), s * np.sin(psi), np.cos(beta)], -1).reshape(-1, 3)
        wo = local @ frame
        density = np.where(upper & (wo[:, 2] <= 0), 0.0, _density(brdf, wi, cast_directions(wo, dtype)))
        return np.asarray(density, float).reshape(beta.shape) * s

    rims = _rims_of_refraction(brdf, np.array([float(c) for c in wi]), frame)
    shares, error = integrate(integrand, *_cells(edges, sectors, float(np.arccos(frame[2, 2])), rims), ENOUGH)
    return Counts(counts, shares.reshape(RINGS, SECTORS), error, float(1.0 - good.mean()), lost)


def _rims_of_refraction(brdf: AbstractBRDF, wi: np.ndarray, frame: np.ndarray) -> np.ndarray:
    # Polar angles about a frame's middle at which the density of refracted directions ends. Facets refract into a cone
    # about what goes straight through, of half-angle arccos(n₁/n₂), n₁ < n₂; and those that stand upright (h.z = 0),
    # the steepest there are, to cosθo = −cosθi/η: between these two the density is not smooth.
    eta = float(np.mean(np.asarray(brdf.index_behind)))
    if eta == 1.0 or Hemispheres.TRANSMISSION not in brdf.hemispheres:
        return np.zeros(0)
    rims = []
    if frame[2] @ -wi > 1 - 1e-12:
        rims.append(np.arccos(min(eta, 1 / eta)))
    if frame[2, 2] > 1 - 1e-12 and abs(wi[2]) < eta:
        rims.append(np.arccos(-wi[2] / eta))
    return np.array(rims)


def _cells(
    edges: np.ndarray, sectors: np.ndarray, tilt: float, rims: np.ndarray | tuple[float, ...] = ()
) -> tuple[np.ndarray, np.ndarray]:
    # Cells (β0, ψ0, β1, ψ1) and their bins. A ring in the tail spans decades of β: its cells grow by factors. Rings are
    # cut where they touch the horizon, at which densities have a kink, and at the rims of refraction.
    cells, bins = [], []
    touch = np.concatenate([np.pi / 2 + np.array([-tilt, tilt]), rims])
    for k, (ring, end) in enumerate(itertools.pairwise(edges)):
        cuts = np.array([ring, end])
        if end > 2 * max(ring, 1e-9) and end - ring > 0.02:
            cuts = np.concatenate([[ring], np.geomspace(max(ring * 1.3, end / 4096), end, 8)])
        cuts = np.sort([*cuts, *touch[(touch > ring) & (touch < end)]])
        for low, high in itertools.pairwise(cuts):
            for m, (p, q) in enumerate(itertools.pairwise(sectors)):
                cells.append([low, p, high, q])
                bins.append(k * SECTORS + m)
    return np.array(cells), np.array(bins)


def p_value(counts: Counts) -> float:
    """Pearson's χ² test of counts against shares, cells of few expected counts taken together.

    What does not leave the surface is a cell of its own, which has the rest of the shares.
    """
    observed, shares = counts.counts.ravel(), counts.shares.ravel()
    if counts.lost:
        observed, shares = np.append(observed, counts.lost), np.append(shares, 1.0 - shares.sum())
    order = np.argsort(shares)
    expected, observed = shares[order] * observed.sum(), observed[order]
    few = max(int(np.searchsorted(np.cumsum(expected), LEAST)) + 1, int(np.searchsorted(expected, LEAST)))
    expected, observed = (np.concatenate([[a[:few].sum()], a[few:]]) for a in (expected, observed))
    if expected[0] < 1:
        expected, observed = expected[1:], observed[1:]
    chi2 = float(np.sum((observed - expected) ** 2 / expected))
    return float(special.chdtrc(max(expected.size - 1, 1), chi2))


def _whole_and_p(counts: Counts) -> tuple[float, float]:
    """(∫ of the density, p-value of χ²)."""
    return float(counts.shares.sum()), p_value(counts) if np.isfinite(counts.shares).all() else 0.0


def _rounding(brdf: AbstractBRDF, theta: float, seed: int) -> str:
    """What single precision says of its own draws."""
    u1, u2 = np.random.default_rng(seed).random((2, FEW_DRAWS)).astype(np.float32)
    wi = cast_directions(np.tile(unit_vector(theta), (FEW_DRAWS, 1)), np.float32)
    wo, _ = _sampled(brdf, Direction(*(c[0] for c in wi)), jnp.asarray(u1), jnp.asarray(u2))
    note = rounding_of_draws(brdf, wi, wo)
    return note and f"; {note}"


def sampler_cells(name: str, expression: str, precision: str, number: int) -> list[Cell]:
    """One cell for each incidence: the p-value of χ² against the level of one test, and ∫ of the density."""
    dtype = PRECISIONS[precision]
    brdf = cast(build(expression), dtype)
    cells = []
    for column, theta in INCIDENCES.items():
        # Other random numbers for each test, always the same: a recipe that repeats it.
        seed = zlib.crc32(f"{expression} {column} {precision}".encode())
        # Lobes on either side are far apart: no cells about one middle would resolve the others.
        parts = brdf.terms() if Hemispheres.TRANSMISSION in brdf.hemispheres else (brdf,)
        level, most = sidak(LEVEL, TESTS), WHOLE[precision]
        tested = [(c, _whole_and_p(c)) for c in (_counted(part, theta, number, dtype, seed, most) for part in parts)]
        counts, (whole, p) = min(tested, key=lambda t: t[1][1])
        error = max(c.off for c, _ in tested)
        detail = f"p = {p:.3g} (level {level:.2g}) of {number:,} directions; the density adds up to {whole:.7g}"
        note = "" if precision == "float64" else max(_rounding(part, theta, seed) for part in parts)
        if counts.not_finite:
            verdict, detail = SAYS_SO, f"{counts.not_finite:.2g} of the directions drawn are not finite"
        elif counts.error > most:
            verdict, detail = SAYS_SO, f"{detail}, which is known to {counts.error:.1g} only"
        else:
            right = p >= level and error <= most
            verdict, detail = (RIGHT if right else SAYS_SO if note else SILENT), detail if right else detail + note
        cells.append(Cell("sampler", name, expression, column, precision, verdict, error, most, detail))
    return cells
