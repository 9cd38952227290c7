import numpy as np
import pytest

from gonio.checks.direction_search import mirrored, pair, pair_angles, swapped, values
from gonio.checks.model.reciprocity import model_reciprocity, relative_difference, worst_difference
from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import build
from support import liars


@pytest.mark.parametrize("model", [liars.PhongOverCosine(20.0), liars.CoatedDiffuse(0.04)], ids=["phong/cos", "1-F"])
def test_a_model_that_is_not_reciprocal_fails(model):
    assert model_reciprocity(model, 1e-9).verdict == "fail"


@pytest.mark.parametrize("expression", ["ggx(alpha=0.001)", "beckmann(alpha=0.05, eta=[0.2, 1], k=[3, 2])"])
def test_narrow_lobes_that_are_reciprocal_pass(expression):
    found = model_reciprocity(build(expression), 1e-9)
    assert found.verdict == "pass" and found.residual + found.bound < 1e-9


class Slightly(AbstractBRDF):
    """Off by 1e-7 of itself in one corner of the hemisphere: 0.2 rad about one direction of light."""

    def f(self, wi, wo):
        d2 = (wi.x - 0.6) ** 2 + wi.y**2
        return liars.above(wi, wo, 0.1 * (1 + 1e-7 * np.e ** (-d2 / 0.01)))


def test_the_search_finds_the_worst_corner():
    found = worst_difference(Slightly(), swapped, pair_angles(Slightly()))
    assert found["residual"] == pytest.approx(1e-7, rel=1e-3)


def test_pairs_reach_the_edges_and_are_unit_vectors():
    angles = pair_angles(build("lambert(rho=1)"))
    wi, wo = pair(angles)
    assert np.min(wi.z) > 0 and np.min(wi.z) < 1e-8 and np.max(wi.z) == 1
    for w in (wi, wo):
        np.testing.assert_allclose(w.x**2 + w.y**2 + w.z**2, 1, atol=4e-16)
    assert np.any((np.abs(wi.x - wo.x) < 1e-12) & (np.abs(wi.y - wo.y) < 1e-12))


def test_what_is_far_below_the_peak_does_not_count():
    assert relative_difference(np.array([1e-300]), np.array([0.0]), floor=1e-290)[0] < 1e-9
    assert relative_difference(np.array([0.0]), np.array([0.0]))[0] == 0


def test_a_mirrored_pair_has_the_value_of_an_isotropic_model():
    wi, wo = pair(pair_angles(build("ggx(alpha=0.3)"))[:100])
    f = build("ggx(alpha=0.3)")
    np.testing.assert_allclose(values(f, wi, wo), values(f, *mirrored(wi, wo)), rtol=1e-12)
