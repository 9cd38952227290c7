"""The last steps of a fit whose minimum lies on bounds that its descent has all but reached.

In a narrow valley, what puts a number on its bound moves the others off the valley's bottom by as little: too far for
their gradient, and too little for steps that may still move all of them.
"""

import dataclasses

import numpy as np

from gonio.fitting.problem.parameterisation import Domains, at_bounds
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.solver.levenberg_marquardt import NEAR, Descent, minimise


def with_bounds_fixed(problem: FitProblem, p: np.ndarray) -> Descent | None:
    """The fit from p (P,) with those numbers fixed that lie on a bound; None where there are none, or no others.

    Whether they belong there is left to the gradient at its end.
    """
    d = problem.domains
    fixed = np.logical_or(*at_bounds(d, p))
    if not fixed.any() or fixed.all():
        return None
    domains = Domains(d.kind, np.where(fixed, p, d.low), np.where(fixed, p, d.high))
    return minimise(dataclasses.replace(problem, domains=domains), [p], NEAR)[0]
