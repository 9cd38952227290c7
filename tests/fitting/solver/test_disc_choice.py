"""How finely readings are averaged over discs."""

import numpy as np

from gonio.fitting.problem.disc_averages import disc_rules
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import Readings
from gonio.fitting.solver.disc_choice import choose_rules
from gonio.models.expression.parser import parse, with_defaults
from gonio.models.geometry.directions import Direction, from_spherical

DEGREE = np.pi / 180


def test_what_no_rule_averages_does_not_make_the_others_finer():
    """One reading that is known far better than any rule averages it: the rest is averaged as without it."""
    theta_i, theta_o = (g.ravel() for g in np.meshgrid(*[np.radians(np.arange(0, 90, 5.0))] * 2))
    wi, wo = (Direction(*map(np.asarray, from_spherical(t, a))) for t, a in ((theta_i, 0.0), (theta_o, np.pi)))
    one, half_angles = np.ones((theta_i.size, 1)), (2 * DEGREE, 2 * DEGREE)
    part = Readings(wi, wo, one, one, one > 0, half_angles=half_angles)
    s, fixed, _ = parameters(with_defaults(parse("lambert + ggx(f0=0.04)")), 1)
    problem = FitProblem.create(s, fixed, "linear", part, 30.0 * one, 1.0)
    p, grazing = np.array([0.1, 0.05, 1.0]), theta_i.size - 1  # both at 85 degrees, mirrored
    usual = choose_rules(problem, p, 1.0)
    weight = problem.weight.copy()
    weight[grazing] *= 1e9
    sure = choose_rules(problem.reweighted(weight), p, 1.0)
    sizes = disc_rules(half_angles).sizes
    nodes = [np.delete(sizes[c.rules], grazing).sum() for c in (usual, sure)]
    assert usual.neglected < 0.45 < 1 < sure.neglected
    assert theta_i.size < nodes[1] < 1.1 * nodes[0]
