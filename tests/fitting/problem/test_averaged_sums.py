"""Averages over discs by loops that are known by name: another process traces no model for them."""

import jax
import numpy as np
import pytest

from gonio.fitting.problem import averaged_sums
from gonio.fitting.problem.disc_averages import CUT, KINDS, OPPOSED
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import Readings
from gonio.models.compiled.machine import machine
from gonio.models.expression.parser import parse, with_defaults
from gonio.models.geometry.directions import Direction, from_spherical

DEGREE = np.pi / 180


def equations(value: float) -> tuple[np.ndarray, ...]:
    """Normal equations of readings of two channels with discs, one cut by the horizon; `value` is no free number."""
    s, fixed, _ = parameters(with_defaults(parse(f"lambert + ggx(f0={value})")), 2)
    theta_i, theta_o = np.array([0.2, 0.5, 1.1]), np.array([0.3, 0.6, 1.565])
    pair = (from_spherical(theta_i, np.zeros(3)), from_spherical(theta_o, np.array([3.0, 2.0, 1.0])))
    wi, wo = (Direction(*map(np.asarray, w)) for w in pair)
    f = np.full((3, 2), 0.1)
    problem = FitProblem.create(
        s, fixed, "linear", Readings(wi, wo, f, f, f > 0, half_angles=(DEGREE, 2 * DEGREE)), np.ones((3, 2)), 1.0
    )
    numbers = {"lambert.rho": 0.1, "ggx.alpha": 0.15}
    p = np.array([numbers.get(name, 1.0) for name, _ in s.labels])
    of_rules = problem.averaged(np.array([KINDS, KINDS + OPPOSED, KINDS + CUT])).normal_equations(p[None])
    return tuple(map(np.asarray, jax.tree.leaves(of_rules)))


@pytest.mark.skipif(machine() is None, reason="this processor has no compiled loops")
def test_another_process_traces_nothing_and_gives_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setenv("GONIO_PROGRAMS_DIR", str(tmp_path))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    monkeypatch.delenv("GONIO_NO_CACHE", raising=False)
    monkeypatch.setattr(averaged_sums, "_kept", {})
    first, other = equations(0.04), equations(0.05)
    traced, original = [], averaged_sums.lobes_at_sample
    monkeypatch.setattr(averaged_sums, "_kept", {})
    monkeypatch.setattr(averaged_sums, "lobes_at_sample", lambda *a: traced.append(1) or original(*a))
    for value, before in ((0.04, first), (0.05, other)):
        for again, known in zip(equations(value), before, strict=True):
            np.testing.assert_array_equal(again, known)
    assert not traced
    assert any((a != b).any() for a, b in zip(first, other, strict=True))
