"""Models that readings behind a sample ask for: what made them, on the sides that were read."""

import numpy as np
import pytest

from gonio.data.layouts import isotropic
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.fitting.problem.readings import readings_of, sigma_of
from gonio.fitting.selection.candidate_model import CandidateProblem, SelectionData
from gonio.fitting.selection.moves import POWER, moves_for
from gonio.fitting.selection.stepwise import stepwise_selection
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.expression.parser import parse

POLAR = np.radians(np.arange(5, 86, 10.0))
BEHIND = (np.pi - POLAR)[::-1]
BOTH = np.concatenate([POLAR, BEHIND])


def table_of(expression, light, detector, noise=0.01):
    grid = isotropic(light, detector, np.radians(np.arange(0, 360, 15.0)))
    f = grid_values(build(expression), grid)
    u = noise * np.abs(f) + 1e-5
    return whole_table_of_values(grid, f + u * np.random.default_rng(3).standard_normal(f.shape), u_f=u)


def selected(table):
    readings = readings_of(table)
    return stepwise_selection(readings, "sigma", sigma_of(readings), anisotropic=False).chosen


@pytest.mark.parametrize(
    ("truth", "light", "detector", "expression"),
    [
        pytest.param(
            "lambert(rho=0.2) + lambert_transmission(tau=0.5)", POLAR, BOTH, "lambert + lambert_transmission",
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            "cosine_power_transmission(tau=0.7, n=40)", POLAR, BEHIND, "cosine_power_transmission",
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            "0.6 * rough_dielectric(alpha=0.3, eta=1.5)", BOTH, BOTH, "? * rough_dielectric",
            marks=pytest.mark.thorough,
        ),
        (
            "thin_sheet(rho=0.3, tau=0.2) + 0.4 * transmitted(base=ggx(alpha=0.3))",
            BOTH,
            BOTH,
            "thin_sheet + transmitted(base=ggx)",
        ),
    ],
)  # fmt: skip
def test_the_structure_that_made_the_data_is_chosen(truth, light, detector, expression):
    assert selected(table_of(truth, light, detector)).expression == expression


def test_at_a_right_angle_to_the_lobe_there_is_no_peak():
    """A cosine of about 0 is rounded to either side of it, twice and differently in a program with derivatives."""
    polar = np.radians(np.arange(0, 81, 10.0))
    grid = isotropic(polar, (np.pi - polar)[::-1], np.radians(np.arange(0, 360, 10.0)))
    wi, wo = grid.directions()
    none = np.zeros((grid.size, 1))
    problem = CandidateProblem((POWER,), SelectionData.of(wi, wo, none, none, "linear", 1.0))
    expected = np.asarray(evaluate(build("cosine_power_transmission(tau=0.7, n=40)"), wi, wo))
    np.testing.assert_allclose(problem.values(np.array([0.7, 40.0]))[0][:, 0], expected, rtol=1e-9, atol=1e-12)


def test_every_candidate_can_be_written_and_scatters_where_light_was_read():
    moves = moves_for(readings_of(table_of("thin_sheet(rho=0.3, tau=0.2)", BOTH, BOTH)))
    reached, new = {moves.start}, [moves.start]
    for _ in range(2):
        new = [t for terms in new for t in (*moves.steps(terms, False, 1), *moves.families(terms)) if t not in reached]
        reached |= set(new)
        new = new[:12]
    for terms in [*reached, *(t for old in reached for t in moves.simpler(old, 3))]:
        assert parse(" + ".join(t.expression for t in terms)) and moves.covers(terms)
