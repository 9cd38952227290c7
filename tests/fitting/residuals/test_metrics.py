"""Distances between a model and readings: closed forms."""

import numpy as np
import pytest

from gonio.fitting.problem.readings import Readings
from gonio.fitting.residuals import metrics as metrics_module
from gonio.fitting.residuals.metrics import metrics
from gonio.models.geometry.directions import from_spherical


def test_a_model_that_is_brighter_by_a_factor():
    rng = np.random.default_rng(0)
    wi, wo = (from_spherical(rng.uniform(0, 1.4, 500), np.zeros(500)) for _ in range(2))
    y = rng.uniform(0.1, 2.0, (500, 3))
    valid = rng.random(y.shape) < 0.9
    values = metrics(1.2 * y, Readings(wi, wo, np.where(valid, y, np.nan), np.zeros_like(y), valid))
    for name in ("relative_rms", "relative_rms_cosine", "median_relative"):
        assert values[name] == pytest.approx(0.2)
    assert values["bias"] == pytest.approx(0.2 * y[valid].mean())
    assert values["log_rms"] == pytest.approx(np.sqrt(np.mean(np.log((1 + 1.2 * y) / (1 + y))[valid] ** 2)))
    cbrt = np.cbrt(y * np.asarray(wi.z)[:, None])[valid]
    assert values["cbrt_rms"] == pytest.approx((np.cbrt(1.2) - 1) * np.sqrt(np.mean(cbrt**2)))


def test_dark_readings_have_no_relative_error():
    up = from_spherical(np.zeros(2), np.zeros(2))
    dark = Readings(up, up, np.zeros((2, 1)), np.zeros((2, 1)), np.ones((2, 1), bool))
    values = metrics(np.ones((2, 1)), dark)
    assert np.isnan(values["relative_rms"]) and np.isnan(values["median_relative"]) and values["bias"] == 1.0


@pytest.mark.parametrize("size", [1000, 1001])
def test_the_median_of_very_many_is_that_of_all_of_them(size):
    numbers = np.abs(np.random.default_rng(size).standard_normal(size))
    for bracket in (None, (0.5, 0.9)):
        median = metrics_module._Median(bracket)
        for part in np.array_split(numbers, 7):
            median.add(part)
        assert not median.missed and median.value() == pytest.approx(np.median(numbers), rel=1e-6)
    outside = metrics_module._Median((2.0, 3.0))
    outside.add(numbers)
    assert outside.missed


def test_a_bracket_that_misses_the_median_changes_nothing(monkeypatch):
    rng = np.random.default_rng(0)
    wi, wo = (from_spherical(rng.uniform(0, 1.4, 500), np.zeros(500)) for _ in range(2))
    y = rng.uniform(0.1, 2.0, (500, 3))
    model, readings = (
        y * rng.uniform(0.5, 1.5, y.shape),
        Readings(wi, wo, y, np.zeros_like(y), rng.random(y.shape) < 0.9),
    )
    usual = metrics(model, readings)
    monkeypatch.setattr("gonio.fitting.problem.readings.CHUNK", 300)  # several pieces
    assert metrics(model, readings) == pytest.approx(usual, rel=1e-12)
    monkeypatch.setattr(metrics_module, "BRACKETED", 100)
    assert metrics(model, readings) == pytest.approx(usual, rel=1e-12)
    monkeypatch.setattr(metrics_module, "MANY", 100)
    assert metrics(model, readings) == pytest.approx(usual, rel=1e-6)
    monkeypatch.setattr(metrics_module, "BRACKET", (0.9, 0.95))
    assert metrics(model, readings) == pytest.approx(usual, rel=1e-6)
