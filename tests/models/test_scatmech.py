"""NIST's SCATMECH: facets without shadowing, with V-cavities and with Smith's shadowing.

Differences of definition: its Smith function, for each direction, is (1 − erfc(a)/2)/(1 + Λ), the share of *all* facets
that is lit [Smith 1967], where ours is 1/(1 + Λ), the share of those that face the light; it takes the rms slope,
α/√2, on its own. Aluminium there has the index 0.88 + 6.27i.
"""

import jax
import numpy as np
import pytest
from scipy.special import erfc

from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from gonio.models.microfacet import distributions as slopes
from gonio.models.microfacet.beckmann import Beckmann
from gonio.models.microfacet.cook_torrance import CookTorrance
from support import helpers

ALUMINIUM = {"eta": 0.88, "k": 6.27}


@pytest.fixture(scope="module")
def witness():
    d = np.load(helpers.shared("oracle", "scatmech_double.npz"))
    t_i, t_s, p_s = d["theta_i"], d["theta_s"], d["phi_s"]
    wi = Direction(np.sin(t_i), np.zeros_like(t_i), np.cos(t_i))
    return d, wi, Direction(-np.sin(t_s) * np.cos(p_s), np.sin(t_s) * np.sin(p_s), np.cos(t_s))


def agree(f, expected):
    seen = expected > 1e-250
    assert np.count_nonzero(seen) > 150
    np.testing.assert_allclose(np.asarray(f)[seen], expected[seen], rtol=1e-10)


@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_facets_without_shadowing(witness, alpha):
    d, wi, wo = witness
    f = evaluate(Beckmann(alpha=alpha, eta=1.5, smith="none"), wi, wo)
    agree(f, d[f"Facet_gaussslope_s{alpha}_n1.5"][:, 0, 0])


def test_v_cavities(witness):
    d, wi, wo = witness
    agree(
        evaluate(CookTorrance(alpha=0.3, **ALUMINIUM), wi, wo), d["ShadowedFacet_gauss0.3_TorranceSparrow_Al"][:, 0, 0]
    )


def test_smith(witness):
    d, wi, wo = witness

    def lit(w, alpha=0.3 * 2**0.5):
        excess = jax.vmap(lambda x, y, z: slopes.beckmann_cos_lambda(Direction(x, y, z), alpha, alpha))(*w)
        slope = w.z / (alpha * np.maximum(np.hypot(w.x, w.y), 1e-300))
        return (1 - 0.5 * erfc(slope)) / (1 + np.asarray(excess) / w.z)

    f = evaluate(Beckmann(alpha=0.3, **ALUMINIUM, smith="none"), wi, wo)
    agree(f * lit(wi) * lit(wo), d["ShadowedFacet_gauss0.3_Smith_Al"][:, 0, 0])
