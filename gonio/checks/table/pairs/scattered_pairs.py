"""Pairs of readings where no grid has them: near partners, or interpolation with its error."""

from typing import NamedTuple

import numpy as np

from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.pair_points import EXACT, LEAF, isotropic_light, one_sided, pair_points
from gonio.checks.table.pairs.pairs import Pairs
from gonio.checks.table.pairs.places import angles_of
from gonio.data.polarisation import is_polarised
from gonio.data.table import Table
from gonio.models.display import percent

NEAR = np.radians(2.0)
"""A reading this close to the wanted pair of directions may stand for it; the error is estimated."""

SAME_LIGHT = np.radians(0.05)
"""Polar angles nearer than that are one."""

ROUNDING = 1e-6
"""Relative scatter of repeats that are copies of one another."""

NEIGHBOURS = 8
FEWEST_NEAR = 4
"""Readings about a direction of which none is exact, from which its value and the error of that are taken."""

BETWEEN = 3.0
"""Error of a value between near readings, in their spread: a lobe may be narrower than their distances."""

STEEPEST = 0.2
"""Relative error of a value between near readings above which it stands for nothing."""

FEWEST_REPEATS = 12
"""Repeated readings, less their means, from which the noise is taken where none is stored."""

LAW_STEPS, DARK = 100, 0.2
"""Of a fit of the noise's law, and the share of readings whose scatter is that of dark ones where it begins."""

TILT = 1e-3
"""Polar angle, radians, that stands for the normal where its azimuth matters; far more than `EXACT`."""


class Readings(NamedTuple):
    """Readings at different pairs of directions, repeats merged: angles (n, 4), f and u (n, channels)."""

    angles: np.ndarray
    f: np.ndarray
    u: np.ndarray
    repeated: int
    """Readings that were merged into others."""
    law: tuple[float, float] | None = None
    """(r, a) of the standard deviation √((r f)² + a²) of repeats, a in 1/sr; None of copies and where they are few."""

    def noise(self, size: np.ndarray) -> np.ndarray:
        """Standard deviation, 1/sr, of single readings of about these sizes, where repeats show it."""
        assert self.law is not None
        return np.hypot(self.law[0] * size, self.law[1])

    def in_words(self) -> str:
        """By how much repeats scatter; nothing where that is not known."""
        if self.law is None:
            return ""
        share, level = self.law
        usual = float(np.max(np.abs(self.f)))
        parts = [percent(share)] * (share * usual > level / 100) + [f"{level:.2g} 1/sr"] * (level > share * usual / 1e4)
        return f" (they scatter by {' and '.join(parts)})"


def merged(
    angles: np.ndarray, f: np.ndarray, u: np.ndarray, points: np.ndarray, *, of_brightest: bool = False
) -> Readings:
    """The means of readings whose points, (n, k), agree to `EXACT`; their scatter is the noise where none is stored.

    `of_brightest`: the noise of all channels is a share of the brightest one, as of elements that may be 0.
    """
    _, first, group, count = np.unique(
        np.round(points / EXACT), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    group = group.ravel()
    if count.max(initial=1) == 1:
        return Readings(angles, f, u, 0)

    def total(v: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(group, c, count.size) for c in v.T], -1)

    n = count[:, None]
    mean, uncertainty = total(f) / n, np.sqrt(total(u**2)) / n
    freedom = int(np.sum(count - 1))
    size = np.max(np.abs(mean), axis=1, keepdims=True) if of_brightest else np.abs(mean)
    size = np.broadcast_to(size, mean.shape)
    squares, readings = total((f - mean[group]) ** 2), Readings(angles[first], mean, uncertainty, freedom)
    if freedom < FEWEST_REPEATS or np.sum(squares) <= ROUNDING**2 * freedom * np.mean(size[count > 1] ** 2):
        return readings
    readings = readings._replace(law=_noise_law(squares, size, n - 1))
    if not np.isfinite(uncertainty).any():
        readings = readings._replace(u=readings.noise(size) / np.sqrt(n))
    return readings


def _noise_law(squares: np.ndarray, size: np.ndarray, freedom: np.ndarray) -> tuple[float, float]:
    """(r, a) of the variance (r size)² + a² of readings, by sums of squared deviations from their means (m, channels).

    Of the greatest likelihood, by multiplicative steps that keep both parts positive [Févotte, Bertin & Durrieu 2009,
    of the Itakura–Saito divergence, which is that of normal deviations], from what bright and dark readings scatter by
    themselves. A mean of about 0 tells of the absolute part: a share of it would be no scale of its noise.
    """
    use = np.broadcast_to(freedom > 0, size.shape)
    weight, y, terms = (np.broadcast_to(a, size.shape)[use] for a in (freedom, squares / np.maximum(freedom, 1), size))
    terms = np.stack([terms**2, np.ones(terms.size)])
    bright, dark = terms[0] >= np.median(terms[0]), terms[0] <= np.quantile(terms[0], DARK)
    least = 1e-300
    share = np.sum((weight * y)[bright] / np.maximum(terms[0][bright], least)) / np.sum(weight[bright])
    parts = np.maximum([share, np.sum((weight * y)[dark]) / np.sum(weight[dark])], least)
    for _ in range(LAW_STEPS):
        expected = np.maximum(parts @ terms, least)
        rise, fall = terms @ (weight * (y / expected) / expected), terms @ (weight / expected)
        parts *= np.sqrt(rise / np.maximum(fall, least))
    share, level = np.sqrt(parts).tolist()
    return share, level


def with_azimuths(table: Table) -> np.ndarray:
    """The angles of a list, (n, 4), the normal tilted by next to nothing: s and p there are of the written azimuth."""
    angles = np.stack(table.layout.angles(), axis=-1)
    angles[:, [0, 2]] = np.clip(angles[:, [0, 2]], TILT, np.pi - TILT)
    return angles


def scattered_pairs(table: Table) -> Pairs:
    """Readings with those of the exchanged directions: exact ones, or interpolated between near ones, with the error.

    Readings of one direction are merged first. What stands for the exchanged direction is nearer to it than half of
    its distance from the reading's own: nothing is compared with itself or with its neighbours.
    """
    from scipy.spatial import KDTree

    isotropic, cells = isotropic_light(table), np.arange(table.layout.size)
    angles = angles_of(table.layout, cells)
    f, u = readings_of(table, cells)
    use = table.layout.readable() & np.isfinite(f).all(axis=1)
    mirrored = isotropic and one_sided(angles[use])
    polarised = is_polarised(table.channels.names)
    tilted = with_azimuths(table)[use] if polarised else angles[use]
    readings = merged(tilted, f[use], u[use], pair_points(tilted, isotropic, False), of_brightest=polarised)
    angles, f, u, repeated, _ = readings
    how = "readings whose exchanged directions were read" + (", taking the surface as isotropic" if isotropic else "")
    how += " and mirror symmetric, as azimuth differences are on one side" if mirrored else ""
    if repeated:
        how += f", {repeated:,} repeats merged{readings.in_words()}"
    if len(f) < 2:
        return Pairs.of_arrays((f[:0], f[:0], u[:0], u[:0]), angles[:0], len(f), how, merged=angles)
    here = pair_points(angles, isotropic, mirrored)
    there = pair_points(angles[:, [2, 3, 0, 1]], isotropic, mirrored)
    distance, near = (np.asarray(a) for a in KDTree(here, LEAF).query(there, min(NEIGHBOURS, len(f))))
    number = np.arange(len(near))
    # On an isotropic surface a reading of θo = θi is exchanged by mirroring it: it says nothing of reciprocity.
    apart = np.sqrt(2) * np.abs(angles[:, 0] - angles[:, 2]) if isotropic else np.linalg.norm(here - there, axis=1)
    apart = np.where(apart > SAME_LIGHT, apart, 0.0)[:, None]
    exact = distance[:, :1] <= EXACT
    usable = np.where(exact, distance <= EXACT, distance <= NEAR) & (distance < apart / 2)
    # Near ones have to lie on all sides: beyond the last of them, and of the last incidence, nothing is known.
    offset = np.where(usable[..., None], here[near] - there[:, None], 0.0)
    around = (offset.min(axis=1) <= EXACT) & (offset.max(axis=1) >= -EXACT) & (np.ptp(offset, axis=1) > 0)
    usable &= exact | around.all(axis=1)[:, None]
    # Two that are each other's exact partners are one pair.
    twice = exact[:, 0] & (near[near[:, 0], 0] == number) & (near[:, 0] < number)
    keep = (usable.sum(axis=1) >= np.where(exact[:, 0], 1, FEWEST_NEAR)) & ~twice
    weight = np.where(usable, 1 / np.maximum(distance, EXACT) ** 2, 0.0)[keep]
    weight = (weight / weight.sum(axis=1, keepdims=True))[..., None]
    a, partners = f[keep], f[near[keep]]
    b, u_b = np.sum(weight * partners, axis=1), np.sqrt(np.sum((weight * u[near[keep]]) ** 2, axis=1))
    between = np.where(usable[keep][..., None], partners, np.nan)
    spread = np.nanmax(between, axis=1) - np.nanmin(between, axis=1) if len(a) else a
    error = np.where(exact[keep], 0.0, 2 * BETWEEN * spread / np.maximum(np.abs(a) + np.abs(b), 1e-300))
    # Where f is steep the spread of a few readings bounds nothing.
    a = np.where(error <= STEEPEST, a, np.nan)
    return Pairs.of_arrays((a, b, u[keep], u_b), angles[keep], len(f), how, error, merged=angles)
