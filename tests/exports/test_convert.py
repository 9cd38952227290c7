"""`gonio.convert`: subjects of every kind into files, in the format of the ending."""

import numpy as np
import pytest

import gonio


def test_a_model_becomes_a_merl_file_and_that_a_table_again(tmp_path):
    trip = gonio.convert("lambert(rho=0.5)", tmp_path / "m.binary")
    assert trip.lost == 0 and trip.max_relative < 1e-12
    gonio.convert(tmp_path / "m.binary", tmp_path / "m.h5")
    table = gonio.open(tmp_path / "m.h5")
    np.testing.assert_allclose(table.samples(limit=100).f, 0.5 / np.pi)


def test_a_model_is_no_table_of_readings(tmp_path):
    with pytest.raises(gonio.GonioError, match="measure it first"):
        gonio.convert("gold", tmp_path / "m.h5")
    with pytest.raises(gonio.GonioError, match=r"give \.h5"):
        gonio.convert("gold", tmp_path / "m.xyz")
    with pytest.raises(gonio.GonioError, match="no option 'channel_bytes'"):
        gonio.convert(gonio.material("gold"), tmp_path / "m.binary", channel_bytes=16384)


def test_a_format_is_named_where_endings_leave_it_open(tmp_path):
    table = gonio.Table.from_arrays(30, 0, [0.0, 20.0], 180, [0.1, 0.2], degrees=True, name="two")
    gonio.convert(table, tmp_path / "two.csv", to="CSV")
    assert gonio.open(tmp_path / "two.csv").name == "two"
    with pytest.raises(gonio.GonioError, match="nothing is written for 'vsc'"):
        gonio.convert(table, tmp_path / "two.vsc", to="vsc")
    with pytest.raises(gonio.GonioError, match=r"ends in '.txt'; CSV .* ends in \.csv"):
        gonio.convert(table, tmp_path / "two.txt", to="csv")
    with pytest.raises(gonio.GonioError, match=r"two has no ending; CSV .* ends in \.csv"):
        gonio.convert(table, tmp_path / "two", to="csv")
    with pytest.raises(gonio.GonioError, match=r"two has no ending; a file for Mitsuba 3 ends in \.xml or \.json"):
        gonio.convert("lambert(rho=0.2)", tmp_path / "two", to="mitsuba")
    with pytest.raises(gonio.GonioError, match=r"two has no ending; give \.h5"):
        gonio.convert(table, tmp_path / "two")
