import pytest

from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.isotropy import model_symmetry
from gonio.checks.model.positivity import model_positivity
from gonio.models.expression.builder import build
from support.liars import Lopsided


def test_an_asymmetric_model_that_falls_below_zero_is_caught():
    evidence = ModelEvidence(Lopsided(0.2))
    positivity = model_positivity(evidence, 1e-9)
    assert positivity.verdict == "fail" and model_symmetry(evidence, 1e-9).verdict == "fail"
    # The least value of (0.2 + 0.3 sinθi sinθo sin(φi + φo))/π.
    assert positivity.facts["least_per_sr"] == pytest.approx(-0.1 / 3.14159265, rel=1e-3)


def test_brushed_metal_is_positive_and_symmetric():
    evidence = ModelEvidence(build("ggx(alpha_x=0.1, alpha_y=0.4)"))
    assert model_positivity(evidence, 1e-9).verdict == "pass"
    assert model_symmetry(evidence, 1e-9).verdict == "pass"
