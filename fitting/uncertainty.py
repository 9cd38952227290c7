"""What the data say of each free number: covariance, intervals, what they leave open."""

import dataclasses

import numpy as np

from gonio.fitting.domains import LINEAR, LOG, Domains

NORMAL_95 = 1.959963984540054
LOST = 1e-13  # eigenvalue of the scaled normal matrix below which double precision sees a combination as free
WEAK = 1e-5  # below which a combination is named: its uncertainty is 300 times that of its members known apart


@dataclasses.dataclass(frozen=True)
class Covariance:
    """Covariance (P, P) of the free numbers: NaN rows for what is pinned or undetermined.

    `combinations` are (eigenvalue, vector (P,) of relative changes that leave the residuals as they are).
    """

    matrix: np.ndarray
    undetermined: np.ndarray
    combinations: list[tuple[float, np.ndarray]]

    @property
    def standard(self) -> np.ndarray:
        """Standard uncertainties (P,)."""
        return np.sqrt(np.diagonal(self.matrix))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (P, P)."""
        with np.errstate(invalid="ignore"):
            return self.matrix / np.outer(self.standard, self.standard)


def covariance(
    matrix: np.ndarray, scatter: np.ndarray, known_noise: bool, open_numbers: np.ndarray, p: np.ndarray, residuals: int
) -> Covariance:
    """Covariance of the numbers that are `open_numbers` (not pinned to a bound, not silent).

    With noise known, (JᵀJ)⁻¹; else the heteroscedasticity-consistent (JᵀJ)⁻¹ Jᵀdiag(r²)J (JᵀJ)⁻¹ [White 1980] with
    its small-sample factor n/(n − P): the noise of a BRDF is rarely even in a loss.
    """
    size = p.size
    full = np.full((size, size), np.nan)
    undetermined = ~np.asarray(open_numbers, bool) & (np.diagonal(matrix) <= 0)
    at = np.flatnonzero(open_numbers)
    if not at.size:
        return Covariance(full, undetermined, [])
    lengths = np.sqrt(np.diagonal(matrix)[at])
    scaled = matrix[np.ix_(at, at)] / np.outer(lengths, lengths)
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    lost = values < LOST * at.size
    inverse = (vectors[:, ~lost] / values[~lost]) @ vectors[:, ~lost].T
    inverse = inverse / np.outer(lengths, lengths)
    if not known_noise:
        count = int(at.size)
        inverse = inverse @ scatter[np.ix_(at, at)] @ inverse * (residuals / max(residuals - count, 1))
    touched = (np.abs(vectors[:, lost]) > 0.1).any(axis=1) if lost.any() else np.zeros(at.size, bool)
    undetermined[at[touched]] = True
    inverse[touched, :] = inverse[:, touched] = np.nan
    full[np.ix_(at, at)] = inverse
    named = []
    for k in np.flatnonzero(values < WEAK):
        change = np.zeros(size)
        change[at] = vectors[:, k] / lengths / np.where(p[at] != 0, np.abs(p[at]), 1.0)
        named.append((float(max(values[k], 0.0)), change))
    return Covariance(full, undetermined, named)


def covers_domain(d: Domains, k: int, value: float, u: float) -> bool:
    """Whether the 95 % interval of number k is as long as its domain, in the coordinate of the domain's map."""
    low, high = float(d.low[k]), float(d.high[k])
    if d.kind[k] == LINEAR:
        return 2 * NORMAL_95 * u >= high - low
    shift = 0.0 if d.kind[k] == LOG else 1.0
    return 2 * NORMAL_95 * u / (value + shift) >= np.log((high + shift) / (low + shift))


def in_words(eigenvalue: float, change: np.ndarray, names: list[str]) -> str:
    """A combination of free numbers that the data leave (nearly) open, as a sentence."""
    size = np.abs(change) / np.max(np.abs(change))
    order = [k for k in np.argsort(-size, kind="stable") if size[k] > 0.05]
    if len(order) == 1:
        return f"{names[order[0]]} is not determined by these readings"
    lead = change[order[0]]
    others = ", ".join(f"{names[k]} by {change[k] / lead:+.3g} %" for k in order[1:5])
    more = f" and {len(order) - 5} more" if len(order) > 5 else ""
    how = "changes nothing" if eigenvalue < LOST * len(names) else "changes almost nothing"
    start = f"raising {names[order[0]]} by 1 % together with {others}{more}"
    return f"{start} {how} in the residuals: only their combination is determined"
