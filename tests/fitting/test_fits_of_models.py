"""Fits of models inside models, and of models with many parameters: what made the data comes back."""

import pytest

from gonio.fitting.fit_table import fit
from gonio.stability.problems import COARSEST, RECOVERIES, tagged, true_numbers
from support.fit_tables import table_of
from support.scans import layout_of, table_of_problem

LONG = ("he_torrance", "coat over a sum")
"""Problems whose programs take longest to compile."""


@pytest.mark.parametrize(
    "problem",
    [
        pytest.param(p, marks=pytest.mark.thorough if p.name in LONG else (), id=p.name)
        for p in tagged(RECOVERIES, "exact")
    ],
)
def test_the_parameters_come_back(problem):
    result = fit(table_of_problem(problem, 0), problem.model)
    assert result.converged and result.exact
    answers = true_numbers(problem.measured)
    estimates = {p.label: p for p in result.parameters if p.status != "fixed"}
    assert {n: p.value for n, p in estimates.items()} == pytest.approx({n: answers[n] for n in estimates}, rel=1e-9)
    assert all(p.status == "determined" for p in estimates.values())


def test_what_sgd_cannot_know_is_said():
    """Masked by 1 % at 60° and 9 % at 75°: D and F come back; of G₁'s numbers, which trade, none is claimed falsely."""
    truth = {"alpha": 0.05, "p": 0.6, "kappa": 20, "f0": 0.05, "f1": 0.02}
    fixed = ", ".join(f"{k}={v}" for k, v in truth.items())
    sgd = f"sgd({fixed}, lam=2, c=0.01, k=8, theta_0=0.1)"
    result = fit(table_of(sgd, layout_of(COARSEST)), "1 * sgd")
    estimates = {p.name: p for p in result.parameters}
    for name, value in truth.items():
        assert estimates[f"sgd.{name}"].value == pytest.approx(value, rel=1e-2), name
    assert {n for n in ("lam", "c") if estimates[f"sgd.{n}"].status == "undetermined"} == {"lam", "c"}
    assert any("combination sgd.c·sgd.lam" in sentence for sentence in result.undetermined)
