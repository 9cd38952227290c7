"""The model that data ask for: no smaller, and never larger, than what made them."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.fitting.problem.readings import readings_of
from gonio.fitting.selection.automatic import chosen_model, turned
from support.fit_tables import COARSE_ISOTROPIC as ISOTROPIC
from support.fit_tables import COARSE_SPHERICAL as ROUND
from support.fit_tables import COARSE_THETA as THETA
from support.fit_tables import ONE_LOBE as ONE
from support.fit_tables import coarse_table_of as table_of


def chosen(table, loss="cbrt", sigma=None):
    return chosen_model(table.layout, readings_of(table), loss, sigma, 0, lambda line: None)


TWO = "lambert(rho=[.1,.2,.4]) + [.9,.6,.7]*ggx(alpha=.4, f0=0.04) + [.2,.35,.3]*ggx(alpha=.1, f0=0.04)"


@pytest.mark.parametrize(
    ("truth", "layout", "found"),
    [
        ("lambert(rho=[.1,.2,.4])", ISOTROPIC, "lambert"),
        ("lambert(rho=[.3,.3,.3])", ISOTROPIC, "lambert(rho=shared)"),
        (ONE, ISOTROPIC, "lambert + ggx(f0=0.04)"),
        (ONE, ROUND, "lambert + ggx(f0=0.04)"),
        (TWO, ISOTROPIC, "lambert + ggx(f0=0.04) + ggx(f0=0.04)"),
        ("lambert(rho=[.1,.2,.4]) + [.5,.5,.5]*ggx(alpha=.3)", ISOTROPIC, "lambert + shared * ggx"),
        ("lambert(rho=[.1,.2,.4]) + [.5,.3,.4]*ggx(alpha=[.2,.3,.4])", ISOTROPIC, "lambert + ggx(alpha=each)"),
        (
            "lambert(rho=[.1,.2,.4]) + [.2,.3,.1]*ggx(alpha_x=.2, alpha_y=.4)",
            ROUND,
            "lambert + ggx(alpha_x=?, alpha_y=?)",
        ),
        ("[.5,.3,.4]*ggx(alpha=.3)", ISOTROPIC, "ggx"),
    ],
)
@pytest.mark.parametrize("noise", [0.003, 0.1])
def test_the_structure_that_made_the_data_is_chosen(truth, layout, found, noise):
    assert chosen(table_of(truth, layout, noise))[0] == found


def test_faint_structure_is_left_out_where_noise_hides_it():
    """A second lobe of a hundredth of the first is seen at 0.3 % noise, and not asked for at 30 %."""
    faint = "lambert(rho=[.1,.2,.4]) + [.9,.6,.7]*ggx(alpha=.4, f0=0.04) + [.01,.02,.015]*ggx(alpha=.1, f0=0.04)"
    assert chosen(table_of(faint, noise=0.003))[0].count("ggx") == 2
    assert chosen(table_of(faint, noise=0.3))[0].count("ggx") == 1


def test_known_uncertainty_is_the_yardstick():
    table = table_of(TWO, noise=0.03)
    u = 0.03 * np.abs(np.nan_to_num(table.f))
    readings = readings_of(table)
    sigma = readings_of(whole_table_of_values(ISOTROPIC, u)).f
    text, _, choice = chosen_model(table.layout, readings, "sigma", np.maximum(sigma, 1e-6), 0, lambda line: None)
    assert text == "lambert + ggx(f0=0.04) + ggx(f0=0.04)"
    assert choice.unit == pytest.approx(1, abs=0.1) and choice.worth < 1.2


def test_what_neighbours_share_does_not_buy_numbers():
    """A gain that drifts from one incidence to the next is no noise of single readings: lobes must not follow it."""
    table = table_of(ONE, noise=0.01)
    drift = 1 + 0.05 * np.random.default_rng(5).standard_normal(THETA.size)
    table.f = table.f * drift[:, None, None, None]
    text, _, choice = chosen(table)
    assert choice.worth > 3 and text.count("ggx") == 1


def test_a_fit_without_a_model_says_what_it_tried_and_fits_the_chosen():
    heard = []
    result = fit(table_of(ONE), starts=1, log=heard.append)
    rows = {row["model"]: row for row in result.alternatives}
    assert result.requested == "lambert + ggx(f0=0.04)" and result.converged
    assert rows[result.requested]["verdict"] == "chosen" and rows[result.requested]["bic_above_best"] == 0
    assert rows["lambert"]["bic_above_best"] > 100 and rows["lambert"]["held_out_above_best"] > 0.5
    assert rows["lambert + ggx(f0=0.04) + ggx(f0=0.04)"]["verdict"] != "chosen"
    assert rows["lambert"]["free"] == 3 and len(heard) == 2
    values = [p.value for p in result.parameters if p.status != "fixed"]
    np.testing.assert_allclose(values, [0.1, 0.2, 0.4, 0.25, 0.9, 0.7, 0.8], rtol=0.05)


def test_azimuth_is_asked_about_only_where_it_was_turned():
    one = layouts.spherical(THETA, [0.3], THETA, [0.0, 1.0])
    assert turned(ROUND, readings_of(table_of(ONE, ROUND))) and not turned(one, readings_of(table_of(ONE, one)))
    assert not turned(ISOTROPIC, readings_of(table_of(ONE)))


def test_few_readings_choose_what_they_can_bear():
    layout = layouts.in_plane(np.radians([30.0]), np.radians([0.0, 30, 60]))
    f = np.array([[0.1, 0.12, 0.09]])[..., None]
    assert fit(whole_table_of_values(layout, f, channels=Channels.grey())).requested == "lambert"
