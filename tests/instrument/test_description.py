"""The description of an instrument: what it says holds in measurements, and bad ones are refused in one sentence."""

import dataclasses
import math

import numpy as np
import pytest

from gonio.__main__ import main
from gonio.checks.certify import check
from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.hdf5.writer import open_table
from gonio.instrument import Instrument, Pace, measure, read_instrument
from gonio.instrument.description import instrument_of
from gonio.models.errors import GonioError
from support.check_tables import property_of

HEADER = "theta_i,phi_i,theta_o,phi_o,seconds\n"
LAB = """gonio_instrument = 1
axis_speed = [10, 20, 10, 40]
settling = 0.5
count_rate = 1e6
dark_rate = 20
seconds = 2
shadow = 5
theta_i = [0, 60]
calibration = 0.003
"""


@pytest.fixture
def lab(tmp_path):
    (tmp_path / "lab.toml").write_text(LAB)
    return tmp_path / "lab.toml"


def test_a_description_is_the_instrument_it_says(lab):
    read = read_instrument(lab)
    assert (read.photons, read.dark, read.seconds, read.calibration) == (2e6, 40.0, 2.0, 0.003)
    assert read.shadow == pytest.approx(math.radians(5)) and read.ranges[0] == pytest.approx((0, math.pi / 3))
    assert np.degrees(read.pace.axis_speed) == pytest.approx([10, 20, 10, 40])
    lab.write_text("gonio_instrument = 1\n")
    assert read_instrument(lab) == Instrument()


def test_the_slowest_axis_sets_the_time_and_azimuths_go_the_shorter_way():
    pace = Pace(tuple(np.radians([10, 20, 10, 40])), settling=0.5)
    start, end = np.radians([0, 10, 0, 350]), np.radians([30, 350, 10, 10])
    assert pace.moving(start, end) == pytest.approx(3.0)
    assert pace.path_seconds(np.stack([start, end], axis=1), np.array([1.0, 2.0])) == pytest.approx(3 + 2 * 0.5 + 3)


def test_options_win_over_the_description_and_a_scan_says_the_seconds(lab, tmp_path):
    (tmp_path / "d.csv").write_text(
        "theta_i,phi_i,theta_o,phi_o,seconds\n10,0,20,180,4\n10,0,20,180,16\n70,0,20,180,16\n"
    )
    given = ["measure", "lambert(rho=0.5)", "--instrument", str(lab), "--scan", str(tmp_path / "d.csv")]
    assert main([*given, "-o", str(tmp_path / "a.h5")]) == 0
    table = open_table(tmp_path / "a.h5")
    assert table.u_f[0] == pytest.approx(2 * table.u_f[1]) and table.flag[2] == Flag.NOT_MEASURED
    assert main([*given, "-o", str(tmp_path / "b.h5"), "--photons", "2e4"]) == 0
    assert open_table(tmp_path / "b.h5").provenance["instrument"]["photons"] == 2e4


def test_longer_counting_scatters_as_its_uncertainty_says():
    n, instrument = 4000, Instrument(photons=1e4, dark=50.0, read_noise=5.0, seconds=0.5)
    angles = [np.full(n, a) for a in (0.5, 0.0, 0.3, 2.0)]
    table = measure("lambert(rho=0.5)", instrument, layouts.scattered(*angles), seconds=np.repeat([0.5, 8.0], n // 2))
    for half in (slice(0, n // 2), slice(n // 2, n)):
        assert np.std(table.f[half]) == pytest.approx(float(table.u_f[half][0, 0]), rel=0.06)
        assert np.mean(table.f[half]) == pytest.approx(
            0.5 / np.pi, abs=5 * float(table.u_f[half][0, 0]) / np.sqrt(n / 2)
        )


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("axis_speed = [1, 2]", "axis_speed is"), ("settling = -1", "settling"), ("seconds = 0", "seconds is 0"),
        ("theta_i = [0, 195]", "range of theta_i"), ("phi_i = [300, 20]", "range of phi_i"),
        ("noise = true", "noise is True"),
        ("dark_rate = 5", "give photons too"), ("count_rate = nan", "count rate is nan"), ("colour = 1", "unknown key"),
    ],
)  # fmt: skip
def test_bad_descriptions_are_refused_with_the_key(tmp_path, line, reason):
    (tmp_path / "bad.toml").write_text(f"gonio_instrument = 1\n{line}\n")
    with pytest.raises(GonioError, match=reason):
        read_instrument(tmp_path / "bad.toml")


def test_counting_times_that_are_none_are_refused(tmp_path):
    one = layouts.scattered([0.1], [0.0], [0.2], [0.0])
    for seconds in (0.0, -1.0, [1.0, 2.0], math.nan):
        with pytest.raises(GonioError, match="counting times above 0"):
            measure("lambert(rho=0.5)", Instrument(photons=1e4), one, seconds=seconds)
    with pytest.raises(GonioError, match="seconds is 0"):
        dataclasses.replace(Instrument(), seconds=0.0)


GLASS = "rough_dielectric(alpha=0.5, eta=1.5)"


def test_the_media_of_an_instrument_are_those_of_its_tables(tmp_path):
    polar = np.radians([10.0, 60.0])
    both = np.concatenate([polar, (np.pi - polar)[::-1]])
    grid = layouts.isotropic(both, both, np.radians(np.arange(0, 360, 30.0)))
    lab = tmp_path / "lab.toml"
    lab.write_text("gonio_instrument = 1\nmedia = [1.2, 1.8]\n")
    instrument = read_instrument(lab)
    assert instrument_of({"instrument": instrument.to_dict()}) == instrument
    table = measure(GLASS, instrument, grid)
    assert [n[0] for n in table.media] == [1.2, 1.8] and "1.2 in front" in str(instrument)
    bare = dataclasses.replace(table, provenance={})
    assert property_of("reciprocity", bare).residual > 0.5
    assert property_of("reciprocity", bare, instrument=instrument).residual < 1e-6
    # What reflects alone is measured in any media; what refracts, or is the same from both sides, is not.
    assert "media" not in measure("gold", instrument, layouts.in_plane(polar, polar)).provenance
    for other in ("rough_dielectric(alpha=0.5, eta=1.33)", "thin_sheet(rho=0.3, tau=0.5)"):
        with pytest.raises(GonioError, match=r"a ratio of 1\.5"):
            measure(other, instrument, grid)
    with pytest.raises(GonioError, match=r"states media of index 1\.2, 1\.8"):
        check(table, instrument=Instrument(media=(1.0, 1.33)))


@pytest.mark.parametrize("media", ["[1.5]", "[1, 0]", "[1, 2, 3]", '["air", "glass"]', "[1, inf]", "1.5", "[true, 1]"])
def test_media_that_are_none_are_refused(tmp_path, media):
    (tmp_path / "lab.toml").write_text(f"gonio_instrument = 1\nmedia = {media}\n")
    with pytest.raises(GonioError, match="media"):
        read_instrument(tmp_path / "lab.toml")
