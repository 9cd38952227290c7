"""How sure both numbers of a profile's fit are: by the covariance, or by following the cost where it is no parabola."""

import dataclasses

import numpy as np

from gonio.fitting.problem.parameterisation import LOG, LOG1P, Domains
from gonio.fitting.subsurface.problem import LeastSquares, ProfileOptimum
from gonio.fitting.subsurface.profile_intervals import Interval, profile_intervals
from gonio.fitting.uncertainty.covariance import NORMAL_95, CovarianceEstimate
from gonio.fitting.uncertainty.identifiability import describe_combination
from gonio.fitting.uncertainty.profile_likelihood import is_open
from gonio.models.special.scipy_functions import chdtrc, stdtrit
from gonio.models.subsurface.base import MOST

LEVEL = 0.01
"""Chance of calling residuals more than noise that are noise."""
NATURAL = Domains(np.array([LOG1P, LOG]), np.array([0.0, 1 / MOST]), np.array([MOST, MOST]))
"""Of σa over σs', and of σs'."""
PARABOLA = 0.02
"""Relative uncertainty of both numbers up to which the cost is one."""


@dataclasses.dataclass(frozen=True)
class Spread:
    """Standard uncertainties of x (2,), of σa itself where it is 0, and the factor of the 95 % interval."""

    u: np.ndarray
    factor: float
    undetermined: np.ndarray
    sentences: list[str]
    covariance: np.ndarray
    """(2, 2) of σa and σs', NaN of what is not known or on its bound."""
    scale: float
    """Variance of the residuals."""
    ends: list[Interval] | None = None
    """Of √σa and ln σs', by the profile likelihood where the cost is no parabola."""


def spread_of(o: ProfileOptimum, free: np.ndarray, dof: int, known: bool, suffix: str) -> Spread:
    """How sure x is; by the stored noise, or by the residuals where nothing is stored or they are more than noise."""
    scale, factor = 1.0, NORMAL_95
    if not known or (dof and chdtrc(dof, o.cost) < LEVEL):
        scale = max(o.cost, o.rounding**2) / dof if dof else np.nan
        factor = float(stdtrit(dof, 0.975)) if dof else np.nan
    matrix = o.jacobian.T @ o.jacobian
    # In σa over σs' and in σs' itself: what the rest of gonio calls open of such numbers is open here
    p = np.array([o.root**2 / o.reduced, o.reduced])
    slopes = np.array([(1.0 if o.at_bound else 2 * o.root) / o.reduced, o.reduced])
    movable = free & np.array([not o.at_bound, True])
    natural = CovarianceEstimate(matrix / np.outer(slopes, slopes) / max(scale, 1e-300), None, dof + 2, NATURAL, p)
    covariance = natural.covariance(movable)
    u = np.where(covariance.undetermined & np.isnan(covariance.standard), np.inf, covariance.standard / slopes)
    if o.at_bound:
        u[0] = np.sqrt(scale * np.linalg.pinv(matrix, hermitian=True)[0, 0])
    names = [f"sigma_a{suffix}", f"sigma_s{suffix}"]
    sentences = [
        describe_combination(variance, change, p, names, np.zeros(2, bool))
        for variance, change in covariance.combinations
    ]
    # The root's own spread is in the uncertainty of σa, and has to be in its covariance
    widened = 1.0 if o.at_bound else np.hypot(1.0, u[0] / max(np.sqrt(2.0) * o.root, 1e-300))
    sizes = np.array([o.reduced * widened, 1.0])
    by_number = covariance.matrix * np.outer(sizes, sizes)
    return Spread(u, factor, covariance.undetermined & movable, sentences, by_number, scale)


def followed(problem: LeastSquares, o: ProfileOptimum, spread: Spread, suffix: str) -> Spread:
    """The spread by the profile likelihood where a bound, a bend or another optimum makes the cost no parabola."""
    others = [x for x in o.others if problem.cost(x) <= o.cost + spread.scale * spread.factor**2]
    apart = np.array([[abs(abs(x[0]) - o.root), abs(x[1] - o.x[1])] for x in others]).reshape(-1, 2)
    alone = not (apart > np.array([PARABOLA * o.root, PARABOLA])).any()
    precise = spread.u[0] <= PARABOLA * o.root and spread.u[1] <= PARABOLA
    if alone and precise and not o.at_bound:
        return spread
    u = np.where(problem.free, spread.u, 0.0)
    if o.at_bound:
        u[0] = np.sqrt(u[0])
    ends = profile_intervals(problem, o, spread.scale * spread.factor**2, spread.factor * u)
    widths = np.array([(end.high - end.low) / (2 * spread.factor) for end in ends])
    open_numbers, sentences = spread.undetermined.copy(), list(spread.sentences)
    intervals = [(end.low**2, end.high**2) for end in ends[:1]] + [
        (np.exp(end.low), np.exp(end.high)) for end in ends[1:]
    ]
    p = np.array([o.root**2 / o.reduced, 1.0])
    for k, (low, high) in enumerate(intervals):
        relative = (float(low / o.reduced), float(high / o.reduced))
        if problem.free[k] and not open_numbers[k] and is_open(NATURAL, k, relative, float(p[k])):
            open_numbers[k] = True
            sentences.append(
                f"{('sigma_a', 'sigma_s')[k]}{suffix} is not determined: from {low:.3g} to {high:.3g} 1/mm follows "
                "the profile, as the other number goes along"
            )
    grown = np.maximum(1.0, widths / np.where(u > 0, u, np.inf))
    return dataclasses.replace(
        spread,
        u=np.maximum(spread.u, np.array([ends[0].high ** 2 / spread.factor if o.at_bound else widths[0], widths[1]])),
        undetermined=open_numbers,
        sentences=sentences,
        covariance=spread.covariance * np.outer(grown, grown),
        ends=ends,
    )
