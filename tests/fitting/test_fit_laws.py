"""Laws of fits: a change of the readings that physics or book-keeping allows changes a fit as it must."""

import dataclasses

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from support.fit_tables import free

MODEL = "lambert + ggx(f0=0.04)"
N = 400
RTOL = 1e-6  # of the numbers: an end is stationary to 1e-9


def angles():
    rng = np.random.default_rng(0)
    theta_i, theta_o = np.arccos(rng.uniform(0.2, 1.0, (2, N)))
    phi_i, phi_o = rng.uniform(0, 2 * np.pi, (2, N))
    # Half of them near the mirror direction, where the lobe is.
    phi_o[::2] = phi_i[::2] + np.pi + 0.1 * rng.standard_normal(N // 2)
    theta_o[::2] = np.clip(theta_i[::2] + 0.1 * rng.standard_normal(N // 2), 0, 1.4)
    return np.stack([theta_i, phi_i, theta_o, phi_o % (2 * np.pi)])


@pytest.fixture(scope="module")
def readings():
    layout = layouts.scattered(*angles())
    f = np.asarray(
        evaluate(build("lambert(rho=[.1,.2,.4]) + [.9,.7,.8]*ggx(alpha=.25, f0=0.04)"), *layout.directions())
    )
    return f * (1 + 0.03 * np.random.default_rng(1).standard_normal(f.shape))


def numbers_of(f, at=None, names=("R", "G", "B"), loss="cbrt"):
    table = whole_table_of_values(layouts.scattered(*(angles() if at is None else at)), f, channels=Channels(names))
    result = fit(table, MODEL, starts=2, loss=loss)
    assert result.converged
    return {name: p.value for name, p in free(result).items()}, result.cost


def test_a_brighter_surface_has_larger_albedos_and_scales_and_the_same_shape(readings):
    before, cost = numbers_of(readings)
    after, half = numbers_of(0.5 * readings)
    expected = {n: v if n == "ggx.alpha" else 0.5 * v for n, v in before.items()}
    assert after == pytest.approx(expected, rel=RTOL)
    assert half == pytest.approx(0.5 ** (2 / 3) * cost, rel=RTOL)  # of cube roots, whose floor scales too


def test_an_isotropic_model_does_not_see_a_turned_sample(readings):
    turned = angles()
    turned[1::2] = (turned[1::2] + 0.7) % (2 * np.pi)
    for changed, original in zip(numbers_of(readings, turned), numbers_of(readings), strict=True):
        assert changed == pytest.approx(original, rel=RTOL)


def test_channels_may_stand_in_any_order(readings):
    before, cost = numbers_of(readings)
    after, same = numbers_of(readings[:, [2, 0, 1]], names=("B", "R", "G"))
    assert after == pytest.approx(before, rel=RTOL) and same == pytest.approx(cost, rel=1e-9)


def test_readings_may_stand_in_any_order(readings):
    order = np.random.default_rng(2).permutation(N)
    for changed, original in zip(numbers_of(readings[order], angles()[:, order]), numbers_of(readings), strict=True):
        assert changed == pytest.approx(original, rel=RTOL)


def test_light_and_detector_may_change_places(readings):
    """For a reciprocal model, and a loss without cosθi."""
    exchanged = angles()[[2, 3, 0, 1]]
    before = numbers_of(readings, loss="linear")
    for changed, original in zip(numbers_of(readings, exchanged, loss="linear"), before, strict=True):
        assert changed == pytest.approx(original, rel=RTOL)


def test_a_reading_given_twice_counts_once(readings):
    twice = np.concatenate([angles(), angles()], axis=1)
    before, cost = numbers_of(readings)
    after, same = numbers_of(np.concatenate([readings, readings]), twice)
    assert after == pytest.approx(before, rel=RTOL) and same == pytest.approx(cost, rel=RTOL)


def test_uncertainties_follow_known_noise(readings):
    """σ twice as large: the same numbers, a quarter of the cost, and (JᵀJ)⁻¹ four times as large."""
    layout = layouts.scattered(*angles())
    table = whole_table_of_values(layout, readings, u_f=0.06 * np.abs(readings), channels=Channels.rgb())
    small, large = (fit(t, MODEL, starts=0) for t in (table, dataclasses.replace(table, u_f=2 * table.u_f)))
    assert large.cost == pytest.approx(small.cost / 4, rel=RTOL)
    for name, p in free(small).items():
        assert free(large)[name].value == pytest.approx(p.value, rel=RTOL)
        assert free(large)[name].standard_uncertainty == pytest.approx(2 * p.standard_uncertainty, rel=RTOL)
