"""Samplers: honest ones are believed, a density that is not theirs is not."""

import jax.numpy as jnp
import pytest

from gonio.models.empirical.phong import Phong
from gonio.stability import samplers
from gonio.stability.outcome import RIGHT


def test_a_density_that_is_not_the_samplers_is_seen():
    class Off(Phong):
        def pdf(self, wi, wo):
            return super().pdf(wi, wo) * (1 + 0.03 * jnp.sign(wo.x))

    honest, off = (samplers.count_and_expect(m(n=jnp.asarray(30.0)), 0.8, 200_000) for m in (Phong, Off))
    assert samplers.p_value(honest) > 1e-4 and honest.shares.sum() == pytest.approx(1, abs=1e-6)
    assert samplers.p_value(off) < 1e-6


@pytest.mark.parametrize(
    "expression",
    [
        "ggx(alpha=0.1)",
        "beckmann(alpha=0.3)",
        "ggx(alpha_x=0.05, alpha_y=0.4)",
        "eon(rho=1, r=1)",
        "coat(base=lambert(rho=1), alpha=0.2, eta=1.5)",
    ],
)
def test_samplers_draw_from_their_densities(expression):
    """χ² at the 1 % level over all of them [Šidák 1967], and ∫ of the density, at four incidences."""
    found = samplers.sampler_cells(expression, expression, "float64", 200_000)
    assert {c.verdict for c in found} == {RIGHT}, [c.detail for c in found]
