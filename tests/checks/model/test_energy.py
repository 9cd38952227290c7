import pytest

from gonio.checks.model.energy import model_energy
from gonio.checks.model.evidence import ModelEvidence
from gonio.models.expression.builder import build
from support.liars import Foreign
from support.marks import thorough

GAINS = {
    "blinn_phong_popular(n=1)": 1.024,
    "blinn_phong_popular(n=10)": 1.075,
    "ward_duer(alpha=0.1)": 3.25,
    "cook_torrance_1982(alpha=0.3)": 3.9,
    "burley_diffuse(rho=1, roughness=1)": 1.54,
    "minnaert(rho=1, k=0.8)": 2.5,
    "oren_nayar(rho=1, sigma=0.3)": 1.043,
}
"""Published models by the largest albedo, at least, that they reach."""


def energy_of(model):
    return model_energy(ModelEvidence(model), 1e-6)


SMALLEST, *OTHERS = GAINS.items()


@pytest.mark.parametrize(("expression", "albedo"), [SMALLEST, OTHERS[-2], *thorough(*OTHERS[:-2], OTHERS[-1])])
def test_a_model_from_outside_that_gains_energy_fails(expression, albedo):
    energy = energy_of(Foreign(build(expression)))
    assert energy.verdict == "fail"
    assert 1 + energy.residual >= albedo - 0.001


@pytest.mark.parametrize("expression", ["minnaert(rho=1, k=1.5)", *thorough("ward(alpha=0.1)")])
def test_a_model_from_outside_that_only_loses_passes_and_its_loss_is_stated(expression):
    energy = energy_of(Foreign(build(expression)))
    assert energy.verdict == "pass" and energy.facts["largest_loss"] > 0.3


@pytest.mark.parametrize("expression", ["white_standard()", "ggx(alpha=0.001)"])
def test_exact_and_near_standards_pass(expression):
    energy = energy_of(build(expression))
    assert energy.verdict == "pass" and abs(energy.residual) < 2e-6


def test_a_scaled_mirror_fails_by_its_scale():
    assert energy_of(build("1.2 * ggx(alpha=0.001)")).residual == pytest.approx(0.2, abs=1e-5)


@pytest.mark.thorough
def test_a_narrow_lobe_from_outside_is_never_judged_wrongly():
    honest, gaining = (energy_of(Foreign(build(f"{scale} * beckmann(alpha=0.003)"))) for scale in (1, 1.3))
    assert honest.verdict != "fail" and gaining.verdict == "fail"
