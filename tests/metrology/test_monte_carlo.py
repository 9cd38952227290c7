"""Monte Carlo of a budget: it gives distributions that are known, and sees where the linear budget does not hold."""

import math

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.instrument import Instrument, measure
from gonio.instrument.scans import scan
from gonio.metrology.quantities import quantities
from gonio.models.errors import GonioError


@pytest.fixture(scope="module")
def one():
    return gonio.Table.from_arrays([45, 0], 0, [0, 45], 0, [0.2, 0.2], degrees=True, u_f=[0.001, 0.001])


def draws_of(table, stated, **options):
    b = quantities(table, budget=True, only=["reflectance"], uncertainty=stated, monte_carlo=2000, **options).budget
    return b, b.simulated


def test_normal_errors_come_out_as_the_linear_budget_says(one):
    b, s = draws_of(one, {"gain": "1 %", "solid_angle": "0.5 %"})
    assert s["standard_uncertainty"] == pytest.approx(b.standard, rel=0.05) and s["linear_agrees"].all()
    assert s["interval_95.45_percent"][:, 1] == pytest.approx(2 * b.standard, rel=0.12)
    again = quantities(
        one, budget=True, only=["reflectance"], uncertainty={"gain": "1 %", "solid_angle": "0.5 %"}, monte_carlo=2000
    )
    assert again.budget.simulated["shift"] == pytest.approx(s["shift"], abs=0)


def test_one_rectangular_error_is_held_by_less_than_two_standard_uncertainties(one):
    b, s = draws_of(one, {"gain": "10 % rectangular"})
    assert s["standard_uncertainty"] == pytest.approx(b.standard, rel=0.05) and not s["linear_agrees"].any()
    assert s["interval_95.45_percent"][:, 1] == pytest.approx(math.sqrt(3) * 0.9545 * b.standard, rel=0.05)


def test_few_degrees_of_freedom_widen_as_students_law_does(one):
    b, s = draws_of(one, {"gain": "5 % dof 5"})
    assert b.dof == pytest.approx(5, rel=0.1) and b.factor == pytest.approx(2.65, abs=0.01)
    assert s["interval_95.45_percent"][:, 1] == pytest.approx(2.65 * b.standard, rel=0.15)


@pytest.mark.thorough
def test_fits_are_made_anew_and_tilt_widens_a_lobe_to_second_order():
    model = "lambert(rho=0.3) + 0.5 * ggx(alpha=0.2)"
    grid = scan("isotropic", step=math.radians(15), theta_max=math.radians(75))
    table = measure(model, Instrument(photons=1e6, misalignment=math.radians(0.5)), grid, seed=1)
    b = quantities(table, budget=True, only=["reflectance"], fit="lambert + ggx", monte_carlo=100, seed=2).budget
    alpha = b.size - 7
    assert b.simulated["standard_uncertainty"][alpha] == pytest.approx(b.standard[alpha], rel=0.4)
    assert b.simulated["shift"][alpha] > 0 and np.isfinite(b.simulated["interval_95.45_percent"]).all()


def test_bad_numbers_of_draws_are_refused(one, tmp_path, capsys):
    for draws in (10, -1, 10**9):
        with pytest.raises(GonioError, match="give from 100"):
            quantities(one, budget=True, only=["reflectance"], monte_carlo=draws)
    with pytest.raises(GonioError, match="ask for the budget"):
        quantities(one, monte_carlo=1000)
    one.save(tmp_path / "t.h5")
    assert main(["quantities", str(tmp_path / "t.h5"), "--monte-carlo", "100"]) == 2
    call = ["quantities", str(tmp_path / "t.h5"), "--budget", "--monte-carlo", "100", "--uncertainty", "gain=1 %"]
    assert main(call) == 0 and "Monte Carlo, 100 draws" in capsys.readouterr().out
