"""The report's section of where the uncertainty comes from: what the budget says, only where there is one."""

import math

import pytest

import gonio
from gonio.instrument import Instrument, measure
from gonio.instrument.scans import scan
from gonio.metrology.quantities import quantities
from gonio.reports.budget_section import budget_of
from gonio.reports.subject import assign_fits, fit_of, subject_of
from support.undrawn import undrawn

GRID = scan("isotropic", step=math.radians(15), theta_max=math.radians(75))
MATERIAL = "lambert(rho=[0.2, 0.4, 0.3]) + 0.3 * ggx(alpha=0.4)"


@pytest.fixture(scope="module")
def table():
    return measure(MATERIAL, Instrument(photons=1e6, calibration=0.01, misalignment=1e-3), GRID, seed=1)


@pytest.fixture(scope="module")
def section(table):
    subject = subject_of(table, 0)
    assign_fits([subject], [fit_of(gonio.fit(table, "lambert + ggx", starts=0))])
    return budget_of(subject)


def test_it_shows_the_middle_channel_with_the_numbers_of_the_fit(table, section):
    made = quantities(table, budget=True)
    k = next(k for k, q in enumerate(made.quantities) if (q.name, q.place, q.channel) == ("albedo", "θi 30°", "G"))
    row = next(r for r in section["rows"] if (r["name"], r["place"]) == ("albedo", "θi 30°"))
    assert row["value"] == made.quantities[k].value and row["expanded_uncertainty"] == pytest.approx(
        made.budget.expanded[k], rel=0.05
    )
    assert {"lambert.rho", "ggx.alpha", "albedo of the fit"} <= {r["name"] for r in section["rows"]}
    assert row["percent"][section["columns"].index("gain")] == pytest.approx(1, rel=1e-6)


def test_the_columns_make_up_the_whole(section):
    for row in section["rows"]:
        u = 100 * row["standard_uncertainty"] / abs(row["value"])
        assert math.hypot(*row["percent"]) == pytest.approx(u, rel=1e-3)
        assert row["percent"][row["largest"]] == max(row["percent"][:-1])


def test_a_table_that_knows_no_source_and_a_model_have_none(table):
    assert budget_of(subject_of(measure(MATERIAL, Instrument(), GRID), 0)) is None
    assert budget_of(subject_of(MATERIAL, 0)) is None
    with undrawn():
        page = gonio.report([table, MATERIAL], check=False)
    assert page.count("Where the uncertainty comes from") == 1
