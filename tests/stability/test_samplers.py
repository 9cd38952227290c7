"""Samplers: honest ones are believed, a density that is not theirs is not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.empirical.phong import Phong
from gonio.models.evaluation import sampled_directions
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.stability import samplers
from gonio.stability.directions import unit_vector
from gonio.stability.outcome import RIGHT
from gonio.stability.precision import cast
from support.marks import thorough


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
        "beckmann(alpha=0.3)",
        "coat(base=lambert(rho=1), alpha=0.2, eta=1.5)",
        *thorough("ggx(alpha=0.1)", "ggx(alpha_x=0.05, alpha_y=0.4)", "eon(rho=1, r=1)"),
    ],
)
def test_samplers_draw_from_their_densities(expression):
    """χ² at the 1 % level over all of them [Šidák 1967], and ∫ of the density, at four incidences."""
    found = samplers.sampler_cells(expression, expression, "float64", 200_000)
    assert {c.verdict for c in found} == {RIGHT}, [c.detail for c in found]


@pytest.mark.thorough
def test_refraction_that_fails_about_the_lobes_middle_is_held_against_cells_about_the_normal():
    """From outside all light is refracted, so that the density adds up to 1: it jumps on a circle about the normal."""
    part = build("rough_dielectric(eta=1.5, alpha=1)").terms()[1]
    theta = samplers.INCIDENCES["89°"]
    middle, normal = (samplers.count_and_expect(part, theta, 20_000, about_normal=n) for n in (False, True))
    assert middle.lost == 0 and middle.off > samplers.WHOLE["float64"] > 10 * normal.off
    cells = samplers.sampler_cells("rough_dielectric", "rough_dielectric(eta=1.5, alpha=1)", "float64", 20_000)
    assert {c.verdict for c in cells} == {RIGHT}


def test_single_precision_says_where_its_draws_are_rounded_too_coarsely():
    """A core of 1e-8 at a rim 1e-4 away; a lobe of 0.1 says nothing, and warnings are errors."""
    rng, at_89 = np.random.default_rng(0), Direction(*np.float32(unit_vector(np.radians(89.0))))
    with jax.enable_x64(False):
        u1, u2 = rng.random((2, 4096)).astype(np.float32)
        with pytest.warns(UserWarning, match="draw in double precision"):
            sampled_directions(cast(build("abg(a=0.01, b=1e-12, g=1.5)"), np.float32), at_89, u1, u2)
        sampled_directions(cast(build("abg(a=0.01, b=0.001, g=1.5)"), np.float32), at_89, u1, u2)
