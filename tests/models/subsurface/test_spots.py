"""Finite spots on a translucent material beside the transform of Bessel functions, its limits and random points."""

import numpy as np
import pytest
from scipy import special

from gonio.models.subsurface.better_dipole import BetterDipole
from gonio.models.subsurface.dipole import Dipole
from gonio.models.subsurface.evaluation import evaluated, totals
from gonio.models.subsurface.normalised_diffusion import NormalisedDiffusion
from gonio.models.subsurface.spots import kept_share, spot_rule

MANY = {"albedo": np.array([0.8, 0.95, 0.99]), "mfp": np.ones(3), "eta": np.ones(3)}
"""The structure of the models of `test_profiles`, whose programs serve here too."""
DIPOLE = Dipole(**MANY)


def read(model, offset, a, b, nodes=20):
    rule = spot_rule(np.array([offset]), a, b, nodes)
    return float(np.sum(rule.weight * evaluated(model, "profile", rule.r)[..., 1]))


@pytest.mark.parametrize(("a", "b"), [(2.0, 0.5), (1.0, 1.0)])
def test_the_share_is_the_transform_of_both_discs(a, b):
    k = (np.arange(200_000) + 0.5) * 40.0 / 200_000
    discs = special.j1(k * a) * special.j1(k * b) / k
    mean = 2 * a / b * np.sum(evaluated(DIPOLE, "hankel", k)[:, 1] * discs) * 40.0 / 200_000
    kept = kept_share(DIPOLE, a, b)
    assert kept.value[1] * totals(DIPOLE)[1] == pytest.approx(mean, abs=1e-8)
    assert kept.bound.max() < 1e-12


@pytest.mark.parametrize("kind", [Dipole, BetterDipole, NormalisedDiffusion])
def test_the_share_has_its_limits(kind):
    model = kind(**MANY)
    assert kept_share(model, 2.0, 0.5).value == pytest.approx(kept_share(model, 0.5, 2.0).value, rel=1e-13)
    assert kept_share(model, 1e7, 1.0).value == pytest.approx(1.0, abs=1e-12)
    within = evaluated(model, "cumulative", 2.0) / totals(model)
    assert kept_share(model, 2.0, 0.0).value == pytest.approx(within, rel=1e-12)
    assert kept_share(model, 1.0, 1.0).value == pytest.approx(kept_share(model, 1.0, 1 + 1e-9).value, rel=1e-7)
    radii = np.geomspace(0.01, 1e4, 25)
    shares = np.array([kept_share(model, r, 0.3 * r).value[1] for r in radii])
    assert (np.diff(shares) > -1e-13).all() and 0 < shares[0] < 0.02 and shares[-1] == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("kind", [Dipole, NormalisedDiffusion])
@pytest.mark.parametrize(("a", "b"), [(1.0, 0.5), (0.7, 0.7), (300.0, 3.0), (0.0, 2.0)])
def test_both_rules_agree_where_the_spots_are_concentric(kind, a, b):
    model = kind(**MANY)
    mean = read(model, 0.0, a, b) * np.pi * max(a, b) ** 2 / totals(model)[1]
    assert mean == pytest.approx(kept_share(model, a, b).value[1], rel=1e-8)


def test_offset_spots_beside_random_points():
    rng = np.random.default_rng(0)
    for offset, a, b in ((1.0, 1.0, 0.5), (0.5, 1.0, 0.5), (3.0, 0.2, 0.4), (0.5, 0.7, 0.0)):
        x, y, u, v = np.split(np.zeros((4, 100_000)), 4)
        radius, angle = np.sqrt(rng.random((2, 100_000))), 2 * np.pi * rng.random((2, 100_000))
        x, u = (s * radius[k] * np.cos(angle[k]) for k, s in enumerate((a, b)))
        y, v = (s * radius[k] * np.sin(angle[k]) for k, s in enumerate((a, b)))
        values = evaluated(DIPOLE, "profile", np.hypot(offset + u - x, v - y))[:, 1]
        mean = read(DIPOLE, offset, a, b)
        assert values.mean() == pytest.approx(mean, abs=4 * values.std() / np.sqrt(values.size))
        assert read(DIPOLE, offset, a, b, nodes=10) == pytest.approx(mean, rel=1e-7)
        assert spot_rule(np.array([-offset]), a, b).weight.sum() == pytest.approx(1.0, rel=1e-9)


def test_what_does_not_scatter_has_nothing_to_lose():
    black = Dipole(**MANY | {"albedo": np.zeros(3)})
    assert (kept_share(black, 1.0, 1.0).value == 1).all()


def test_points_read_the_profile_itself():
    assert read(DIPOLE, 2.0, 0.0, 0.0) == pytest.approx(evaluated(DIPOLE, "profile", 2.0)[1])
