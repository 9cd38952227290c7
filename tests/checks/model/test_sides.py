"""Surfaces that transmit: their laws, and liars of their own."""

import pytest

from gonio.checks.model.energy import model_energy
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.positivity import model_positivity
from gonio.checks.model.reciprocity import model_reciprocity
from gonio.models.expression.builder import build
from support.liars import MISTAKES, transmitting
from support.marks import thorough

GLASS, SHEET = "rough_dielectric(alpha=0.4, eta=1.5)", "thin_sheet(rho=0.3, tau=0.4, rho_behind=0.1)"


@pytest.mark.parametrize("mistake", [*MISTAKES[:2], *thorough(*MISTAKES[2:])])
def test_honest_glass_is_reciprocal_over_the_squared_index_and_liars_are_not(mistake):
    judged = model_reciprocity(ModelEvidence(transmitting(build(GLASS), mistake)), 1e-9)
    assert judged.verdict == ("fail" if mistake else "pass")
    assert not mistake or (judged.detail.startswith("Transmission: ") and judged.where["theta_o"] > 90)


def test_a_sheet_transmits_the_same_both_ways():
    assert model_reciprocity(ModelEvidence(build(f"lambert(rho=0.2) + {SHEET}")), 1e-9).verdict == "pass"


@pytest.mark.parametrize(
    "foreign", [False, pytest.param(True, marks=pytest.mark.thorough)], ids=["by its map", "by cubature"]
)
def test_what_is_reflected_and_transmitted_is_counted_together_from_both_sides(foreign):
    """0.2 + 0.4 in front, and 0.7 + 0.4 behind."""
    sheet = build("thin_sheet(rho=0.2, tau=0.4, rho_behind=0.7)")
    judged = model_energy(ModelEvidence(transmitting(sheet) if foreign else sheet), 1e-3 if foreign else 1e-6)
    assert judged.verdict == "fail" and judged.residual == pytest.approx(0.1, abs=1e-4)
    assert judged.where["theta_i"] > 90 and judged.detail.startswith("Light from behind: ")
    assert judged.facts["absorbed_at_0"] == pytest.approx([-0.1], abs=1e-4)


def test_what_only_transmits_is_looked_at_where_it_does():
    judged = model_positivity(ModelEvidence(-1.0 * build("lambert_transmission(tau=0.4)")), 1e-9)
    assert judged.verdict == "fail"
