import pytest

from gonio.checks.model.positivity import model_positivity, model_symmetry
from gonio.models.expression.builder import build
from support import liars


def test_an_asymmetric_model_that_falls_below_zero_is_caught():
    positivity, symmetry = model_positivity(liars.Lopsided(0.2), 1e-9), model_symmetry(liars.Lopsided(0.2), 1e-9)
    assert positivity.verdict == "fail" and symmetry.verdict == "fail"
    # The least value of (0.2 + 0.3 sinθi sinθo sin(φi + φo))/π.
    assert positivity.facts["least_per_sr"] == pytest.approx(-0.1 / 3.14159265, rel=1e-3)


def test_brushed_metal_is_positive_and_symmetric():
    model = build("ggx(alpha_x=0.1, alpha_y=0.4)")
    assert model_positivity(model, 1e-9).verdict == "pass"
    assert model_symmetry(model, 1e-9).verdict == "pass"
