"""Importance maps: χ² of what is drawn against the density that is claimed, and the density against ∫ = 1.

Directions are counted in polar cells about the lobe's middle, whose rings hold equal shares of what was drawn. The
density is integrated over the same cells by adaptive rules that know nothing of the map.
"""

import itertools
import zlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, Cell
from gonio.stability.precision import PRECISIONS, cast
from gonio.stability.rectangle_cubature import integrate

INCIDENCES = {"0°": 0.0, "45°": np.radians(45), "80°": np.radians(80), "89°": np.radians(89)}
AZIMUTH = 0.3
RINGS, SECTORS = 16, 12
LEAST = 25.0
"""Least expected count of a cell; cells with less are counted together."""
ENOUGH = 1e-6
"""Error of ∫ of the density at which no cell is halved further."""
LEVEL, TESTS = 0.01, 1000
"""Family-wise level of all tests of the whole atlas [Šidák 1967], and no fewer than it makes: a part has the same."""
WHOLE = {"float64": 1e-5, "float32": 1e-3}
"""How far ∫ of the density may be from 1: in single precision opposite directions have no half vector to the digit."""


def sidak(tests: int = TESTS) -> float:
    """The level of each of so many independent tests that all together err with `LEVEL`."""
    return -np.expm1(np.log1p(-LEVEL) / tests)


@eqx.filter_jit
def _drawn(brdf, wi, u1, u2):
    return jax.vmap(brdf.sample, in_axes=(None, 0, 0))(wi, u1, u2)


@eqx.filter_jit
def _density(brdf, wi, wo):
    return jax.vmap(brdf.pdf, in_axes=(None, 0))(wi, wo)


def _incidence(theta: float, dtype) -> Direction:
    c = np.sin(theta) * np.cos(AZIMUTH), np.sin(theta) * np.sin(AZIMUTH), np.cos(theta)
    return Direction(*(jnp.asarray(x, dtype) for x in c))


def _frames(wi: np.ndarray) -> list[np.ndarray]:
    # Orthonormal frames (rows x, y, z) about the mirror direction, back to the light, and the normal.
    frames = []
    for middle in (wi * [-1, -1, 1], wi, np.array([0.0, 0.0, 1.0])):
        across = np.cross(middle, [0.0, 1.0, 0.0] if abs(middle[1]) < 0.9 else [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        frames.append(np.stack([across, np.cross(middle, across), middle]))
    return frames


def _polar(frame: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = frame @ w.T
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x) % (2 * np.pi)


def count_and_expect(brdf, theta: float, number: int, dtype=np.float64, seed: int = 0):
    """(counts, expected shares, ∫ density, share drawn that is not finite) of so many draws from one incidence."""
    rng = np.random.default_rng(seed)
    wi = _incidence(theta, dtype)
    u = rng.random((2, number)).astype(dtype)
    u = np.minimum(u, np.nextafter(dtype(1), dtype(0)))
    w = np.stack([np.asarray(c, float) for c in _drawn(brdf, wi, *(jnp.asarray(c) for c in u))], -1)
    good = np.isfinite(w).all(axis=1)
    w = w[good] / np.linalg.norm(w[good], axis=1, keepdims=True)
    frames = _frames(np.array([float(c) for c in wi]))
    frame = min(frames, key=lambda f: np.median(_polar(f, w[:20000])[0]))
    beta, psi = _polar(frame, w)
    edges = np.quantile(beta, np.linspace(0, 1, RINGS + 1))
    edges[0], edges[-1] = 0.0, np.pi
    edges = np.maximum.accumulate(edges)
    sectors = np.linspace(0, 2 * np.pi, SECTORS + 1)
    counts = np.histogram2d(beta, psi, bins=(edges + 1e-300 * np.arange(edges.size), sectors))[0]
    shares, error = _shares(brdf, wi, frame, edges, sectors, dtype)
    return counts, shares, error, 1.0 - good.mean()


def _shares(brdf, wi, frame, edges, sectors, dtype):
    # The density over each cell: what it draws from has edges and points of its own, where the rules halve them.
    cells, bins = [], []
    for k in range(RINGS):
        for low, cut in itertools.pairwise(_graded(edges[k], edges[k + 1])):
            for m, (p, q) in enumerate(itertools.pairwise(sectors)):
                cells.append([low, p, cut, q])
                bins.append(k * SECTORS + m)

    def integrand(beta, psi):
        s = np.sin(beta)
        local = np.stack([s * np.cos(psi), s * np.sin(psi), np.cos(beta)], -1).reshape(-1, 3)
        wo = Direction(*(jnp.asarray(c, dtype) for c in (local @ frame).T))
        return np.asarray(_density(brdf, wi, wo), float).reshape(beta.shape) * s

    shares, error = integrate(integrand, np.array(cells), np.array(bins), ENOUGH)
    return shares.reshape(RINGS, SECTORS), error


def _graded(low: float, high: float) -> np.ndarray:
    # A ring in the tail spans decades of β: its cells grow by factors.
    if high > 2 * max(low, 1e-9) and high - low > 0.02:
        return np.concatenate([[low], np.geomspace(max(low * 1.3, high / 4096), high, 8)])
    return np.array([low, high])


def p_value(counts: np.ndarray, shares: np.ndarray) -> float:
    """Pearson's χ² test of counts against shares, cells of few expected counts taken together."""
    number = counts.sum()
    expected = shares.ravel() * number
    observed = counts.ravel()
    order = np.argsort(expected)
    expected, observed = expected[order], observed[order]
    few = int(np.searchsorted(np.cumsum(expected), LEAST)) + 1
    few = max(few, int(np.searchsorted(expected, LEAST)))
    expected = np.concatenate([[expected[:few].sum()], expected[few:]])
    observed = np.concatenate([[observed[:few].sum()], observed[few:]])
    if expected[0] < 1:
        expected, observed = expected[1:], observed[1:]
    chi2 = float(np.sum((observed - expected) ** 2 / expected))
    return float(stats.chi2.sf(chi2, max(expected.size - 1, 1)))


def sampler_cells(name: str, expression: str, precision: str, number: int) -> list[Cell]:
    """One cell for each incidence: the p-value of χ² against the level of one test, and ∫ of the density."""
    dtype = PRECISIONS[precision]
    brdf = cast(build(expression), dtype)
    cells = []
    for column, theta in INCIDENCES.items():
        # Other random numbers for each test, always the same: a recipe that repeats it.
        seed = zlib.crc32(f"{expression} {column} {precision}".encode())
        counts, shares, change, lost = count_and_expect(brdf, theta, number, dtype, seed)
        whole, level, most = float(shares.sum()), sidak(), WHOLE[precision]
        p = p_value(counts, shares) if np.isfinite(shares).all() else 0.0
        off = abs(whole - 1)
        detail = f"p = {p:.3g} (level {level:.2g}) of {number:,} directions; the density adds up to {whole:.7g}"
        if lost:
            verdict, detail = SAYS_SO, f"{lost:.2g} of the directions drawn are not finite"
        elif change > most:
            verdict, detail = SAYS_SO, f"{detail}, which is known to {change:.1g} only"
        else:
            verdict = RIGHT if p >= level and off <= most else SILENT
        cells.append(Cell("sampler", name, expression, column, precision, verdict, off, most, detail))
    return cells
