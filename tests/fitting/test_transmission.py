"""Fits to readings behind a sample: exact numbers back, and what does not fit there is refused."""

import math

import pytest

import gonio
from gonio.instrument import scans
from gonio.instrument.instrument import Instrument
from gonio.models.errors import GonioError

STEP = math.radians(20)


@pytest.fixture(scope="module")
def sheet():
    grid = scans.isotropic(STEP, hemisphere="both")
    return gonio.measure("thin_sheet(rho=0.3, tau=0.5)", Instrument(photons=1e5), grid, seed=1)


def test_what_a_sheet_reflects_and_transmits_is_found(sheet):
    """f is a sum of what is proportional to each of two albedos, and so proportional to neither."""
    r = gonio.fit(sheet, "thin_sheet")
    assert r.converged and [p.value for p in r.parameters] == pytest.approx([0.3, 0.5], abs=0.002)
    assert r.metrics["reduced_chi2"] == pytest.approx(1, abs=0.1)
    assert r.metrics["largest_albedo"] == pytest.approx(0.8, abs=0.003)


def test_discs_behind_are_averaged_as_in_front():
    """Seen through discs near the horizon, the model's averages are those of the readings: no error is left."""
    instrument = Instrument(source_half_angle=0.1, detector_half_angle=0.15)
    grid = scans.isotropic(STEP, hemisphere="transmission", lit="back")
    table = gonio.measure("lambert_transmission(tau=0.5)", instrument, grid)
    r = gonio.fit(table, "lambert_transmission")
    assert r.parameters[0].value == pytest.approx(0.5, rel=1e-9) and r.metrics["relative_rms"] < 1e-9


def test_a_model_that_is_dark_where_the_table_is_not_is_refused(sheet):
    with pytest.raises(GonioError, match="scatters nothing in transmission, where the table has"):
        gonio.fit(sheet, "lambert")
    with pytest.raises(GonioError, match="a model is selected for that alone; give one"):
        gonio.fit(sheet)
    with pytest.raises(GonioError, match="scenes weigh that alone"):
        gonio.fit(sheet, "thin_sheet", scene="matte_room")
