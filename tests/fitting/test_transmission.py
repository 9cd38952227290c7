"""Fits to readings behind a sample: exact numbers back, and what does not fit there is refused."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import gonio
from gonio.fitting.problem.disc_averages import NodePairs, disc_rules
from gonio.instrument import scans
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import from_spherical

STEP = math.radians(20)


@pytest.fixture(scope="module")
def sheet():
    """Readings of both hemispheres with 0.5 % of noise."""
    table = gonio.measure("thin_sheet(rho=0.3, tau=0.5)", scan=scans.isotropic(STEP, hemisphere="both"))
    u = 0.005 * np.asarray(table.f)
    return dataclasses.replace(table, f=table.f + u * np.random.default_rng(1).standard_normal(u.shape), u_f=u)


def test_what_a_sheet_reflects_and_transmits_is_found(sheet):
    """f is a sum of what is proportional to each of two albedos, and so proportional to neither."""
    r = gonio.fit(sheet, "thin_sheet", starts=1)
    assert r.converged and [p.value for p in r.parameters] == pytest.approx([0.3, 0.5], abs=0.002)
    assert r.metrics["reduced_chi2"] == pytest.approx(1, abs=0.1)
    assert r.metrics["largest_albedo"] == pytest.approx(0.8, abs=0.003)


def test_discs_behind_are_averaged_as_their_mirror_images_in_front():
    """The rays of a disc behind are those in front mirrored, with the same weights, where the horizon cuts it too."""
    rules = jax.tree.map(jnp.asarray, disc_rules((0.1, 0.15)))
    wi, wo = (from_spherical(np.array(t), np.full(2, p), np) for t, p in (([0.3, 1.5], 0.0), ([0.5, 1.4], 1.0)))
    pair = jax.jit(lambda pairs, k: pairs.pair(k))
    for rule in map(jnp.asarray, (4, 5)):  # whole discs, and discs that the horizon cuts
        of_side = [NodePairs.of(rules, rule, jnp.asarray(0), wi, wo._replace(z=s * wo.z)) for s in (1, -1)]
        for k in map(jnp.asarray, (0, 3, 7)):
            (i, o, weight), (i_behind, o_behind, weight_behind) = (pair(pairs, k) for pairs in of_side)
            np.testing.assert_allclose(weight_behind, weight, rtol=1e-14)
            np.testing.assert_allclose(np.array(i_behind), np.array(i), atol=1e-15)
            np.testing.assert_allclose(np.array(o_behind), np.array(o._replace(z=-o.z)), atol=1e-15)
            assert (np.asarray(weight) > 0).any()


def test_a_model_that_is_dark_where_the_table_is_not_is_refused(sheet):
    with pytest.raises(GonioError, match="scatters nothing in transmission, where the table has"):
        gonio.fit(sheet, "lambert")
