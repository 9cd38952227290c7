"""``gonio measure`` as a user meets it: options, messages, exit status, and killed runs that go on."""

import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from gonio.__main__ import main
from gonio.data.flags import Flag
from gonio.data.hdf5.writer import open_table

MATT = "lambert(rho=0.5)"


def run(*arguments):
    return main(["measure", *map(str, arguments)])


def test_options_reach_the_instrument_and_the_scan(tmp_path, capsys):
    path = tmp_path / "t.h5"
    status = run(
        MATT, "-o", path, "--scan", "isotropic", "--step", 15, "--phi-step", 90, "--theta-max", 60,
        "--source-half-angle", 1, "--detector-half-angle", 2, "--photons", 1e5, "--ambient", 0.1, "--dark", 3,
        "--read-noise", 2, "--noise", 0.01, "--saturation", 1e6, "--shadow", 5, "--tolerance", 2e-3,
        "--systematic", "tilt_x=0.1,gain=1.01", "--seed", 5, "--float32",
    )  # fmt: skip
    out, err = capsys.readouterr()
    table = open_table(path)
    shadowed = np.count_nonzero(table.flag == Flag.SHADOWED)
    told = f"{shadowed} readings have no value: {shadowed} where the detector shadows the sample"
    assert status == 0 and out.splitlines()[1:] == [told, f"written: {path}"] and "100 cells in" in err
    assert out.startswith("on a real instrument: ")
    assert table.layout.shape == (5, 5, 4) and table.f.dtype == np.float32
    expected = {
        "source_half_angle_deg": 1.0, "detector_half_angle_deg": 2.0, "photons": 1e5, "ambient": 0.1, "dark": 3.0,
        "read_noise": 2.0, "noise": 0.01, "saturation": 1e6, "shadow_deg": 5.0, "tolerance": 2e-3,
    }  # fmt: skip
    recipe = table.provenance
    assert {k: recipe["instrument"][k] for k in expected} == pytest.approx(expected)
    assert recipe["systematic"]["tilt_x_deg"] == pytest.approx(0.1) and recipe["systematic"]["gain"] == 1.01
    assert recipe["seed"] == 5
    assert shadowed


def test_a_scan_of_which_the_axes_reach_nothing_ends_with_status_1(tmp_path, capsys):
    (tmp_path / "lab.toml").write_text("gonio_instrument = 1\ntheta_o = [95, 170]\n")
    assert run(MATT, "-o", tmp_path / "t.h5", "--step", 45, "--instrument", tmp_path / "lab.toml") == 1
    assert "NO reading has a value" in capsys.readouterr().out


def test_a_scan_of_the_plane_and_a_list_of_directions(tmp_path):
    assert run(MATT, "-o", tmp_path / "p.h5", "--scan", "in-plane", "--theta-i", "10,45", "--step", 5) == 0
    assert open_table(tmp_path / "p.h5").layout.shape == (2, 35)
    (tmp_path / "d.csv").write_text("theta_i,phi_i,theta_o,phi_o\n10,0,20,180\n0,0,5,90\n")
    assert run(MATT, "-o", tmp_path / "l.h5", "--scan", tmp_path / "d.csv") == 0
    np.testing.assert_allclose(open_table(tmp_path / "l.h5").f, 0.5 / np.pi, rtol=1e-15)


def test_an_output_that_exists_or_cannot_be_is_refused(tmp_path, capsys):
    path = tmp_path / "t.h5"
    assert run(MATT, "-o", path, "--step", 45) == 0
    before = path.read_bytes()
    assert run(MATT, "-o", path, "--step", 45) == 2 and "--force" in capsys.readouterr().err
    assert path.read_bytes() == before
    assert run(MATT, "-o", path, "--step", 30, "--force") == 0 and path.read_bytes() != before
    assert run(MATT, "-o", tmp_path / "none" / "t.h5") == 2 and "does not exist" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["t.h5"]


@pytest.mark.thorough
def test_a_killed_measurement_goes_on_to_the_same_bits(tmp_path):
    command = [
        sys.executable, "-m", "gonio", "measure", "0.5*beckmann(alpha=0.02) + lambert(rho=[0.1, 0.3])",
        "--step", "6", "--source-half-angle", "1", "--detector-half-angle", "1", "--photons", "1e5", "--noise", "0.01",
        "--misalignment", "0.02", "--seed", "7",
    ]  # fmt: skip

    def start(target):
        return subprocess.Popen([*command, "-o", target], cwd=tmp_path, stderr=subprocess.DEVNULL)

    calm, killed, part = tmp_path / "calm.h5", tmp_path / "killed.h5", tmp_path / "killed.h5.part"
    assert start(calm).wait() == 0
    rng, kills = random.Random(3), 0
    for _ in range(2):
        process = start(killed)
        while process.poll() is None and not part.exists():
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, 0.5))
        process.send_signal(signal.SIGKILL)
        kills += process.wait() == -signal.SIGKILL
        if killed.exists() or (kills and part.exists()):
            break
    assert kills >= 1
    if not killed.exists():
        assert start(killed).wait() == 0
    a, b = open_table(calm), open_table(killed)
    for name in ("f", "u_f", "flag"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes()
    recipes = [{k: v for k, v in t.provenance.items() if k not in ("created", "command")} for t in (a, b)]
    assert recipes[0] == recipes[1] and recipes[0]["aperture_error"]["excess"] > 0
    assert not part.exists()
