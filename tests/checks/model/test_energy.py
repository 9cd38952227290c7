import numpy as np
import pytest

from gonio.checks.model.cubature import cubature_albedo
from gonio.checks.model.energy import energy_property, model_energy
from gonio.models.expression.builder import build
from support import liars

LIARS = {
    "blinn-phong 1": (liars.BlinnPhong(1.0), 1.024),
    "blinn-phong 10": (liars.BlinnPhong(10.0), 1.075),
    "ward-duer": (liars.WardDuer(0.1), 3.25),
    "cook-torrance 1982": (liars.CookTorrance1982(0.3), 3.9),
    "disney": (liars.DisneyDiffuse(1.0), 1.54),
    "minnaert": (liars.Minnaert(0.8), 2.5),
    "oren-nayar": (liars.OrenNayarFull(0.3), 1.043),
}


@pytest.mark.parametrize(("model", "at_least"), LIARS.values(), ids=LIARS)
def test_a_model_that_gains_energy_fails(model, at_least):
    found = model_energy(model, 1e-6)
    assert found.verdict == "fail"
    assert 1 + found.residual >= at_least - 0.001


@pytest.mark.parametrize("model", [liars.Ward(0.1), liars.Minnaert(1.5)], ids=["ward", "minnaert"])
def test_a_model_that_only_loses_passes_and_its_loss_is_said(model):
    found = model_energy(model, 1e-6)
    assert found.verdict == "pass"
    assert found.facts["largest_loss"] > 0.5


@pytest.mark.parametrize("expression", ["white_standard()", "ggx(alpha=0.001)"])
def test_exact_and_near_standards_pass(expression):
    found = model_energy(build(expression), 1e-6)
    assert found.verdict == "pass"
    assert abs(found.residual) < 2e-6


def test_a_scaled_mirror_fails_by_its_scale():
    assert model_energy(build("1.2 * ggx(alpha=0.001)"), 1e-6).residual == pytest.approx(0.2, abs=1e-5)


def test_a_narrow_lobe_from_outside_is_never_judged_wrongly():
    honest = model_energy(liars.Foreign(build("beckmann(alpha=0.003)")), 1e-6)
    liar = model_energy(liars.Foreign(build("1.3 * beckmann(alpha=0.003)")), 1e-6)
    assert honest.verdict != "fail" and liar.verdict == "fail"


@pytest.mark.parametrize(
    ("alpha", "theta", "albedo"), [(0.5, 0.0, 0.6878485151), (0.25, 0.0, 0.9158124303), (0.1, 0.0, 0.9883040566)]
)
def test_cubature_without_a_map_meets_the_closed_form(alpha, theta, albedo):
    value, bound = cubature_albedo(liars.Foreign(build(f"ggx(alpha={alpha})")), theta, 0.0)
    assert abs(value[0] - albedo) <= bound[0] + 1e-9 and bound[0] < 1e-6


def test_cubature_bounds_hold_where_it_runs_out_of_cells():
    # α = 1 with height-correlated masking: E = 1 − μ ln(1 + 1/μ); a narrow lobe at grazing for the other.
    mu = np.cos(np.radians(89.9))
    value, bound = cubature_albedo(liars.Foreign(build("ggx(alpha=1)")), np.radians(89.9), 0.0)
    assert abs(value[0] - (1 - mu * np.log(1 + 1 / mu))) <= bound[0]


def test_the_verdict_takes_the_place_that_decides_it():
    theta, phi = np.zeros(2), np.zeros(2)
    value, bound = np.array([[1.5], [1.1]]), np.array([[9.0], [0.01]])
    found = energy_property(theta, phi, value, bound, 1e-6, "", {})
    assert found.verdict == "fail" and found.residual == pytest.approx(0.1)
    found = energy_property(theta, phi, value - 0.5, np.array([[np.inf], [0.01]]), 1e-6, "", {})
    assert found.verdict == "undecided"
