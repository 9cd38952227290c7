"""A subsample of the readings for first descents, which keeps what is rare."""

import numpy as np

from gonio.fitting.problem.readings import Readings

BANDS = (-20, 12)  # exponents of tan²θh from 1e-6 to 4e3
RARE = 2  # bands of fewer cells than this many times those wanted are taken whole


def coarse_cells(readings: Readings, limit: int, seed: int) -> np.ndarray:
    """At most `limit` cells for the first descents, sorted: half of them even over cells, half over the half angle.

    A narrow lobe fills few cells of a uniform grid: by cell alone, a start would miss it. The half angle is
    cut where its tangent doubles.
    """
    n = readings.f.shape[0]
    if n <= limit:
        return np.arange(n)
    rng = np.random.default_rng(seed)
    h = [np.asarray(a) + np.asarray(b) for a, b in zip(readings.wi, readings.wo, strict=True)]
    tan2 = (h[0] * h[0] + h[1] * h[1]) / np.maximum(h[2] * h[2], np.finfo(float).tiny)
    band = np.clip(np.frexp(np.maximum(tan2, np.finfo(float).tiny))[1], *BANDS).astype(np.int8) - np.int8(BANDS[0])
    rare = np.bincount(band, minlength=BANDS[1] - BANDS[0] + 1) < RARE * limit
    # All cells of rare bands and some of the others are enough to choose from.
    sample = rng.choice(n, min(n, 8 * limit), replace=False)
    considered = rare[band]
    considered[sample] = True
    among, even = rng.permutation(np.flatnonzero(considered)), sample[: limit // 2]
    among = among[np.argsort(band[among], kind="stable")]
    counts = np.bincount(band[among])
    rank = np.arange(among.size) - np.repeat(np.cumsum(counts) - counts, counts)
    # First of each band, second of each, ...: bands with few cells give all they have.
    by_band = among[np.argsort(rank, kind="stable")[:limit]]
    by_band = by_band[~np.isin(by_band, even)]
    return np.sort(np.concatenate([even, by_band[: limit - even.size]]))
