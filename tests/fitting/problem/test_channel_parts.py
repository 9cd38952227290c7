"""Sums of many channels, which programs of a few compute part by part, against those of each channel alone."""

import numpy as np
import pytest

from gonio.fitting.problem.channel_parts import MOST_CHANNELS, channel_parts
from gonio.fitting.problem.parameterisation import of_channel, parameters
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import Readings
from gonio.models.expression.parser import parse, with_defaults
from gonio.models.geometry.directions import Direction, from_spherical
from support.marks import thorough

COUNT, CELLS = 2 * MOST_CHANNELS + 5, 70
RNG = np.random.default_rng(4)
F0 = [round(v, 3) for v in RNG.uniform(0.02, 0.9, COUNT).tolist()]
MODELS = {
    "a shape of each": f"lambert + {F0[::-1]} * ggx(alpha=each, f0={F0})",
    "a shape of all": "lambert + ggx(f0=?)",
}
TERMS = {name: with_defaults(parse(model)) for name, model in MODELS.items()}


def readings(half_angles: tuple[float, float]) -> Readings:
    wi, wo = (Direction(*map(np.asarray, from_spherical(*RNG.uniform(0, [[1.4], [6]], (2, CELLS))))) for _ in range(2))
    f = RNG.uniform(0.01, 1, (CELLS, COUNT))
    return Readings(wi, wo, f, np.full(f.shape, np.nan), RNG.random(f.shape) > 0.1, half_angles=half_angles)


@pytest.mark.parametrize(
    ("name", "half_angles"),
    [
        ("a shape of each", (0.0, 0.04)),
        ("a shape of all", (0.0, 0.0)),
        *thorough(("a shape of each", (0.0, 0.0)), ("a shape of all", (0.0, 0.04))),
    ],
)
def test_sums_of_many_channels_are_those_of_each(name, half_angles):
    part = readings(half_angles)
    weight, rules = RNG.uniform(0, 1, part.f.shape), np.full(CELLS, 4) if half_angles[1] else None
    s, fixed, _ = parameters(TERMS[name], COUNT)
    problem = FitProblem.create(s, fixed, "cbrt", part, weight, 0.01, rules)
    p = RNG.uniform(0.2, 0.6, s.size)
    joint, joint_f = problem.normal_equations(p[None]), problem.model_values(p)
    cost, gradient, matrix = 0.0, np.zeros(s.size), np.zeros((s.size, s.size))
    for c in range(COUNT):
        alone, values, _ = parameters(of_channel(TERMS[name], c), 1)
        f, u_f, valid = (a[:, [c]] for a in (part.f, part.u_f, part.valid))
        one = FitProblem.create(
            alone, values, "cbrt", Readings(part.wi, part.wo, f, u_f, valid, half_angles=half_angles), weight[:, [c]],
            0.01, rules,
        )  # fmt: skip
        total = one.normal_equations(p[None, s.columns[c]])
        places = s.columns[c][alone.order]
        cost += float(total.cost[0])
        gradient[places] += total.gradient[0]
        matrix[np.ix_(places, places)] += total.matrix.whole()[0]
        np.testing.assert_allclose(joint_f[:, c], one.model_values(p[s.columns[c]])[:, 0], rtol=1e-12)
    assert joint.cost[0] == pytest.approx(cost, rel=1e-12)
    np.testing.assert_allclose(joint.gradient[0], gradient[s.order], rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(joint.matrix.whole()[0], matrix[np.ix_(s.order, s.order)], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("count", [1, MOST_CHANNELS, MOST_CHANNELS + 1, 31, 81, 401])
def test_parts_are_of_one_size_and_hold_every_channel(count):
    s, _, _ = parameters(with_defaults(parse("lambert + ggx(f0=?)")), count)
    parts = channel_parts(s)
    assert parts.parameterisation.channels <= MOST_CHANNELS
    np.testing.assert_array_equal(np.unique(parts.channels), np.arange(count))
    for channels, numbers in zip(parts.channels, parts.numbers, strict=True):
        np.testing.assert_array_equal(numbers[parts.parameterisation.columns], s.columns[channels])
