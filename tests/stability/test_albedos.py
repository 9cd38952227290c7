"""Directional albedos: the rings know closed forms, and a bound that does not hold is silent."""

import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import Estimate
from gonio.models.empirical.phong import Phong
from gonio.models.expression.builder import build
from gonio.models.folded import Folded
from gonio.models.microfacet.ggx import GGX
from gonio.stability import albedos as integrals
from gonio.stability.albedos import integral_cells, ring_albedo
from gonio.stability.outcome import RIGHT, SILENT


def test_rings_know_the_closed_forms():
    mu = np.cos(1.2)
    value, known = integrals.reference_albedo(GGX(alpha=jnp.asarray(1.0)), 1.2)
    assert value == pytest.approx(1 - mu * np.log(1 + 1 / mu), abs=1e-10) and known < 5e-9
    value, known = integrals.reference_albedo(Phong(n=jnp.asarray(0.0)), 1.5)
    assert value == pytest.approx((1 + np.cos(1.5)) / 2, abs=1e-9) and known < 5e-9


def test_steep_facets_count_where_tails_are_short():
    """Beyond a slope of 1 GTR's density falls as GGX's, whatever γ: at 89° that is 4e-6 of the albedo."""
    found = integrals.integral_cells("gtr", "gtr(alpha=0.3, gamma=5)")
    assert {c.verdict for c in found} == {RIGHT}, [c.detail for c in found]


def test_a_bound_that_does_not_hold_is_silent(monkeypatch):
    honest = integrals.directional_albedo
    monkeypatch.setattr(
        integrals, "directional_albedo", lambda *a: Estimate(honest(*a).value + 1e-5, honest(*a).bound, 0)
    )
    assert {c.verdict for c in integrals.integral_cells("lambert", "lambert(rho=0.5)")} == {SILENT}


def test_what_goes_through_is_held_against_rings_too():
    """Of a diffuser the sum is known; of a narrow interface what its own rule leaves is within its bound."""
    assert {c.verdict for c in integral_cells("", "lambert_transmission(tau=0.6)")} == {RIGHT}
    through = ring_albedo(Folded(build("lambert_transmission(tau=0.6)"), 1, -1), 0.5, "refracted", bend=0.7)
    assert through.value == pytest.approx(0.6, abs=1e-9)
    assert {c.verdict for c in integral_cells("", "rough_dielectric(eta=1.5, alpha=0.001)")} == {RIGHT}
