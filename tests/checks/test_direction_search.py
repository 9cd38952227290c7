import numpy as np
import pytest

from gonio.checks.direction_search import climb, mirrored, pair, pair_angles, rotated, swapped, values
from gonio.models.expression.builder import build


def test_pairs_reach_the_edges_and_are_unit_vectors():
    wi, wo = pair(pair_angles(build("lambert(rho=1)")))
    assert np.min(wi.z) > 0 and np.min(wi.z) < 1e-8 and np.max(wi.z) == 1
    for w in (wi, wo):
        np.testing.assert_allclose(w.x**2 + w.y**2 + w.z**2, 1, atol=4e-16)
    assert np.any((np.abs(wi.x - wo.x) < 1e-12) & (np.abs(wi.y - wo.y) < 1e-12))


@pytest.mark.parametrize("partner", [mirrored, rotated(0.7), swapped], ids=["mirrored", "turned", "exchanged"])
def test_an_isotropic_reciprocal_model_has_one_value_at_a_pair_and_its_partners(partner):
    model = build("ggx(alpha=0.3)")
    wi, wo = pair(pair_angles(model)[:100])
    np.testing.assert_allclose(values(model, wi, wo), values(model, *partner(wi, wo)), rtol=1e-10)


def test_the_search_climbs_to_the_nearest_maximum():
    top = np.array([0.4, 1.0, 0.8, 2.0])
    best, value = climb(lambda angles: -np.sum((angles - top) ** 2, axis=-1), top + 0.1 * np.eye(4))
    np.testing.assert_allclose(best, np.tile(top, (4, 1)), atol=1e-3)
    assert np.all(value > -1e-5)
