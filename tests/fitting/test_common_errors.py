"""A gain or a dark signal that all readings share moves a fit as far as it says; what nothing states is said."""

import dataclasses

import numpy as np
import pytest

import gonio
from gonio.data.layouts import isotropic
from gonio.data.table import Table, whole_table_of_values
from gonio.fitting.judgement import judge_fit

MODEL = "lambert + ggx"
LAYOUT = isotropic(np.radians([0, 30, 60]), np.radians(np.arange(0, 81, 10)), np.radians(np.arange(0, 360, 30)))


def table(change: dict[str, float], instrument: object = None) -> Table:
    """Readings with 2 % of noise and errors that all of them share."""
    angles = LAYOUT.angles()
    f = gonio.material("lambert(rho=0.3) + 0.4 * ggx(alpha=0.2)").f(*angles)[..., 0]
    u = 0.02 * f
    f = f + u * np.random.default_rng(1).standard_normal(f.shape)
    f = (1 + change.get("gain", 0.0)) * f + change.get("dark", 0.0) / (np.pi * np.cos(angles[0]))
    read = whole_table_of_values(LAYOUT, f.reshape(LAYOUT.shape), u_f=u.reshape(*LAYOUT.shape, 1))
    return dataclasses.replace(read, provenance={} if instrument is None else {"instrument": instrument})


@pytest.mark.parametrize("loss", [None, "log"])
def test_a_refit_moves_as_far_as_predicted(loss: str | None) -> None:
    before = gonio.fit(table({}), MODEL, loss=loss)
    assert {row["name"] for row in before.common_errors} == {"gain", "dark"}
    for row in before.common_errors:
        after = gonio.fit(table({row["name"]: row["equal"]}), MODEL, loss=loss)
        (old,), (new,) = ([p for p in r.parameters if p.label == row["number"]] for r in (before, after))
        assert (new.value - old.value) / old.standard_uncertainty == pytest.approx(1.0, abs=0.02)


def test_what_nothing_states_is_said_in_the_verdict_and_in_a_note() -> None:
    result = gonio.fit(table({}), MODEL)
    assert result.judgement.verdict == "good" and "which nothing states" in result.judgement.sentence
    assert any("--nuisance" in note and "gain=1 %" in note for note in result.notes)


def test_a_stated_calibration_that_the_uncertainties_leave_out_is_a_fault_until_it_is_fitted() -> None:
    calibrated = table({}, {"calibration": 0.005, "photons": 1e6})
    result = gonio.fit(calibrated, MODEL)
    assert result.judgement.verdict == "fair" and "± 0.5 % moves" in result.judgement.sentence
    held = gonio.fit(calibrated, MODEL, nuisance="gain")
    assert held.judgement.verdict == "good" and not held.common_errors


def test_a_drift_below_the_noise_is_told_by_its_size_and_by_what_it_moves() -> None:
    """Readings that grow by 5 % from the first to the last, in noise of 2 %."""
    steady, moved = table({}, "ideal"), table({}, "ideal")
    grown = 1 + 0.05 * np.linspace(-0.5, 0.5, moved.f.size).reshape(moved.f.shape)
    moved = dataclasses.replace(moved, f=moved.f * grown)
    (row,) = gonio.fit(moved, MODEL).common_errors
    assert row["name"] == "drift" and row["stated"] == pytest.approx(0.05, rel=0.3)
    before, after = (gonio.fit(t, MODEL) for t in (steady, moved))
    (old,), (new,) = ([p for p in r.parameters if p.label == row["number"]] for r in (before, after))
    off = abs(new.value - old.value) / new.standard_uncertainty
    assert off == pytest.approx(row["stated"] / row["equal"], rel=0.3)
    judged = after.judgement
    assert judged.verdict == "fair" and "drift that the residuals show from the first reading" in judged.sentence


@pytest.mark.parametrize("instrument", ["ideal", {"photons": 1e6}])
def test_an_instrument_without_such_errors_leaves_nothing_out(instrument: object) -> None:
    assert gonio.fit(table({}, instrument), MODEL).common_errors == []


@pytest.mark.parametrize("row", [{"name": "dark"}, {"name": "gain", "meaning": "", "number": "", "equal": 0.0}])
def test_a_row_of_a_file_that_lacks_something_says_nothing(row: dict[str, object]) -> None:
    assert judge_fit({"converged": True, "common_errors": [row]}).sentence == "A good fit: it converged."
