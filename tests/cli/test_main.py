"""The command line as a user meets it: what it prints and writes."""

import csv
import io
import json
import os
import subprocess
import sys
import tomllib

import numpy as np
import pytest

import gonio.cli.program as program
from gonio.__main__ import VERBS, main


def test_eval_writes_its_columns_back(here, capsys):
    assert main(["eval", "lambert(rho=[0.3, 0.6])", "--directions", "d.csv"]) == 0
    comment, *lines = capsys.readouterr().out.splitlines()
    rows = list(csv.DictReader(lines))
    assert comment == '# channels: ["channel 1", "channel 2"]'
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


def test_output_that_nobody_reads_is_no_verdict(here):
    """`gonio check T | head -1` under pipefail: a verdict that was cut off has not passed."""
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, "-m", "gonio", "models"], stdout=writing, stderr=subprocess.PIPE, cwd=here)
    os.close(writing)
    assert done.returncode == 141 and done.stderr == b""


def test_eval_output_is_a_table(here, capsys):
    assert main(["eval", "gold", "--directions", "d.csv", "-o", "out.csv"]) == 0
    assert main(["info", "out.csv", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["layout"] == "scattered" and facts["cells"] == 2 and len(facts["channels"]) == 7


def test_info_names_the_first_and_the_last_of_many_channels(here, capsys):
    names = [f"f_{nm}nm" for nm in range(400, 801, 10)]
    (here / "s.csv").write_text(f"theta_i,phi_i,theta_o,phi_o,{','.join(names)}\n10,0,20,180{',0.1' * len(names)}\n")
    assert main(["info", "s.csv"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("channels"))
    assert line.split(None, 1)[1] == "41: 400 nm, 410 nm, 420 nm, 430 nm, …, 800 nm"
    assert main(["info", "s.csv", "--json"]) == 0 and len(json.loads(capsys.readouterr().out)["channels"]) == 41


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
    assert json.loads(capsys.readouterr().out)["models"]["ggx"]["parameters"]["alpha"]["high"] == 1
    assert main(["materials", "gold"]) == 0
    assert tomllib.loads(capsys.readouterr().out)["name"] == "gold"


def test_fit_writes_a_material(here, capsys):
    assert main(["fit", "t.h5", "-m", "lambert", "-o", "f.toml", "--json", "f.json"]) == 0
    out = capsys.readouterr().out
    assert "converged" in out and "lambert.rho" in out and "written: f.toml" in out
    fitted = tomllib.loads((here / "f.toml").read_text())
    assert fitted["fit"]["converged"] and float(fitted["model"].split("=")[1].rstrip(")")) == pytest.approx(0.25)
    fit = json.loads((here / "f.json").read_text())
    assert fit["samples"] + fit["counts"]["copies"] == fit["counts"]["used"] == 6 * 6 * 8
    assert f"{fit['samples']} readings (and {fit['counts']['copies']} that repeat them)" in out
    assert main(["info", "f.toml"]) == 0
    out = capsys.readouterr().out
    assert "fit converged" in out and fitted["fit"]["judgement"]["sentence"] in out
    assert main(["eval", "f.toml", "--directions", "d.csv"]) == 0


def test_convert_prints_the_round_trip_error(here, capsys):
    assert main(["convert", "t.h5", "t.csv"]) == 0
    assert "round trip over 288 readings: largest difference 0" in capsys.readouterr().out
    assert main(["convert", "t.csv", "back.h5"]) == 0


def test_every_verb_has_help_without_loading_jax():
    code = "import sys; from gonio.__main__ import main, VERBS\n"
    code += "for v in VERBS:\n try: main([v, '--help'])\n except SystemExit as e: assert e.code == 0\n"
    code += "assert 'jax' not in sys.modules and 'numpy' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert all(f"gonio {v}" in done.stdout for v in VERBS)


def test_a_fault_of_the_program_is_no_verdict(monkeypatch, capsys):
    """Exit status 1 means fail and 2 a refused input; a fault of gonio's own has another, and one sentence."""

    def broken(argv=None):
        raise TypeError("two\nlines")

    def leave(status):
        raise SystemExit(status)

    monkeypatch.setattr(program, "main", broken)
    monkeypatch.setattr(program.os, "_exit", leave)
    with pytest.raises(SystemExit) as left:
        program.command()
    assert left.value.code == 70
    printed = capsys.readouterr().err
    assert "a fault of gonio (TypeError: two)" in printed and printed.count("\n") == 1


def test_a_profile_goes_to_csv_and_back(here, capsys):
    from gonio.data.channels import Channels
    from gonio.data.profile import Profile
    from gonio.data.profile_files import open_profile, write_profile

    value = np.array([[0.3, 0.1], [1 / 3, np.nan]])
    flag = np.where(np.isnan(value), np.uint8(3), np.uint8(0))
    whole = Profile(
        np.array([-1.0, 2.5]), value, value / 7, flag, Channels.of_wavelengths((450.0, 633.0)), 0.5, 0.25, {}, "p"
    )
    write_profile("p.h5", whole)
    assert main(["convert", "p.h5", "p.csv"]) == 0 and "round trip over 3 readings" in capsys.readouterr().out
    assert main(["convert", "p.csv", "q.h5", "-q"]) == 0
    again = open_profile("q.h5")
    assert again.channels == whole.channels and (again.illuminated_radius, again.viewed_radius) == (0.5, 0.25)
    for name in ("offsets", "value", "u"):
        np.testing.assert_array_equal(
            getattr(again, name)[again.valid if name != "offsets" else ...],
            getattr(whole, name)[whole.valid if name != "offsets" else ...],
        )
    assert main(["convert", "p.h5", "p.bsdf"]) == 2 and "to hold a profile" in capsys.readouterr().err
