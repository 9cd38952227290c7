import numpy as np
import pytest

from gonio.checks.controls.model_mutants import mutants
from gonio.checks.model.edges import model_horizon, model_pole, table_horizon
from gonio.checks.model.isotropy import model_isotropy, table_isotropy, table_pole
from gonio.data import layouts
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.expression.builder import build


def degrees(*range_):
    return np.radians(np.arange(*range_))


SPHERICAL = layouts.spherical(degrees(0, 90, 15), degrees(0, 360, 45), degrees(0, 90, 15), degrees(0, 360, 45))
ISOTROPIC = layouts.isotropic(degrees(0, 86, 5), degrees(0, 86, 5), degrees(0, 360, 30))
HALF = layouts.half_difference(degrees(0, 90, 10), degrees(0, 90, 10), degrees(0, 360, 30), degrees(0, 360, 45))


def mutant(word):
    return next(m for m in mutants() if word in m.mistake)


def table(layout, change=lambda f, *angles: f, expression="0.5 * ggx(alpha=0.4) + lambert(rho=0.3)", u=None):
    f = grid_values(build(expression), layout)[..., 0]
    f = change(f, *(a.reshape(layout.shape) for a in layout.angles()))
    return whole_table_of_values(layout, f, u_f=None if u is None else u * np.abs(f)[..., None])


def test_a_grain_and_an_azimuth_of_the_normal_are_found_in_models():
    grain, normal = mutant("grain"), mutant("azimuth of the normal")
    assert model_isotropy(grain.model, 1e-6).verdict == "fail"
    assert model_isotropy(normal.meant, 1e-6).verdict == "pass"
    found = model_pole(normal.model, 1e-3)
    # f changes by 0.3 cos 2φi cos 2φo either way: 2·0.6/2 at the most.
    assert found.verdict == "fail" and found.residual == pytest.approx(0.6, abs=0.02)
    assert min(found.where["theta_i"], found.where["theta_o"]) == 0
    assert model_pole(grain.model, 1e-3).verdict == "pass"


def test_what_claims_no_isotropy_is_measured_and_not_judged():
    found = model_isotropy(build("ggx(alpha_x=0.1, alpha_y=0.3)"), 1e-6)
    assert found.verdict == "not applicable" and found.residual > 0.5


@pytest.mark.parametrize(("expression", "verdict"), [("ward(alpha=0.1)", "pass"), ("ward_duer(alpha=0.1)", "fail")])
def test_no_light_leaves_along_the_surface(expression, verdict):
    assert model_horizon(build(expression), 1e-3).verdict == verdict


@pytest.mark.parametrize("layout", [SPHERICAL, HALF], ids=["spherical", "half/difference"])
def test_turned_readings_of_a_table_are_compared(layout):
    assert table_isotropy(table(layout), 0.05).verdict == "pass"
    turned = table(layout, lambda f, ti, pi, to, po: f * (1 + 0.5 * np.cos(2 * pi + 0.8) * np.sin(ti)))
    assert table_isotropy(turned, 0.05).verdict == "fail"
    assert table_isotropy(table(ISOTROPIC), 0.05).verdict == "not applicable"


@pytest.mark.parametrize("layout", [SPHERICAL, ISOTROPIC], ids=["spherical", "isotropic"])
def test_readings_at_the_normal_have_no_azimuth(layout):
    assert table_pole(table(layout), 0.05).verdict == "pass"
    assert table_pole(table(layout, u=0.01), 0.05).verdict == "pass"
    off = table(layout, lambda f, ti, pi, to, po: f * (1 + 0.3 * np.cos(po - pi)))
    found = table_pole(off, 0.05)
    assert found.verdict == "fail" and min(found.where["theta_i"], found.where["theta_o"]) == pytest.approx(0)
    beside = layouts.isotropic(degrees(5, 86, 10), degrees(5, 86, 10), degrees(0, 360, 30))
    assert table_pole(table(beside), 0.05).verdict == "not applicable"


def test_a_ring_that_is_off_is_found_at_the_horizon():
    assert table_horizon(table(ISOTROPIC), 0.5).verdict == "pass"
    blocked = table(ISOTROPIC, lambda f, ti, pi, to, po: np.where(to > np.radians(84), 0.3 * f, f))
    found = table_horizon(blocked, 0.5)
    assert found.verdict == "fail" and found.residual == pytest.approx(-np.log(0.3), abs=0.3)
    assert found.where["theta_o"] == pytest.approx(85)
    # Readings whose noise is as large as the jump leave it open.
    assert table_horizon(table(ISOTROPIC, u=2.0), 0.5).verdict == "undecided"
