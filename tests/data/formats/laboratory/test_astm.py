"""ASTM text: made here row by row from a closed form, in each of the variants that laboratories write."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.data.flags import Flag
from gonio.data.formats.registry import read, write
from gonio.data.table import Table
from gonio.models.errors import GonioError
from support.closed_form import anisotropic, isotropic, largest_error, pairs, vector


def text(names, columns, header="DATE today\nNUM_POINTS 3\n", end="\n"):
    rows = [",".join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    return (header + "\n".join([f"VARS {names}", *rows]) + "\n").replace("\n", end)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("names", "channels"),
    [("R,G,B", ("R", "G", "B")), ("X,Y,Z", ("X", "Y", "Z")), ("400nm,550.5nm", ("400 nm", "550.5 nm"))],
)
def test_four_angles_and_channels_as_cornell_names_them(tmp_path, names, channels, end):
    angles = pairs(20, 0)
    f = anisotropic(vector(*angles[:2]), vector(*angles[2:]))
    columns = [*angles, *(f * (k + 1) for k in range(len(channels)))]
    (tmp_path / "a.astm").write_text(text(f"theta_i,phi_i,theta_s,phi_s,{names}", columns, end=end), newline="")
    table = read(tmp_path / "a.astm")
    assert table.channels.names == channels and table.layout.name == "scattered"
    assert largest_error(table, anisotropic) < 1e-12
    assert table.provenance["header"]["DATE"] == "today"


def test_three_angles_are_of_an_isotropic_surface_and_rows_of_a_grid_become_one(tmp_path):
    axes = [10, 40], [5, 25, 60], [0, 90, 180, 270]
    theta_i, theta_s, phi_s = (np.radians(a.ravel()) for a in np.meshgrid(*axes))
    f = isotropic(vector(theta_i, 0 * theta_i), vector(theta_s, phi_s))
    made = text("theta_i,theta_s,phi_s,Integrated", [np.round(a, 7) for a in (theta_i, theta_s, phi_s)] + [f])
    (tmp_path / "three.txt").write_text(made)
    table = read(tmp_path / "three.txt")
    assert (table.layout.name, table.layout.shape) == ("isotropic", (2, 3, 4))
    assert largest_error(table, isotropic) < 1e-6


def test_repeats_are_kept_or_averaged_and_said_and_negative_readings_stay(tmp_path):
    grid = np.array([(a, 0.0, b, np.pi) for a in (0.1, 0.5, 0.9) for b in (0.1, 0.5, 0.9)])
    columns = [*np.vstack([grid, grid[:1]]).T, [*np.full(9, 0.25), -0.75]]
    (tmp_path / "grid.astm").write_text(text("theta_i,phi_i,theta_s,phi_s,Integrated", columns))
    table = read(tmp_path / "grid.astm")
    assert np.isclose(table.f, -0.25).sum() == 1 and any(
        "repeat a direction" in s for s in table.provenance["understood"]
    )
    columns = [*np.repeat(grid[:2], 3, axis=0).T, [0.1, 0.2, 0.3, 0.4, 0.5, -0.6]]
    (tmp_path / "list.astm").write_text(text("theta_i,phi_i,theta_s,phi_s,Integrated", columns))
    assert sorted(read(tmp_path / "list.astm").f.ravel()) == [-0.6, 0.1, 0.2, 0.3, 0.4, 0.5]


def test_what_is_left_open_can_be_stated(tmp_path):
    angles = pairs(20, 1)
    turned = angles[0], angles[1], angles[2], angles[3] + np.pi
    f = np.pi * isotropic(vector(*angles[:2]), vector(*angles[2:]))
    made = text("theta_i,phi_i,theta_s,phi_s,Integrated", [*np.degrees(turned), f])
    (tmp_path / "a.astm").write_text(made)
    with pytest.raises(GonioError, match="state --angles degrees"):
        read(tmp_path / "a.astm")
    table = read(tmp_path / "a.astm", angles="degrees", quantity="reflectance_factor", mirror_azimuth=0)
    assert largest_error(table, isotropic) < 1e-9


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        ("VARS theta_i,phi_i,theta_s,R\n0,0,0,1\n", "expected theta_i, phi_i, theta_s, phi_s"),
        ("VARS theta_i,phi_i,theta_s,phi_s\n0,0,0,0\n", "one name for each channel"),
        ("VARS theta_i,phi_i,theta_s,phi_s,R\n0,0,0,1\n", "line 2: 4 columns, expected 5"),
        ("VARS theta_i,phi_i,theta_s,phi_s,R\n0,0,0,0,x\n", "line 2: 'x' is no number"),
        ("VARS theta_i,phi_i,theta_s,phi_s,R\n", "no rows of readings"),
        ("VARS theta_i,phi_i,theta_s,phi_s,R\n0,nan,0,0,1\n", "row 1 of its readings"),
    ],
)
def test_what_is_no_reading_is_refused_in_a_sentence(tmp_path, made, expected):
    (tmp_path / "bad.astm").write_text(made)
    with pytest.raises(GonioError, match=expected):
        read(tmp_path / "bad.astm")


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), channels=st.integers(1, 4))
def test_written_and_read_again_it_is_the_same(tmp_path_factory, seed, channels):
    rng, path = np.random.default_rng(seed), tmp_path_factory.mktemp("astm") / "t.astm"
    theta_i, phi_i, theta_o, phi_o = pairs(6, seed)
    names = [f"c {k}" for k in range(channels)]
    table = Table.from_arrays(theta_i, phi_i, theta_o, phi_o, rng.normal(size=(6, channels)), channels=names)
    table.flag[0] = Flag.SATURATED
    report = write(path, table)
    assert (report.max_absolute, report.lost, report.compared) == (0, 0, 5 * channels)
    again = read(path)
    assert np.array_equal(again.f, table.f[1:]) and (again.flag == Flag.VALID).all()
    assert np.allclose(again.layout.angles(), [a[1:] for a in table.layout.angles()], rtol=0, atol=1e-15)


def test_channels_that_the_file_names_otherwise_are_told(tmp_path):
    names = ["é", "ü"]
    table = Table.from_arrays(0.1, 0, [0.2, 0.3], 1, [[0.1, 0.2], [0.3, 0.4]], channels=names)
    report = table.save(tmp_path / "a.astm")
    assert read(tmp_path / "a.astm").channels.names == ("channel_1", "channel_2")
    assert "é, ü are named channel_1, channel_2 there" in str(report)
