"""Statistical tests of whether the residuals of a fit are noise: runs, serial correlation and χ²."""

import dataclasses
import math

import numpy as np

MIN_RESIDUALS = 20  # of a channel, below which their order is not tested
SIGNIFICANT = 1e-3
NEGLIGIBLE = 0.02  # correlation of neighbours up to which structure does not matter
CLIP = 3.0  # scales at which residuals are clipped before neighbours are compared, so that outliers do not count


@dataclasses.dataclass(frozen=True)
class NoiseTests:
    """Tests of residuals in an order in which neighbours follow each other, of the least noise-like channel.

    `runs_z`: number of runs of one sign less its expectation, in standard deviations [Wald & Wolfowitz 1940];
    `runs_p`: probability of so few by chance, for all channels; `shared`: correlation of neighbours [von Neumann 1941],
    the share of the residuals' variance that is structure, with `shared_p` its probability; `chi2_p`: probability of a
    χ² as large, where the noise is known; `channel_effect`: how many times the variance of a mean over the channels
    exceeds that of independent ones, 1 where they do not err together.
    """

    verdict: str  # noise, structure, exact, unknown (too few), or untested (no more readings than free numbers)
    runs_z: float
    runs_p: float
    shared: float
    shared_p: float
    reduced_chi2: float
    chi2_p: float
    channel_effect: float = 1.0


def channel_effect(scaled: np.ndarray, valid: np.ndarray) -> float:
    """How many times more a direction's sum over the channels varies than independent channels would; at least 1.

    The flicker of a lamp is one for all wavelengths. It counts where residuals (n, C) of independent signs would
    hardly agree as much.
    """
    t = np.where(valid, np.clip(scaled, -CLIP, CLIP), 0.0)
    squares = t * t
    each, together = squares.sum(axis=1), t.sum(axis=1) ** 2
    # Of products of two channels whose signs are independent, the mean is 0 and this the variance.
    variance = 2.0 * float(np.sum(each**2 - np.sum(squares**2, axis=1)))
    if np.count_nonzero(each) < MIN_RESIDUALS or variance <= 0.0:
        return 1.0
    z = float(np.sum(together - each)) / math.sqrt(variance)
    return max(1.0, float(together.sum() / each.sum())) if _below(-z) < SIGNIFICANT else 1.0


def runs_z(signs: np.ndarray) -> float:
    """Standardised number of runs of a sequence of booleans [Wald & Wolfowitz 1940]; NaN where all are alike."""
    n, up = signs.size, int(np.count_nonzero(signs))
    if not 0 < up < n or n < 3:
        return math.nan
    mean = 2.0 * up * (n - up) / n + 1.0
    variance = (mean - 1.0) * (mean - 2.0) / (n - 1.0)
    if variance <= 0:
        return math.nan
    return float((1 + np.count_nonzero(signs[1:] != signs[:-1]) - mean) / math.sqrt(variance))


def least_noise_like(tests: list[NoiseTests]) -> NoiseTests:
    """The tests of the order that noise explains least, with Bonferroni's correction for the number of orders."""
    least = min(tests, key=lambda t: (t.verdict != "structure", min(t.runs_p, t.shared_p)))
    p, shared_p = (min(1.0, len(tests) * v) for v in (least.runs_p, least.shared_p))
    return dataclasses.replace(least, runs_p=p, shared_p=shared_p)


def noise_tests(
    scaled: np.ndarray,
    valid: np.ndarray,
    chi2: float | None,
    freedom: int,
    exact: bool,
    effect: float | None = None,
) -> NoiseTests:
    """Tests of residuals in the order given.

    Args:
        scaled: residuals over their scale, (n, C).
        valid: which of them count, (n, C).
        chi2: Σr² where the noise is known, else None.
        freedom: degrees of freedom of the fit.
        exact: the residuals are rounding, and are not tested.
        effect: their `channel_effect`, which is the same in every order; computed where it is not given.
    """
    reduced = math.nan if chi2 is None else chi2 / max(freedom, 1)
    if exact or effect is None:
        effect = 1.0 if exact else channel_effect(scaled, valid)
    # Channels of correlation r are fewer independent squares, by 1 + (C - 1) r² where their sum varies 1 + (C - 1) r.
    fewer = 1.0 + (effect - 1.0) ** 2 / max(scaled.shape[1] - 1, 1)
    chi2_p = math.nan if chi2 is None or freedom < 1 else _exceeded(freedom / fewer, chi2 / fewer)
    if freedom < 1:
        # The residuals are rounding whatever the model and the noise are
        return NoiseTests("untested", math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)
    if exact:
        return NoiseTests("exact", math.nan, math.nan, 0.0, math.nan, reduced, chi2_p)
    z, shared, shared_z, channels = math.inf, 0.0, -math.inf, 0
    for c in range(scaled.shape[1]):
        t = np.clip(scaled[valid[:, c], c], -CLIP, CLIP)
        t = t[t != 0]
        if t.size < MIN_RESIDUALS:
            continue
        channels += 1
        z_of_signs = runs_z(t > 0)
        # Residuals of one sign are structure too: no run ends where one is expected.
        z = min(z, -math.sqrt(t.size) if math.isnan(z_of_signs) else z_of_signs)
        # Not about their mean: residuals that lean to one side agree with their neighbours as well.
        correlation = float(np.mean(t[1:] * t[:-1]) / np.mean(t * t))
        shared, shared_z = max(shared, correlation), max(shared_z, correlation * math.sqrt(t.size))
    if not channels:
        return NoiseTests("unknown", math.nan, math.nan, math.nan, math.nan, reduced, chi2_p, effect)
    p, shared_p = (min(1.0, channels * _below(v)) for v in (z, -shared_z))
    structure = min(p, shared_p) < SIGNIFICANT and shared > NEGLIGIBLE
    return NoiseTests("structure" if structure else "noise", z, p, shared, shared_p, reduced, chi2_p, effect)


def _below(z: float) -> float:
    """Probability of a standard normal number below this one."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def _exceeded(freedom: float, chi2: float) -> float:
    """Probability of a χ² above this one."""
    from gonio.models.special.scipy_functions import chdtrc

    return float(chdtrc(freedom, chi2))
