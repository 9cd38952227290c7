"""Optimal design: shares of the time for candidate directions, with the certificate that no others do better.

A candidate k gives, in a unit of time, the information M_k = Σ_c r_kc r_kcᵀ about P numbers (its rows r, one a
channel); a systematic error that all readings share shifts it by s_kc standard uncertainties. A weighted fit then has
the covariance C = M⁻¹ + M⁻¹ B Bᵀ M⁻¹ of M = Σ w_k M_k and B = Σ w_k r_k s_kᵀ. The design maximises the mean, over draws
of a prior and by what each counts for, of −log det C, or of −log tr(L C Lᵀ) for combinations L, over shares w ≥ 0 that
sum to 1. Without systematic errors both are concave, so that the gradient d certifies: no design is better by more than
max_k d_k − Σ w_k d_k [Kiefer & Wolfowitz 1960; Fedorov 1972]. With them the same number says that no small exchange is
better.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from gonio.models.errors import GonioError

GAP = 1e-3
"""Kiefer-Wolfowitz residual that is aimed for, over Σ w d: the number of parameters, or 1."""
FIRST, MOST_ROUNDS, ADDED, FEW = 40, 40, 8, 1e-6
SINGULAR = 1e-13
"""Eigenvalue of an information matrix of unit diagonal below which a combination of numbers has no information."""
Rows = Float[np.ndarray, "s k c p+q"]
"""Of each draw, candidate and channel: the row r of P numbers, then the shifts s by Q systematic errors."""
Gram = Float[np.ndarray, "s p+q p+q"]
"""Sums of products of rows."""


class Design(NamedTuple):
    """Shares of the time (k,), the Kiefer-Wolfowitz residual, and what it is relative to: Σ w d."""

    shares: np.ndarray
    residual: float
    scale: float


class Criterion(NamedTuple):
    """Value, and its slope by each share (k,)."""

    value: float
    slopes: np.ndarray


class Problem(NamedTuple):
    """What a design is to be optimal for.

    `rows` in a unit of time; `fixed`: Gram matrix of what is read in any case; `size`: P; `wanted` (draws,
    combinations, P): whose variances are to be small together, or None for all numbers, by log det; `of_draws`: what
    each draw counts for (draws,), or None for all alike.
    """

    rows: Rows
    fixed: Gram
    size: int
    wanted: Float[np.ndarray, "s l p"] | None = None
    of_draws: Float[np.ndarray, " s"] | None = None

    def part(self, which: np.ndarray) -> "Problem":
        """The same with some of the candidates."""
        return self._replace(rows=self.rows[:, which])


def gram(rows: Rows, shares: np.ndarray) -> Gram:
    """Σ_k w_k (r, s)_k (r, s)_kᵀ of each draw."""
    weighted = rows * np.sqrt(shares)[:, None, None]
    flat = weighted.reshape(rows.shape[0], -1, rows.shape[-1])
    return np.swapaxes(flat, 1, 2) @ flat


def require_determined(matrix: Float[np.ndarray, "p p"], names: list[str]) -> None:
    """Raises GonioError where an information matrix is singular, naming the numbers that it leaves open."""
    lengths = np.sqrt(np.diagonal(matrix))
    if (lengths == 0).any():
        open_names = [n for n, length in zip(names, lengths, strict=True) if length == 0]
    else:
        values, vectors = np.linalg.eigh(matrix / np.outer(lengths, lengths))
        null = vectors[:, values <= SINGULAR * len(names)]
        if not null.size:
            return
        open_names = [n for n, v in zip(names, np.abs(null).max(axis=1), strict=True) if v > 0.1]
    together = f"{', '.join(open_names)} together" if len(open_names) > 1 else f"{open_names[0]} at all"
    raise GonioError(
        f"these directions do not determine {together}; add directions, or fix a number with -m, as in "
        "-m 'lambert + ggx(f0=0.04)'"
    )


def covariance(whole: Gram, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(C, M⁻¹, M⁻¹ B) of each draw. Raises LinAlgError where M is singular."""
    m = whole[:, :size, :size]
    lengths = np.sqrt(np.diagonal(m, axis1=1, axis2=2))
    if not (lengths > 0).all():
        raise np.linalg.LinAlgError("singular")
    lower = np.linalg.cholesky(m / (lengths[:, :, None] * lengths[:, None, :]))
    if np.diagonal(lower, axis1=1, axis2=2).min() ** 2 < SINGULAR:
        raise np.linalg.LinAlgError("singular")
    half = np.linalg.inv(lower) / lengths[:, None, :]
    inverse = np.swapaxes(half, 1, 2) @ half
    moved = inverse @ whole[:, :size, size:]
    return inverse + moved @ np.swapaxes(moved, 1, 2), inverse, moved


def criterion(problem: Problem, shares: np.ndarray) -> Criterion:
    """The criterion of a design, −∞ where it is singular, and its gradient."""
    rows, size, wanted = problem.rows, problem.size, problem.wanted
    try:
        c, inverse, moved = covariance(problem.fixed + gram(rows, shares), size)
    except np.linalg.LinAlgError:
        return Criterion(-np.inf, np.zeros(shares.size))
    if wanted is None:
        value, slope = -np.average(np.linalg.slogdet(c)[1], weights=problem.of_draws), np.linalg.inv(c)
    else:
        traces = np.einsum("slp,spq,slq->s", wanted, c, wanted)
        value = -np.average(np.log(traces), weights=problem.of_draws)
        slope = np.swapaxes(wanted, 1, 2) @ wanted / traces[:, None, None]
    flat = rows.reshape(rows.shape[0], -1, rows.shape[-1])
    r, s = flat[..., :size], flat[..., size:]
    towards = slope @ inverse
    each = np.sum((r @ (inverse @ towards)) * r, axis=-1)
    if s.shape[-1]:
        each += 2 * np.sum((r @ moved - s) * (r @ np.swapaxes(np.swapaxes(moved, 1, 2) @ towards, 1, 2)), axis=-1)
    return Criterion(float(value), np.average(each.reshape(rows.shape[:3]).sum(-1), axis=0, weights=problem.of_draws))


def optimal_design(problem: Problem) -> Design:
    """The optimal shares of the time, by exchange: the best on a few candidates, to which the best others are added.

    Its residual is at most `GAP` times its scale, or says that it is not.
    """
    problem = scaled(problem)
    rows, size, number = problem.rows, problem.size, problem.rows.shape[1]
    power = 1.0 if problem.wanted is None else 0.5
    shares = np.full(number, 1 / number)
    for _ in range(FIRST):  # the multiplicative algorithm [Silvey, Titterington & Torsney 1978]
        slopes = np.maximum(criterion(problem, shares).slopes, 0.0)
        if not shares @ slopes > 0:
            break
        shares = shares * (slopes / (shares @ slopes)) ** power
        shares /= shares.sum()
    active, gap, level = np.argsort(-shares)[: 3 * size + ADDED], np.inf, 1.0
    for _ in range(MOST_ROUNDS):
        active = np.unique(active)
        start = np.maximum(shares[active], 1e-3 / active.size)
        few = best_shares(problem.part(active), start / start.sum())
        shares = np.zeros(rows.shape[1])
        shares[active] = few
        slopes = criterion(problem, shares).slopes
        level = float(shares @ slopes)
        gap = float(slopes.max()) - level
        if gap <= GAP * level:
            break
        active = np.concatenate([active[few > 1e-5], np.argsort(-slopes)[:ADDED]])
    return Design(shares, gap, level)


def best_shares(problem: Problem, start: np.ndarray) -> np.ndarray:
    """The optimal shares of few candidates, by sequential quadratic programming."""

    def cost(shares: np.ndarray) -> tuple[float, np.ndarray]:
        value, slopes = criterion(problem, np.maximum(shares, 0.0))
        return (1e6, slopes) if not np.isfinite(value) else (-value, -slopes)

    whole = {"type": "eq", "fun": lambda w: w.sum() - 1.0, "jac": np.ones_like}
    options = {"maxiter": 100, "ftol": 1e-8}
    bounds = [(0.0, 1.0)] * start.size
    result = minimize(cost, start, jac=True, method="SLSQP", bounds=bounds, constraints=[whole], options=options)
    shares = np.maximum(result.x, 0.0)
    return shares / shares.sum() if cost(shares / shares.sum())[0] <= cost(start)[0] else start


def scaled(problem: Problem) -> Problem:
    """The same in units of the numbers in which their information is alike; never quite singular."""
    rows, size, wanted = problem.rows, problem.size, problem.wanted
    scale = np.sqrt(np.mean(np.sum(rows**2, axis=2), axis=(0, 1)))
    scale = np.where((scale > 0) & (np.arange(scale.size) < size), scale, 1.0)
    rows, fixed = rows / scale, problem.fixed / np.outer(scale, scale)
    if wanted is not None:  # the optimum for few combinations may be singular in the others: stay a little inside
        wanted = wanted / scale[:size]
        fixed = fixed + FEW * gram(rows, np.full(rows.shape[1], 1 / rows.shape[1]))
    return problem._replace(rows=rows, fixed=fixed, wanted=wanted)
