import pytest

from gonio.checks.controls.model_mutants import mutants
from gonio.checks.model.edges import model_horizon, model_pole
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.isotropy import model_isotropy
from gonio.models.expression.builder import build


def mutant(word):
    return next(m for m in mutants() if word in m.mistake)


def test_a_grain_and_an_azimuth_of_the_normal_are_found():
    grain, normal = mutant("grain"), mutant("azimuth of the normal")
    assert model_isotropy(ModelEvidence(grain.model), 1e-6).verdict == "fail"
    assert model_isotropy(ModelEvidence(normal.meant), 1e-6).verdict == "pass"
    pole = model_pole(ModelEvidence(normal.model), 1e-3)
    # f changes by 0.3 cos 2φi cos 2φo either way: 2·0.6/2 at the most.
    assert pole.verdict == "fail" and pole.residual == pytest.approx(0.6, abs=0.02)
    assert min(pole.where["theta_i"], pole.where["theta_o"]) == 0
    assert model_pole(ModelEvidence(grain.model), 1e-3).verdict == "pass"


def test_what_claims_no_isotropy_is_measured_and_not_judged():
    isotropy = model_isotropy(ModelEvidence(build("ggx(alpha_x=0.1, alpha_y=0.3)")), 1e-6)
    assert isotropy.verdict == "not applicable" and isotropy.residual > 0.5


@pytest.mark.parametrize(("expression", "verdict"), [("ward(alpha=0.1)", "pass"), ("ward_duer(alpha=0.1)", "fail")])
def test_no_light_leaves_along_the_surface(expression, verdict):
    assert model_horizon(ModelEvidence(build(expression)), 1e-3).verdict == verdict
