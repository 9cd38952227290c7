"""The command line as a user meets it: what it prints, what it refuses, and that a refusal leaves nothing behind."""

import csv
import io
import json
import os
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from gonio.__main__ import VERBS, main
from gonio.data import layouts
from gonio.data.hdf5.writer import write_table
from gonio.data.table import whole_table_of_values

DIRECTIONS = "theta_i,phi_i,theta_o,phi_o\n30,0,30,180\n0,0,45,10\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "d.csv").write_text(DIRECTIONS)
    theta, phi = np.radians(np.arange(0, 86, 15.0)), np.radians(np.arange(0, 360, 45.0))
    layout = layouts.isotropic(theta, theta, phi)
    write_table(tmp_path / "t.h5", whole_table_of_values(layout, np.full(layout.shape, 0.25 / np.pi), name="t"))
    return tmp_path


def refused(here, capsys, command):
    before = {p: p.stat().st_mtime_ns for p in here.iterdir()}
    assert main(command) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("gonio: ") and err.count("\n") == 1 and "Traceback" not in err
    assert {p: p.stat().st_mtime_ns for p in here.iterdir()} == before
    return err


def test_eval_writes_its_columns_back(here, capsys):
    assert main(["eval", "lambert(rho=[0.3, 0.6])", "--directions", "d.csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [float(r["theta_o"]) for r in rows] == [30, 45]
    np.testing.assert_allclose(
        [[float(r[c]) for c in ("f_1", "f_2")] for r in rows], [[0.3 / np.pi, 0.6 / np.pi]] * 2, rtol=1e-15
    )


def test_kept_programs_are_loaded_without_a_word(here):
    """XLA writes pages about each program that it loads again, unless it is told not to."""
    command = [sys.executable, "-m", "gonio", "eval", "gold", "--directions", "d.csv"]
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "TF_"))}
    environment |= {"XDG_CACHE_HOME": str(here), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    for _ in range(2):
        done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=here)
        assert done.returncode == 0 and done.stderr == ""
    assert list((here / "gonio" / "jax").iterdir())


def test_eval_output_is_a_table(here, capsys):
    assert main(["eval", "gold", "--directions", "d.csv", "-o", "out.csv"]) == 0
    assert main(["info", "out.csv", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["layout"] == "scattered" and facts["cells"] == 2 and len(facts["channels"]) == 7


def test_single_precision_vectors_are_taken_as_they_came(here, capsys):
    """A narrow lobe sees the difference between a float32 vector and the same made a unit vector in float64."""
    from gonio.models.evaluation import evaluate
    from gonio.models.expression.builder import build
    from gonio.models.geometry.directions import Direction

    wi, wo = (np.array(v, np.float32).astype(float) for v in ([0.6, 0.1, 0.79372539], [-0.6005, -0.1, 0.79334724]))
    numbers = [*wi.tolist(), *wo.tolist()]
    (here / "v.csv").write_text("wi_x,wi_y,wi_z,wo_x,wo_y,wo_z\n" + ",".join(map(repr, numbers)) + "\n")
    assert main(["eval", "ggx(alpha=0.0005)", "--directions", "v.csv"]) == 0
    row = next(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    as_it_came = float(evaluate(build("ggx(alpha=0.0005)"), Direction(*wi), Direction(*wo)))
    unit = float(evaluate(build("ggx(alpha=0.0005)"), *(Direction(*(w / np.linalg.norm(w))) for w in (wi, wo))))
    assert float(row["f"]) == pytest.approx(as_it_came, rel=1e-12) and abs(unit / as_it_came - 1) > 1e-9
    assert [float(row[c]) for c in ("wi_x", "wo_z")] == [wi[0], wo[2]]


def test_models_and_materials_list_themselves(capsys):
    for verb in ("models", "materials"):
        assert main([verb]) == 0 and len(capsys.readouterr().out.splitlines()) > 15
    assert main(["models", "ggx", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ggx"]["parameters"]["alpha"]["high"] == 1
    assert main(["materials", "gold"]) == 0
    assert tomllib.loads(capsys.readouterr().out)["name"] == "gold"


def test_fit_writes_a_material(here, capsys):
    assert main(["fit", "t.h5", "-m", "lambert", "-o", "f.toml", "--json", "f.json"]) == 0
    out = capsys.readouterr().out
    assert "converged" in out and "lambert.rho" in out and "written: f.toml" in out
    fitted = tomllib.loads((here / "f.toml").read_text())
    assert fitted["fit"]["converged"] and float(fitted["model"].split("=")[1].rstrip(")")) == pytest.approx(0.25)
    assert json.loads((here / "f.json").read_text())["samples"] == 6 * 6 * 8
    assert main(["info", "f.toml"]) == 0 and "fit converged" in capsys.readouterr().out
    assert main(["eval", "f.toml", "--directions", "d.csv"]) == 0


def test_convert_says_its_round_trip(here, capsys):
    assert main(["convert", "t.h5", "t.csv"]) == 0
    assert "round trip over 288 readings: largest difference 0" in capsys.readouterr().out
    assert main(["convert", "t.csv", "back.h5"]) == 0


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("eval lambrt(rho=0.1) --directions d.csv", "lambert"),
        ("eval gld --directions d.csv", "gold"),
        ("eval lambert(rho=1.5) --directions d.csv", "domain"),
        ("eval lambert(rho=0.5) --directions absent.csv", "absent.csv"),
        ("eval lambert(rho=0.5) --directions d.csv -o d.csv", "exists"),
        ("eval lambert(rho=0.5) --directions d.csv -o d.csv --force", "input"),
        ("eval lambert(rho=0.5) --directions d.csv -o no/where.csv", "folder"),
        ("eval lambert(rho=0.5) --directions empty.csv", "empty"),
        ("eval lambert(rho=0.5) --directions text.csv", "line 3"),
        ("eval lambert(rho=0.5) --directions nan.csv", "line 2"),
        ("eval lambert(rho=0.5) --directions below.csv", "below the horizon"),
        ("info broken.h5", "broken.h5"),
        ("info foreign.h5", "foreign.h5"),
        ("info noise.bin", "noise.bin"),
        ("info merl.binary", "merl.binary"),
        ("info warp.bsdf", "warp.bsdf"),
        ("fit t.h5 -m lambert -o d.csv", "exists"),
        ("fit t.h5 -m ggy", "ggx"),
        ("fit t.h5 -m lambert --loss cube", "cbrt"),
        ("fit t.h5 -m lambert --theta-max 120", "90"),
        ("fit few.csv -m lambert+ggx", "more are needed"),
        ("convert t.h5 t.xyz", ".h5"),
        ("convert t.h5 t.h5 --force", "input"),
        ("measure t.h5 -o t.h5 --force", "input"),
        ("measure gold -o new.h5 --step -5", "above 0"),
        ("measure gold -o new.h5 --source-half-angle 80", "45°"),
        ("measure gold -o no/new.h5", "folder"),
        ("report t.h5 -o t.h5 --force", "input"),
        ("check absent.h5", "absent.h5"),
        ("models gxx", "ggx"),
        ("materials silvr", "silver"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(here, capsys, command, words):
    import h5py

    (here / "empty.csv").write_text("")
    (here / "text.csv").write_text(DIRECTIONS + "ten,0,20,0\n".replace("ten", "x"))
    (here / "text.csv").write_text("theta_i,phi_i,theta_o,phi_o\n1,2,3,4\nx,0,20,0\n")
    (here / "nan.csv").write_text("theta_i,phi_i,theta_o,phi_o\nnan,0,20,0\n")
    (here / "below.csv").write_text("theta_i,phi_i,theta_o,phi_o\n10,0,120,0\n")
    (here / "few.csv").write_text("theta_i,phi_i,theta_o,phi_o,f\n10,0,20,0,0.1\n20,0,20,0,0.1\n")
    (here / "broken.h5").write_bytes((here / "t.h5").read_bytes()[:900])
    with h5py.File(here / "foreign.h5", "w") as file:
        file["x"] = np.arange(5)
    (here / "noise.bin").write_bytes(np.random.default_rng(0).bytes(5000))
    (here / "merl.binary").write_bytes(np.array([2**31 - 1, -90, 180], "<i4").tobytes() + bytes(800))
    (here / "warp.bsdf").write_bytes(b"tensor_file\0" + bytes([1, 0]) + (2**32 - 1).to_bytes(4, "little") + bytes(90))
    assert words in refused(
        here,
        capsys,
        command.replace("lambert+ggx", "lambert + ggx").split(" ") if "+" not in command else command.split(" "),
    )


def test_unknown_verbs_and_options_are_one_line(capsys):
    for command in (["mesure"], ["fit"], ["eval", "gold", "--direction", "x", "--bogus"]):
        with pytest.raises(SystemExit) as stop:
            main(command)
        assert stop.value.code == 2 and capsys.readouterr().err.count("\n") == 1


def test_every_verb_has_help_without_loading_jax():
    code = "import sys; from gonio.__main__ import main, VERBS\n"
    code += "for v in VERBS:\n try: main([v, '--help'])\n except SystemExit as e: assert e.code == 0\n"
    code += "assert 'jax' not in sys.modules and 'numpy' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert all(f"gonio {v}" in done.stdout for v in VERBS)
