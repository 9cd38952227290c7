"""The last steps of a fit whose minimum lies on bounds that its descent has all but reached.

In a narrow valley, what puts a number on its bound moves the others off the valley's bottom by as little: too far for
their gradient, and too little for steps that may still move all of them.
"""

import dataclasses

import numpy as np

from gonio.fitting.problem.parameterisation import Domains
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.solver.levenberg_marquardt import NEAR, Descent, minimise
from gonio.fitting.solver.lm_step import stationarity


def with_bounds_held(problem: FitProblem, p: np.ndarray) -> Descent | None:
    """The fit from p (P,) with those numbers held that its cost pushes against a bound; None where there are none."""
    d, order = problem.domains, problem.order
    of_arrow = Domains(*(a[order] for a in d))
    held = np.zeros(p.size, bool)
    held[order] = stationarity(of_arrow, p[None, order], problem.normal_equations(p[None])).active_bound[0]
    if not held.any() or held.all():
        return None
    domains = Domains(d.kind, np.where(held, p, d.low), np.where(held, p, d.high))
    return minimise(dataclasses.replace(problem, domains=domains), [p], NEAR)[0]
