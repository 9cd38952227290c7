"""Tables of both sides of a sample: their parts, their files, and what lies between and beyond their readings."""

import math

import h5py
import numpy as np
import pytest

from gonio.data import Table, layouts, read
from gonio.data.flags import Flag
from gonio.data.interpolation.coverage import covered
from gonio.data.interpolation.multilinear import as_material
from gonio.data.subject import load_material
from gonio.data.table import whole_table_of_values
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical
from gonio.models.geometry.sides import FRONT, Hemispheres

FRONT_TO_BOTH = np.radians([0.0, 40.0, 80.0]), np.radians([0.0, 45.0, 80.0, 100.0, 135.0, 180.0])
AZIMUTH = np.radians([0.0, 90.0, 180.0, 270.0])


def grid_table():
    """f is 1 in front and 5 behind, a node on the horizon apart."""
    theta_i, theta_o = FRONT_TO_BOTH
    grid = layouts.isotropic(theta_i, np.sort(np.append(theta_o, np.pi / 2)), AZIMUTH)
    return whole_table_of_values(grid, np.where(grid.cosines()[1] > 0, 1.0, 5.0).reshape(grid.shape))


def list_table(theta_o):
    theta_i = np.radians(np.tile([10.0, 50.0], 20))
    angles = theta_i, 0.0, np.linspace(*theta_o, 40), np.linspace(0, 6, 40)
    return Table.from_arrays(*angles, np.where(angles[2] < np.pi / 2, 1.0, 5.0))


def test_a_table_tells_which_hemispheres_it_holds():
    table = grid_table()
    assert table.hemispheres == Hemispheres.REFLECTION | Hemispheres.TRANSMISSION
    assert table.sides == {(1, 1), (1, -1)} and table.facts()["sides"] == "reflection and transmission"
    assert table.counts()["below_horizon"] == 3 * 4
    parts = table.parts()
    assert list(parts) == [(1, 1), (1, -1)] and {float(np.unique(p.f)[0]) for p in parts.values()} == {1.0, 5.0}
    assert sum(p.counts()["valid"] for p in parts.values()) == table.counts()["valid"]
    # What a warp carried below the horizon is flagged so, and no transmission.
    table.flag[table.layout.cosines()[1].reshape(table.layout.shape) < 0] = Flag.BELOW_HORIZON
    assert table.sides == FRONT and table.parts() == {(1, 1): table}


def test_valid_cells_within_an_angle_are_counted_from_the_normal_of_their_side():
    table = grid_table()
    theta_o = table.layout.angles()[2][table.valid_cells(theta_max=math.radians(60))]
    assert set(np.degrees(theta_o).round()) == {0.0, 45.0, 135.0, 180.0}


@pytest.mark.parametrize("suffix", [".h5", ".csv"])
def test_files_keep_both_sides(tmp_path, suffix):
    table = grid_table()
    trip = table.save(tmp_path / f"t{suffix}")
    again = read(tmp_path / f"t{suffix}")
    assert trip.lost == 0 and again.layout == table.layout and again.sides == table.sides
    np.testing.assert_array_equal(again.flag, table.flag)
    np.testing.assert_array_equal(again.f, table.f)


def test_other_programs_see_the_angles_behind_the_sample(tmp_path):
    xarray = pytest.importorskip("xarray")
    path = tmp_path / "t.h5"
    grid_table().save(path)
    with h5py.File(path) as file:
        assert math.degrees(file["theta_o"][-1]) == pytest.approx(180)
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        behind = data.f.where(data.theta_o > np.pi / 2, drop=True)
        assert set(np.unique(behind)) == {5.0} and data.flag.attrs["flag_meanings"].split()[1] == "below_horizon"
    assert Table.from_xarray(grid_table().to_xarray()).sides == {(1, 1), (1, -1)}


def test_a_list_beyond_90_degrees_is_read_behind_the_sample_and_says_so(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("theta_i,phi_i,theta_o,phi_o,f\n10,0,20,180,0.3\n10,0,170,180,0.6\n10,0,-160,0,0.5\n")
    table = read(path)
    assert table.sides == {(1, 1), (1, -1)} and table.counts()["valid"] == 3
    assert "the detector is behind the sample, beyond 90° from its normal, in 2 rows" in table.provenance["understood"]
    np.testing.assert_allclose(np.degrees(table.layout.angles()[3][2]), 180.0)  # signed, as in front


@pytest.mark.parametrize("table", [grid_table(), list_table([0.1, 3.0])], ids=["grid", "list"])
def test_nothing_is_interpolated_across_the_horizon(table):
    """R and T are constants: everything between their readings is one of them, however near to the horizon."""
    theta_o = np.radians([0.0, 60.0, 84.0, 89.9, 90.1, 96.0, 120.0, 180.0])
    wi, wo = from_spherical(np.full(8, 0.4), np.zeros(8), np), from_spherical(theta_o, np.full(8, 0.5), np)
    f = np.asarray(evaluate(as_material(table), wi, wo))[:, 0]
    np.testing.assert_allclose(f, [1.0] * 4 + [5.0] * 4, rtol=1e-12)


def test_what_was_not_looked_at_is_zero_as_below_the_horizon_of_reflection():
    behind = np.radians([100.0, 140.0, 180.0])
    grid = layouts.isotropic(FRONT_TO_BOTH[0], behind, AZIMUTH)
    material = load_material(whole_table_of_values(grid, np.full(grid.shape, 5.0)))
    assert material.brdf.hemispheres == Hemispheres.TRANSMISSION
    theta_i, theta_o = np.radians([[30, 30, 150, 150], [30, 150, 30, 150]])
    np.testing.assert_allclose(material.f(theta_i, 0.0, theta_o, 0.3)[:, 0], [0, 5, 0, 0], rtol=1e-15)


def test_coverage_is_of_each_side_by_itself():
    theta_o = np.radians([30.0, 87.0, 93.0, 150.0])
    wi, wo = from_spherical(np.full(4, 0.4), np.zeros(4), np), from_spherical(theta_o, np.full(4, 1.0), np)
    assert covered(grid_table(), wi, wo).tolist() == [True, False, False, True]
    front, _ = grid_table().parts().values()
    assert covered(front, wi, wo).tolist()[0] and not covered(front, wi, wo)[1:].any()
