"""MERL files, made here by the format's definition alone; headers that lie."""

import struct

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.formats.merl import read_merl, write_merl
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError

SCALE = np.array([1.0, 1.15, 1.66]) / 1500


def raw_file(path, counts, planes):
    path.write_bytes(struct.pack("<3i", *counts) + np.asarray(planes, "<f8").tobytes())
    return path


class Smooth(AbstractBRDF):
    """Reciprocal, isotropic, three channels, cheap."""

    def formula(self, wi, wo):
        import jax.numpy as jnp

        plane = wi.x * wo.x + wi.y * wo.y
        return jnp.stack([0.3 + 0.1 * plane, 0.2 + 0.1 * wi.z * wo.z, 0.1 + 0.05 * (wi.z + wo.z)])


def test_a_file_made_by_the_definition_is_read_by_it(tmp_path):
    counts = (5, 6, 8)
    raw = np.random.default_rng(0).random((3, *counts))
    raw[1, 0, 0, 3] = -1.0
    raw[2, 4, 5, 4] = np.nan
    table = read_merl(raw_file(tmp_path / "m.binary", counts, raw))
    assert table.layout.dims == ("theta_h", "theta_d", "phi_d") and table.layout.shape == counts
    np.testing.assert_allclose(np.degrees(table.layout.axes["theta_h"]), (np.arange(5) / 5) ** 2 * 90)
    above = table.layout.readable().reshape(counts)
    valid = np.moveaxis(raw >= 0, 0, -1) & above[..., None]
    np.testing.assert_array_equal(table.flag == Flag.VALID, valid)
    np.testing.assert_allclose(table.f[valid], (np.moveaxis(raw, 0, -1) * SCALE)[valid], rtol=1e-15)
    assert table.flag[0, 0, 3, 1] == Flag.NOT_MEASURED and np.isnan(table.f[0, 0, 3, 1])
    assert (table.flag[~above] == Flag.BELOW_HORIZON).all() and not above.all()
    assert table.provenance["nodes"] == "lower" and "below the horizon" in table.provenance["assumptions"][1]
    centre = read_merl(tmp_path / "m.binary", nodes="centre")
    assert centre.provenance["nodes"] == "centre" and centre.layout == layouts.merl("centre", counts)


def test_a_full_circle_of_phi_d_is_told_by_its_count(tmp_path):
    table = read_merl(raw_file(tmp_path / "m.binary", (2, 2, 360), np.ones((3, 2, 2, 360))))
    np.testing.assert_allclose(np.degrees(table.layout.axes["phi_d"]), np.arange(360))


def test_merls_own_size_is_written_and_read_again(tmp_path):
    grid = layouts.merl()
    f = grid_values(Smooth(), grid)
    trip = write_merl(tmp_path / "m.binary", whole_table_of_values(grid, f))
    assert (tmp_path / "m.binary").stat().st_size == 34_992_012
    assert trip.max_relative < 1e-15 and trip.lost == 0 and trip.compared == 3 * 1_111_430
    raw = np.fromfile(tmp_path / "m.binary", "<f8", offset=12).reshape(3, 90, 90, 180)
    np.testing.assert_allclose(raw[2, 30, 20, 70] * 1.66 / 1500, f[30, 20, 70, 2], rtol=1e-15)
    assert np.fromfile(tmp_path / "m.binary", "<i4", 3).tolist() == [90, 90, 180] and raw[0, 89, 89, 0] < 0


def test_other_layouts_and_models_are_resampled_and_the_loss_measured(tmp_path):
    grid = layouts.isotropic(
        np.linspace(0, 1.5, 12), np.linspace(0, 1.5, 12), np.linspace(0, 2 * np.pi, 24, endpoint=False)
    )
    table = whole_table_of_values(grid, grid_values(Smooth(), grid))
    trip = write_merl(tmp_path / "a.binary", table)
    assert 1e-6 < trip.rms_relative < 0.02 and "isotropic" in trip.note
    assert write_merl(tmp_path / "b.binary", Smooth()).max_relative < 1e-15
    read = read_merl(tmp_path / "b.binary")
    np.testing.assert_allclose(read.f[40, 20, 60], grid_values(Smooth(), layouts.merl())[40, 20, 60], rtol=1e-14)


def test_negative_readings_are_counted_as_lost_and_grey_is_repeated(tmp_path):
    grid = layouts.merl(counts=(3, 4, 6))
    table = whole_table_of_values(grid, -np.ones(grid.shape))
    assert write_merl(tmp_path / "m.binary", table).lost == 3 * grid.readable().sum()
    read = read_merl(tmp_path / "m.binary")
    assert read.flag[0, 0, 0, 0] == Flag.NOT_MEASURED and len(read.channels) == 3
    with pytest.raises(GonioError, match="choose one or three"):
        write_merl(tmp_path / "n.binary", whole_table_of_values(grid, np.ones((*grid.shape, 4))))
    few = layouts.in_plane(np.radians([10.0, 30]), np.radians([-40.0, 0, 40]))
    with pytest.raises(GonioError, match="there are 401 channels"):  # not after a million cells of each
        write_merl(tmp_path / "n.binary", whole_table_of_values(few, np.ones((*few.shape, 401))))
    with pytest.raises(GonioError, match="--force"):
        write_merl(tmp_path / "m.binary", table)
    with pytest.raises(GonioError, match="nodes 'upper'"):
        read_merl(tmp_path / "m.binary", nodes="upper")


@pytest.mark.parametrize(
    "counts",
    [(90, 90, 180), (2, 2, 3), (0, 2, 4), (-2, -2, 4), (-1, -1, -1), (2**31 - 1,) * 3, (1 << 16, 1 << 16, 1 << 16)],
)
def test_a_header_that_lies_about_its_sizes_is_refused(tmp_path, counts):
    path = raw_file(tmp_path / "m.binary", counts, np.ones((3, 2, 2, 4)))
    with pytest.raises(GonioError, match="does not fit its 396 bytes"):
        read_merl(path)
    path.write_bytes(b"\0" * 5)
    with pytest.raises(GonioError, match="claims nothing"):
        read_merl(path)
