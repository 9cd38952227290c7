import json

import numpy as np

from gonio.__main__ import main
from gonio.data import layouts
from gonio.data.hdf5.writer import write_table
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.expression.builder import build


def test_a_certificate_is_printed_and_written(tmp_path, capsys):
    out = tmp_path / "certificate.json"
    assert main(["check", "lambert(rho=0.5)", "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "PASS" in printed and "reciprocity" in printed and "1e-09" in printed
    assert json.loads(out.read_text())["overall"] == "pass"
    assert main(["check", "lambert(rho=0.5)", "--json", str(out)]) == 2
    assert main(["check", "1.5 * lambert(rho=1)", "--json", str(out), "--force"]) == 1
    assert json.loads(out.read_text())["exit_status"] == 1


def test_json_alone_goes_to_standard_output(capsys):
    assert main(["check", "1.05 * lambert(rho=1)", "--json", "-", "--tol-energy", "0.1"]) == 0
    assert json.loads(capsys.readouterr().out)["properties"][1]["tolerance"] == 0.1


def test_each_of_several_that_is_refused_is_named_once(tmp_path, capsys):
    missing, text = tmp_path / "missing.h5", tmp_path / "text.h5"
    text.write_text("no table")
    subjects = [str(missing), "no_material", str(text), "lambert(rho=2)", "lambert(rho=0.5)"]
    assert main(["check", *subjects, "-q"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert all(line.count(subject) == 1 for line, subject in zip(lines, subjects[:3], strict=False))


def test_a_file_is_checked_as_the_table_it_holds(tmp_path, capsys):
    d = np.radians
    layout = layouts.isotropic(d(np.arange(0, 81, 10)), d(np.arange(2.5, 89, 5)), d(np.arange(0, 360, 10)))
    table = whole_table_of_values(layout, grid_values(build("lambert(rho=0.5)"), layout))
    write_table(tmp_path / "t.h5", table)
    assert main(["check", str(tmp_path / "t.h5")]) == 3
    printed = capsys.readouterr().out
    assert "(table)" in printed and "mirror direction" in printed and "no bound" in printed
    assert main(["check", str(tmp_path / "t.h5"), "--feature-width", "6"]) == 0
    assert "PASS, assuming that no lobe is narrower than 6°" in capsys.readouterr().out


def test_stored_uncertainties_are_tested_at_the_level_and_the_place_is_said(tmp_path, capsys):
    d = np.radians
    layout = layouts.isotropic(d(np.arange(0, 81, 10)), d(np.arange(0, 81, 10)), d(np.arange(0, 360, 30)))
    f = grid_values(build("lambert(rho=0.5)"), layout)
    wrong = f * (1 + 0.03 * np.cos(layout.angles()[0].reshape(layout.shape)))[..., None]
    # With noise: readings that are equal to those of mirrored directions would count as one.
    noisy = wrong + 0.01 * f * np.random.default_rng(0).standard_normal(f.shape)
    write_table(tmp_path / "t.h5", whole_table_of_values(layout, noisy, u_f=0.01 * f))
    assert main(["check", str(tmp_path / "t.h5"), "--level", "0.001", "--feature-width", "21", "-v"]) == 0
    printed = capsys.readouterr().out
    assert "level 0.001" in printed and "That is significant, and within the tolerance" in printed
    assert "all angles together" in printed
    status = main(["check", str(tmp_path / "t.h5"), "--against", "lambert(rho=0.5)", "--tol-agreement", "0.01"])
    assert status == 1 and "agreement" in capsys.readouterr().out


def test_a_model_carries_the_verdict_that_the_grid_leaves_open(tmp_path, capsys):
    d = np.radians
    layout = layouts.isotropic(d(np.arange(0, 81, 10)), d(np.arange(0, 81, 10)), d(np.arange(0, 360, 20)))
    path = str(tmp_path / "t.h5")
    write_table(
        path, whole_table_of_values(layout, grid_values(build("lambert(rho=0.3) + 0.4 * ggx(alpha=0.1)"), layout))
    )
    assert main(["check", path]) == 3
    assert "--model auto" in capsys.readouterr().out
    assert main(["check", path, "--model", "lambert + ggx", "-v"]) == 0
    assert "Model-assisted" in capsys.readouterr().out
    assert main(["check", path, "--model", "no_such"]) == 2
    assert "no_such" in capsys.readouterr().err
