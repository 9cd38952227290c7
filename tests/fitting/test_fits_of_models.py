"""Fits of models inside models, and of models with many parameters: what made the data comes back."""

import numpy as np
import pytest

from gonio.data import layout as layouts
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.fitting.fit_table import fit
from gonio.models.expression.builder import build

THETA = np.radians(np.arange(0, 76, 15.0))
GRID = layouts.isotropic(THETA, THETA, np.radians(np.arange(0, 360, 30.0)))
CASES = {
    "coat over a sum": (
        "coat(base=lambert(rho=0.6) + 0.3 * ggx(alpha=0.3), alpha=0.1, eta=1.5)",
        "coat(base=lambert + ggx, eta=1.5)",
        {"coat.alpha": 0.1, "coat.base.lambert.rho": 0.6, "coat.base.ggx.alpha": 0.3, "coat.base.ggx.scale": 0.3},
    ),
    "hapke": (
        "hapke(w=0.6, b=0.3, c=0.4, b0=0.8, h=0.06)",
        "hapke",
        {"hapke.w": 0.6, "hapke.b": 0.3, "hapke.c": 0.4, "hapke.b0": 0.8, "hapke.h": 0.06},
    ),
    "he_torrance": (
        "0.5 * he_torrance(sigma=0.2, tau=3, wavelength=0.55, form=westin)",
        "he_torrance(wavelength=0.55, form=westin)",
        {"he_torrance.sigma": 0.2, "he_torrance.tau": 3, "he_torrance.scale": 0.5},
    ),
}


def table_of(expression):
    return whole_table_of_values(GRID, grid_values(build(expression), GRID))


@pytest.mark.parametrize("name", CASES)
def test_the_parameters_come_back(name):
    expression, model, truth = CASES[name]
    result = fit(table_of(expression), model)
    assert result.converged and result.exact
    found = {p.name: p.value for p in result.parameters if p.status != "fixed"}
    assert found == pytest.approx(truth, rel=1e-9)
    assert all(p.status == "determined" for p in result.parameters if p.name in truth)


def test_what_sgd_cannot_know_is_said():
    """Masked by 1 % at 60° and 9 % at 75°: D and F come back; of G₁'s numbers, which trade, none is claimed falsely."""
    truth = {"alpha": 0.05, "p": 0.6, "kappa": 20, "f0": 0.05, "f1": 0.02}
    said = ", ".join(f"{k}={v}" for k, v in truth.items())
    result = fit(table_of(f"sgd({said}, lam=2, c=0.01, k=8, theta_0=0.1)"), "1 * sgd")
    found = {p.name: p for p in result.parameters}
    for name, value in truth.items():
        assert found[f"sgd.{name}"].value == pytest.approx(value, rel=1e-2), name
    assert not result.converged or all(found[f"sgd.{n}"].status == "determined" for n in ("lam", "c", "theta_0"))
