"""UTIA's files: made here number by number from a closed form, in the order that the data base documents."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.formats.laboratory.utia import BYTES
from gonio.data.formats.registry import read, write
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError
from support.closed_form import anisotropic, largest_error, vector


def made(path, scale=1.0):
    """A file; the plane k is k + 1 times the first."""
    theta, phi = np.radians(np.arange(6) * 15), np.radians(np.arange(48) * 7.5)
    theta_i, phi_i, theta_v, phi_v = (a.ravel() for a in np.meshgrid(theta, phi, theta, phi, indexing="ij"))
    f = anisotropic(vector(theta_i, phi_i), vector(theta_v, phi_v)) / scale
    np.concatenate([f, 2 * f, 3 * f]).astype("<f8").tofile(path)
    return path


def test_every_number_is_where_its_directions_are_and_the_scale_is_stated(tmp_path):
    table = read(made(tmp_path / "m.bin", np.pi), scale=np.pi)
    assert table.layout.shape == (6, 48, 6, 48) and table.channels.names == ("R", "G", "B")
    for k in range(3):
        assert largest_error(table, lambda wi, wo, k=k: (k + 1) * anisotropic(wi, wo), k) < 1e-12
    assert any("--scale" in sentence for sentence in table.provenance["assumptions"])


def test_negative_numbers_are_readings_and_what_is_none_is_flagged(tmp_path):
    path = made(tmp_path / "m.bin")
    raw = np.fromfile(path, "<f8")
    raw[:2] = -0.25, np.nan
    raw.tofile(path)
    table = read(path)
    assert table.f[0, 0, 0, 0, 0] == -0.25 and table.flag[0, 0, 0, 1, 0] == Flag.INVALID


def test_a_table_on_its_grid_is_written_number_by_number(tmp_path):
    table = read(made(tmp_path / "m.bin"))
    report = write(tmp_path / "again.bin", table)
    assert (tmp_path / "again.bin").read_bytes() == (tmp_path / "m.bin").read_bytes()
    assert (report.max_absolute, report.lost) == (0, 0)


@settings(max_examples=4, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.integers(0, 2**32), st.floats(-3, 3).map(lambda x: 10**x), st.booleans())
def test_random_tables_are_the_same_after_writing_and_reading(tmp_path, seed, scale, gaps):
    """Values of both signs and many sizes, whatever the numbers' unit; the format has no sign for a gap."""
    rng = np.random.default_rng(seed)
    table = read(made(tmp_path / "m.bin"))
    lost = rng.random(table.f.shape) < 0.01 * gaps
    table.f = np.where(lost, np.nan, rng.lognormal(0, 8, table.f.shape) * rng.choice([-1, 1], table.f.shape))
    table.flag = np.where(lost, np.uint8(Flag.INVALID), np.uint8(Flag.VALID))
    report = write(tmp_path / "t.bin", table, force=True)
    again = read(tmp_path / "t.bin")
    np.testing.assert_array_equal(again.f[~lost], table.f[~lost])
    assert (again.flag == Flag.VALID).all() and again.layout == table.layout and again.channels == table.channels
    assert report.note == (f"{lost.sum()} cells without a value interpolated" if gaps else "")
    np.testing.assert_allclose(read(tmp_path / "t.bin", scale=scale).f, scale * again.f, rtol=1e-15)
    assert (report.max_absolute, report.lost) == (0, 0)


def test_another_grid_is_resampled_and_the_error_told(tmp_path):
    angles = np.radians([0, 20, 40, 60, 80])
    grid = layouts.isotropic(angles, angles, np.radians(np.arange(0, 360, 30)))
    theta_i, phi_i, theta_o, phi_o = grid.angles()
    f = 0.3 + 0.1 * (vector(theta_i, phi_i) * vector(theta_o, phi_o)).sum(0)
    report = write(tmp_path / "t.bin", whole_table_of_values(grid, f))
    assert (tmp_path / "t.bin").stat().st_size == BYTES
    assert 0 < report.rms_relative < 0.02 and report.lost == 0 and "15°" in report.note


def test_another_number_of_channels_and_a_scale_that_is_none_are_refused(tmp_path):
    table = read(made(tmp_path / "m.bin")).only(["R", "G"])
    with pytest.raises(GonioError, match="but there are 2 channels"):
        write(tmp_path / "t.bin", table)
    with pytest.raises(GonioError, match="the scale is 0"):
        read(tmp_path / "m.bin", scale=0)
    assert not (tmp_path / "t.bin").exists()


@pytest.mark.parametrize("f", [22 / (2 * np.pi), np.frombuffer(b"\xff\xfeA\n\x31\x2e\x30\x3f")[0]])
def test_numbers_that_look_like_text_are_read(tmp_path, f):
    """Equal numbers may hold no zero byte, or begin as UTF-16 text does."""
    (tmp_path / "x.bin").write_bytes(np.full(BYTES // 8, f, "<f8").tobytes())
    assert (read(tmp_path / "x.bin").f[...] == f).all()
