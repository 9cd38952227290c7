"""The model that data ask for: no smaller, and never larger, than what made them."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.fitting.problem.readings import readings_of
from gonio.fitting.selection.automatic import select_model, shows_anisotropy
from gonio.models.errors import GonioError
from support.fit_tables import COARSE_ISOTROPIC as ISOTROPIC
from support.fit_tables import COARSE_SPHERICAL as ROUND
from support.fit_tables import COARSE_THETA as THETA
from support.fit_tables import ONE_LOBE as ONE
from support.fit_tables import coarse_table_of as table_of
from support.marks import thorough


def selected(table, loss="cbrt", sigma=None):
    readings = readings_of(table)
    return select_model(readings, loss, sigma, shows_anisotropy(table.layout, readings), 0, lambda line: None)


TWO = "lambert(rho=[.1,.2,.4]) + [.9,.6,.7]*ggx(alpha=.4, f0=0.04) + [.2,.35,.3]*ggx(alpha=.1, f0=0.04)"


@pytest.mark.parametrize(
    ("truth", "layout", "expression", "noise"),
    [
        ("lambert(rho=[.1,.2,.4])", ISOTROPIC, "lambert", 0.1),
        (ONE, ROUND, "lambert + ggx(f0=0.04)", 0.1),
        (TWO, ISOTROPIC, "lambert + ggx(f0=0.04) + ggx(f0=0.04)", 0.003),
        (
            "lambert(rho=[.1,.2,.4]) + [.2,.3,.1]*ggx(alpha_x=.2, alpha_y=.4)",
            ROUND,
            "lambert + ggx(alpha_x=?, alpha_y=?)",
            0.1,
        ),
        *thorough(
            ("lambert(rho=[.3,.3,.3])", ISOTROPIC, "lambert(rho=shared)", 0.003),
            (ONE, ISOTROPIC, "lambert + ggx(f0=0.04)", 0.003),
            ("lambert(rho=[.1,.2,.4]) + [.5,.5,.5]*ggx(alpha=.3)", ISOTROPIC, "lambert + shared * ggx", 0.1),
            (
                "lambert(rho=[.1,.2,.4]) + [.5,.3,.4]*ggx(alpha=[.2,.3,.4])",
                ISOTROPIC,
                "lambert + ggx(alpha=each)",
                0.003,
            ),
            ("[.5,.3,.4]*ggx(alpha=.3)", ISOTROPIC, "ggx", 0.003),
        ),
    ],
)
def test_the_structure_that_made_the_data_is_chosen(truth, layout, expression, noise):
    assert selected(table_of(truth, layout, noise)).expression == expression


def test_faint_structure_is_omitted_where_noise_hides_it():
    """A second lobe of a hundredth of the first is seen at 0.3 % noise, and not asked for at 30 %."""
    faint = "lambert(rho=[.1,.2,.4]) + [.9,.6,.7]*ggx(alpha=.4, f0=0.04) + [.01,.02,.015]*ggx(alpha=.1, f0=0.04)"
    assert selected(table_of(faint, noise=0.003)).expression.count("ggx") == 2
    assert selected(table_of(faint, noise=0.3)).expression.count("ggx") == 1


def test_known_uncertainty_is_the_yardstick():
    table = table_of(TWO, noise=0.03)
    u = 0.03 * np.abs(np.nan_to_num(table.f))
    sigma = readings_of(whole_table_of_values(ISOTROPIC, u)).f
    selection = selected(table, "sigma", np.maximum(sigma, 1e-6))
    assert selection.expression == "lambert + ggx(f0=0.04) + ggx(f0=0.04)"
    assert selection.result.dispersion == pytest.approx(1, abs=0.1) and selection.result.design_effect < 1.2


@pytest.mark.thorough
def test_what_neighbours_share_does_not_buy_numbers():
    """A gain that drifts from one incidence to the next is no noise of single readings: lobes must not follow it."""
    table = table_of(ONE, noise=0.01)
    drift = 1 + 0.05 * np.random.default_rng(5).standard_normal(THETA.size)
    table.f = table.f * drift[:, None, None, None]
    selection = selected(table)
    assert selection.result.design_effect > 3 and selection.expression.count("ggx") == 1


def test_a_fit_without_a_model_lists_the_candidates_and_fits_the_chosen():
    lines = []
    result = fit(table_of(ONE), starts=1, log=lines.append)
    rows = {row["model"]: row for row in result.alternatives}
    assert result.requested == "lambert + ggx(f0=0.04)" and result.converged
    assert rows[result.requested]["verdict"] == "chosen" and rows[result.requested]["bic_above_best"] == 0
    assert rows["lambert"]["bic_above_best"] > 100 and rows["lambert"]["held_out_above_best"] > 0.5
    assert all(row["verdict"] != "chosen" for name, row in rows.items() if name != result.requested)
    assert rows["lambert"]["free"] == 3 and len(lines) == 2
    values = [p.value for p in result.parameters if p.status != "fixed"]
    np.testing.assert_allclose(values, [0.1, 0.2, 0.4, 0.25, 0.9, 0.7, 0.8], rtol=0.05)


def test_anisotropy_shows_only_where_the_light_comes_from_more_than_one_azimuth():
    one = layouts.spherical(THETA, [0.3], THETA, [0.0, 1.0])
    shown = [shows_anisotropy(layout, readings_of(table_of(ONE, layout))) for layout in (ROUND, one, ISOTROPIC)]
    assert shown == [True, False, False]


def test_few_readings_choose_what_they_can_bear():
    layout = layouts.in_plane(np.radians([30.0]), np.radians([0.0, 30, 60]))
    f = np.array([[0.1, 0.12, 0.09]])[..., None]
    assert fit(whole_table_of_values(layout, f, channels=Channels.grey())).requested == "lambert"


def test_a_single_reading_is_refused():
    table = whole_table_of_values(layouts.in_plane([0.5], [0.1]), np.full((1, 1, 1), 0.1), channels=Channels.grey())
    with pytest.raises(GonioError, match="too few"):
        fit(table)


def test_readings_without_light_tell_no_model_from_another():
    layout = layouts.in_plane(np.radians([30.0]), np.radians(np.r_[-80.0:81:10]))
    with pytest.raises(GonioError, match="all 17 readings are 0"):
        fit(whole_table_of_values(layout, np.zeros((1, 17, 1)), channels=Channels.grey()))
