"""Fits: truth recovered, uncertainties that mean something, and what cannot be known said out loud."""

import jax
import numpy as np
import pytest
import scipy.stats
from scipy.optimize import least_squares

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.table import Channels, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from support.fit_tables import ISOTROPIC, free, table_of, values

SEVEN = "lambert(rho=[.1,.2,.4]) + [1,.8,.6]*ggx(alpha=.2, eta=1.5)"
TRUTH = np.array([0.1, 0.2, 0.4, 0.2, 1, 0.8, 0.6])
RARE = 1e-4  # probability of an alarm by chance, were the noise drawn anew


@pytest.fixture(scope="module")
def seven():
    return table_of(SEVEN)


@pytest.mark.parametrize("loss", ["cbrt", "log1p"])
def test_seven_numbers_without_noise_from_every_start(seven, loss):
    result = fit(seven, "lambert + ggx(eta=1.5)", loss=loss, starts=20)
    np.testing.assert_allclose(values(result), TRUTH, rtol=1e-9)
    assert result.converged and result.exact and result.starts_agreed == result.starts == 23
    assert list(free(result))[:4] == ["lambert.rho[R]", "lambert.rho[G]", "lambert.rho[B]", "ggx.alpha"]
    np.testing.assert_allclose(
        evaluate(result.brdf, *ISOTROPIC.directions()), seven.f.reshape(-1, 3), rtol=1e-9, equal_nan=True
    )


def test_a_second_fit_traces_nothing(seven):
    """A trace of a model takes as long as a small fit of it."""
    first, events = fit(seven, "lambert + ggx(eta=1.5)", starts=2), []

    def listen(event: str, duration_secs: float, **_: str | int) -> None:
        events.append(event)

    jax.monitoring.register_event_duration_secs_listener(listen)
    again = fit(seven, "lambert + ggx(eta=1.5)", starts=2)
    jax.monitoring.unregister_event_duration_listener(listen)
    np.testing.assert_array_equal(values(again), values(first))
    assert not events


def test_single_precision_tables_converge(seven):
    """Residuals of 1e-8 are above rounding, and below what differences of the cost can show: the gradient decides."""
    single = table_of(SEVEN)
    single.f = single.f.astype(np.float32)
    result = fit(single, "lambert + ggx(eta=1.5)", starts=4)
    assert result.converged and not result.exact and result.stationarity < 1e-6 and not result.undetermined
    np.testing.assert_allclose(values(result), TRUTH, rtol=1e-7)


def test_same_optimum_as_scipy(seven):
    """SciPy's bounded least squares on a NumPy model, same data, same loss: the cost is no higher than its best."""
    table = table_of(SEVEN, noise=0.1)
    result = fit(table, "lambert + ggx(eta=1.5)", loss="log1p", starts=2)
    wi, wo = ISOTROPIC.directions()
    keep = np.isfinite(table.f.reshape(-1, 3)[:, 0])
    i, o = (np.stack(w)[:, keep] for w in (wi, wo))
    h = i + o
    h /= np.linalg.norm(h, axis=0)
    c, target = np.sum(i * h, 0), np.log1p(table.f.reshape(-1, 3)[keep])
    g = np.sqrt(1.5**2 - 1 + c**2)
    f = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)

    def residual(p):
        a2 = p[3] ** 2
        d = a2 / (np.pi * (h[2] ** 2 * (a2 - 1) + 1) ** 2)
        v = 0.5 / (o[2] * np.sqrt(a2 + (1 - a2) * i[2] ** 2) + i[2] * np.sqrt(a2 + (1 - a2) * o[2] ** 2))
        return (np.log1p(p[:3] / np.pi + p[4:] * (d * v * f)[:, None]) - target).ravel()

    found = least_squares(
        residual,
        [0.5, 0.5, 0.5, 0.3, 0.5, 0.5, 0.5],
        bounds=(0, [1, 1, 1, 1, 9, 9, 9]),
        x_scale="jac",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    assert result.cost <= found.cost * (1 + 1e-9)
    np.testing.assert_allclose(values(result), found.x, rtol=1e-5)


def test_uncertainties_cover_the_truth():
    """30 draws of 5 % noise, weighted by it: errors by their covariance are χ² of 7 numbers each."""
    distances, covered = [], 0
    for seed in range(30):
        result = fit(table_of(SEVEN, noise=0.05, seed=seed), "lambert + ggx(eta=1.5)", relative_noise=0.05, starts=0)
        error = values(result) - TRUTH
        distances.append(error @ np.linalg.solve(result.covariance, error))
        alpha = free(result)["ggx.alpha"]
        covered += alpha.interval95[0] <= 0.2 <= alpha.interval95[1]
        freedom = result.samples - 7
        assert result.converged
        assert scipy.stats.chi2.cdf(freedom * result.metrics["reduced_chi2"], freedom) > RARE
    total = scipy.stats.chi2(7 * 30).cdf(np.sum(distances))
    assert RARE < total < 1 - RARE
    assert covered >= scipy.stats.binom(30, 0.95).ppf(RARE)


def test_active_bounds_are_reached_and_said():
    result = fit(table_of("lambert(rho=0) + 0.8*ggx(alpha=0.2)", noise=0.03), "lambert + ggx", starts=3)
    numbers = free(result)
    assert numbers["lambert.rho"].value == 0.0 and numbers["lambert.rho"].status == "at lower bound"
    assert result.converged and result.active_bounds == ["lambert.rho"]
    assert abs(numbers["ggx.alpha"].value - 0.2) < 4 * numbers["ggx.alpha"].standard_uncertainty


def test_a_valley_is_named():
    """F₀ and scale cannot be told apart at small angles: their combination is named, and neither is called known."""
    table = table_of("0.6*ggx(alpha=0.3, f0=0.1)+lambert(rho=.2)", noise=0.01)
    result = fit(table, "lambert + ggx(f0=?)", theta_max=np.radians(45), starts=0)
    assert any("ggx.f0" in words and "ggx.scale" in words and "combination" in words for words in result.undetermined)
    assert free(result)["ggx.f0"].status == "undetermined" and free(result)["lambert.rho"].status == "determined"
    whole = fit(table, "lambert + ggx(f0=?)", starts=0)
    assert free(whole)["ggx.f0"].status == "determined" and not whole.undetermined


def test_a_number_that_moves_nothing_is_undetermined():
    result = fit(table_of("lambert(rho=0.5)"), "lambert(rho=?) + 0 * ggx(alpha=?)", starts=1)
    assert free(result)["ggx.alpha"].status == "undetermined"
    assert any("ggx.alpha" in words for words in result.undetermined)


def test_two_lobes_come_in_the_order_of_their_widths():
    truth = "lambert(rho=.2)+0.8*ggx(alpha=0.4,f0=0.04)+0.5*ggx(alpha=0.1,f0=0.04)"
    result = fit(table_of(truth), "lambert + ggx(f0=0.04) + ggx(f0=0.04)", starts=4)
    np.testing.assert_allclose(values(result), [0.2, 0.1, 0.5, 0.4, 0.8], rtol=1e-8)
    assert result.starts_agreed == result.starts


def test_channels_by_themselves_find_what_joint_finds(seven):
    result = fit(seven, "lambert + ggx(eta=1.5)", per_channel=True, starts=0)
    assert {p.label for p in result.parameters if p.name == "ggx.alpha"} == {f"ggx.alpha[{c}]" for c in "RGB"}
    assert all(p.value == pytest.approx(0.2, rel=1e-9) for p in result.parameters if p.name == "ggx.alpha")
    assert result.covariance.shape == (9, 9) and len(result.free_names) == 9


def test_negative_readings_count_and_masked_ones_do_not():
    table = table_of("lambert(rho=0.01)")
    valid = np.flatnonzero(table.flag.ravel() == Flag.VALID)
    table.f.ravel()[valid[::2]] = -0.002
    masked = valid[1::2][:50]
    table.f.ravel()[masked], table.flag.ravel()[masked] = 1e6, Flag.SATURATED
    result = fit(table, "lambert", loss="linear")
    kept = np.setdiff1d(valid, masked)
    assert result.negative_readings == valid[::2].size and result.samples == kept.size
    assert free(result)["lambert.rho"].value == pytest.approx(np.pi * table.f.ravel()[kept].mean(), rel=1e-9)


def test_stored_uncertainty_weighs():
    """Weighted mean by 1/u², with its standard uncertainty; unknown and exact cells weigh as the median one."""
    table = table_of("lambert(rho=0.5)")
    u = np.where(np.arange(table.f.size).reshape(table.f.shape) % 2, 0.01, 0.001)
    f = np.where(u < 0.005, 0.1, 0.105) + 1e-4 * np.random.default_rng(0).random(u.shape)
    table.f, table.u_f = np.where(table.flag == Flag.VALID, f, np.nan), u
    valid = (table.flag == Flag.VALID).ravel()
    w, y = 1 / u.ravel()[valid] ** 2, f.ravel()[valid]
    result = fit(table, "lambert")
    assert result.loss == "sigma"
    rho = free(result)["lambert.rho"]
    assert rho.value == pytest.approx(np.pi * np.sum(w * y) / np.sum(w), rel=1e-9)
    assert rho.standard_uncertainty == pytest.approx(np.pi / np.sqrt(np.sum(w)), rel=1e-9)
    table.u_f = np.zeros_like(u)
    assert fit(table, "lambert").loss == "cbrt"


def test_residuals_beyond_the_noise_are_said():
    """A model that leaves something out: χ² tells, and the uncertainties grow by its root."""
    table = table_of("lambert(rho=.2)+0.5*ggx(alpha=0.2)", noise=0.01)
    table.u_f = np.abs(0.01 * np.nan_to_num(table.f)) + 1e-9
    right, wrong = (fit(table, m, starts=0) for m in ("lambert + ggx", "lambert + beckmann"))
    assert right.metrics["reduced_chi2"] == pytest.approx(1, abs=0.1) and not any("noise (" in n for n in right.notes)
    assert wrong.metrics["reduced_chi2"] > 10 and "leaves something out" in wrong.notes[0]


def test_models_are_ranked_by_bic():
    table = table_of("lambert(rho=.2)+0.5*ggx(alpha=0.2)", noise=0.02)
    result = fit(table, ["lambert", "lambert + ggx", "lambert + ggx + ggx"], starts=2)
    assert result.requested == "lambert + ggx"
    assert result.alternatives[0]["model"] == "lambert + ggx" and len(result.alternatives) == 3
    assert result.alternatives[0]["bic_above_best"] == 0 < result.alternatives[1]["bic_above_best"]


def test_exact_values_are_kept_and_channels_listed():
    result = fit(table_of(SEVEN), "lambert(rho=[.1,.2,.4]) + [1,.8,.6] * ggx(alpha~0.5, eta=1.5)", starts=0)
    assert list(free(result)) == ["ggx.alpha"] and values(result)[0] == pytest.approx(0.2, rel=1e-9)
    fixed = [p for p in result.parameters if p.status == "fixed"]
    assert {p.label for p in fixed} >= {"lambert.rho[R]", "ggx.scale[B]", "ggx.eta"}


@pytest.mark.parametrize(("model", "is_compared_alone"), [("lambert(rho=0.3)", True), ("lambert", False)])
def test_a_model_without_a_free_number_is_compared_alone_and_that_is_said(model, is_compared_alone):
    result = fit(table_of("lambert(rho=0.2)"), model)
    assert any("nothing was fitted" in note for note in result.notes) == is_compared_alone == (not result.free_names)


def test_solid_angle_weights_change_the_mean():
    layout = layouts.in_plane(np.radians([10, 40]), np.radians([-70, -30, 30, 70]))
    f = np.array([[1.0, 2, 2, 1]] * 2)[..., None]
    result = fit(whole_table_of_values(layout, f), "lambert(rho=?)", loss="linear", weight="solid-angle")
    theta_o, spacing = np.radians([70, 30, 30, 70]), 1.0
    w = np.sin(theta_o) * spacing
    assert free(result)["lambert.rho"].value == pytest.approx(
        min(1, np.pi * np.sum(w * f[0, :, 0]) / np.sum(w)), rel=1e-9
    )


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        ("lambert + ggx", {"loss": "squared"}, ["squared", "did you mean|known"]),
        ("lambert + ggz", {}, ["ggz", "ggx"]),
        ("lambert(rho=[.1,.2]) + ggx", {}, ["2 values", "3"]),
        ("lambert", {"loss": "sigma"}, ["uncertaint"]),
        ("lambert", {"relative_noise": 5.0}, ["between 0 and 1"]),
        ("lambert", {"weight": "solid"}, ["solid-angle"]),
    ],
)
def test_what_cannot_be_fitted_is_one_sentence(seven, model, options, words):
    with pytest.raises(GonioError) as error:
        fit(seven, model, **options)
    assert "\n" not in str(error.value)
    assert any(w in str(error.value) for w in words[-1].split("|")) and words[0] in str(error.value)


def test_as_many_numbers_as_readings_leave_no_uncertainty():
    angles = np.radians([[10, 20, 30], [0, 0, 0], [20, 10, 20], [0, 0, 0]])
    table = whole_table_of_values(
        layouts.scattered(*angles), np.array([[0.1], [0.11], [0.12]]), channels=Channels.grey()
    )
    result = fit(table, "lambert + ggx", starts=1)
    assert not result.exact and any("no more readings than free numbers" in n for n in result.notes)
    assert all(p.status != "determined" and not p.standard_uncertainty > 0 for p in free(result).values())


def test_too_few_readings_are_refused_by_name():
    layout = layouts.scattered(*(np.array([0.1, 0.2]),) * 4)
    table = whole_table_of_values(layout, np.full((2, 1), 0.3), channels=Channels.grey())
    with pytest.raises(GonioError, match=r"3 free numbers.*ggx\.alpha.*2 valid readings"):
        fit(table, "lambert + ggx")
    empty = whole_table_of_values(layout, np.full((2, 1), np.nan))
    with pytest.raises(GonioError, match="no valid reading"):
        fit(empty, "lambert")


def test_a_model_without_a_finite_value_is_refused():
    layout = layouts.in_plane(np.radians([10, 40]), np.radians([-30, 30]))
    masked_beyond_all_numbers = "1 * sgd(alpha=?, p=0.5, kappa=10, f0=0.5, f1=0, lam=3, c=1e120, k=15, theta_0=0)"
    with pytest.raises(GonioError, match="no finite value at any start"):
        fit(whole_table_of_values(layout, np.full(layout.shape, 0.1)), masked_beyond_all_numbers, loss="linear")
