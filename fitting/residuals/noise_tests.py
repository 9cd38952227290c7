"""Whether what a fit leaves over is noise or structure."""

import dataclasses
import math
from statistics import NormalDist

import numpy as np

FEWEST = 20  # residuals of a channel, below which nothing can be said of their order
SIGNIFICANT = 1e-3
SHARED = 0.02  # share of variance in common with neighbours, below which structure is no matter
LIMIT = 3.0  # scales at which residuals are cut off before neighbours are compared: outliers are no structure


@dataclasses.dataclass(frozen=True)
class Noisiness:
    """Tests of residuals in an order in which neighbours follow each other; the least noise-like channel counts.

    `runs_z`: number of runs of one sign less what chance gives, in standard deviations [Wald & Wolfowitz 1940];
    `runs_p`: probability of so few by chance, for all channels; `shared`: correlation of neighbours [von Neumann 1941],
    which is the share of the residuals' variance that is structure, with `shared_p` its probability; `chi2_p`:
    probability of a χ² as large, where the noise is known.
    """

    verdict: str  # noise, structure, exact, or unknown (too few)
    runs_z: float
    runs_p: float
    shared: float
    shared_p: float
    reduced_chi2: float
    chi2_p: float


def runs(signs: np.ndarray) -> float:
    """Wald and Wolfowitz's z of a sequence of booleans; NaN where all are alike."""
    n, up = signs.size, int(np.count_nonzero(signs))
    if not 0 < up < n or n < 3:
        return math.nan
    mean = 2.0 * up * (n - up) / n + 1.0
    variance = (mean - 1.0) * (mean - 2.0) / (n - 1.0)
    if variance <= 0:
        return math.nan
    return float((1 + np.count_nonzero(signs[1:] != signs[:-1]) - mean) / math.sqrt(variance))


def chi2_upper(chi2: float, freedom: int) -> float:
    """Probability of χ² above this value by Wilson and Hilferty's normal law [1931]: right to 1e-3 from 10 on."""
    if freedom < 1:
        return math.nan
    v = 2.0 / (9.0 * freedom)
    return NormalDist().cdf(-((chi2 / freedom) ** (1 / 3) - 1.0 + v) / math.sqrt(v))


def least_like_noise(found: list[Noisiness]) -> Noisiness:
    """Of tests in several orders the one that noise explains least; probabilities count that it was picked."""
    picked = min(found, key=lambda t: (t.verdict != "structure", min(t.runs_p, t.shared_p)))
    p, shared_p = (min(1.0, len(found) * v) for v in (picked.runs_p, picked.shared_p))
    return dataclasses.replace(picked, runs_p=p, shared_p=shared_p)


def judge(scaled: np.ndarray, valid: np.ndarray, chi2: float | None, freedom: int, exact: bool) -> Noisiness:
    """The tests on residuals (n, C) in scales, in their order; `chi2`: Σr² where noise is known, else None."""
    reduced = math.nan if chi2 is None else chi2 / max(freedom, 1)
    chi2_p = math.nan if chi2 is None else chi2_upper(chi2, freedom)
    if exact:
        return Noisiness("exact", math.nan, math.nan, 0.0, math.nan, reduced, chi2_p)
    z, shared, shared_z, channels = math.inf, 0.0, -math.inf, 0
    for c in range(scaled.shape[1]):
        t = np.clip(scaled[valid[:, c], c], -LIMIT, LIMIT)
        t = t[t != 0]
        if t.size < FEWEST:
            continue
        channels += 1
        of_signs = runs(t > 0)
        # All of one sign is structure too: no run ends where one is expected.
        z = min(z, -math.sqrt(t.size) if math.isnan(of_signs) else of_signs)
        # Not about their mean: residuals that lean to one side agree with their neighbours as well.
        in_common = float(np.mean(t[1:] * t[:-1]) / np.mean(t * t))
        shared, shared_z = max(shared, in_common), max(shared_z, in_common * math.sqrt(t.size))
    if not channels:
        return Noisiness("unknown", math.nan, math.nan, math.nan, math.nan, reduced, chi2_p)
    p, shared_p = (min(1.0, channels * NormalDist().cdf(v)) for v in (z, -shared_z))
    structure = min(p, shared_p) < SIGNIFICANT and shared > SHARED
    return Noisiness("structure" if structure else "noise", z, p, shared, shared_p, reduced, chi2_p)
