import numpy as np
import pytest

from gonio.checks.certificate import relative_difference
from gonio.checks.controls.model_mutants import mutants
from gonio.checks.direction_search import pair_angles, swapped
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.reciprocity import difference_of_pairs, model_reciprocity
from gonio.models.expression.builder import build
from support import liars


@pytest.mark.parametrize("mistake", ["cosθi once more", "dimmed on its way in"])
def test_a_model_that_is_not_reciprocal_fails(mistake):
    model = next(m.model for m in mutants() if mistake in m.mistake)
    assert model_reciprocity(ModelEvidence(model), 1e-9).verdict == "fail"


@pytest.mark.parametrize("expression", ["ggx(alpha=0.001)", "beckmann(alpha=0.05, eta=[0.2, 1], k=[3, 2])"])
def test_narrow_lobes_that_are_reciprocal_pass(expression):
    reciprocity = model_reciprocity(ModelEvidence(build(expression)), 1e-9)
    assert reciprocity.verdict == "pass" and reciprocity.residual + reciprocity.bound < 1e-9


def test_the_search_finds_the_worst_corner():
    model = liars.Slightly(1e-7)
    worst = difference_of_pairs(model, swapped, pair_angles(model))
    assert worst.residual == pytest.approx(1e-7, rel=1e-3)


def test_what_is_far_below_the_peak_does_not_count():
    assert relative_difference(np.array([1e-300]), np.array([0.0]), floor=1e-290)[0] < 1e-9
    assert relative_difference(np.array([0.0]), np.array([0.0]))[0] == 0
