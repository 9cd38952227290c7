"""Quantities of tables and their budgets, against closed forms of a Lambertian surface and against repetitions."""

import dataclasses
import json
import math

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.data.layouts import isotropic, spherical
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.instrument import Instrument, measure, read_instrument
from gonio.instrument.scans import scan
from gonio.metrology.quantities import quantities
from gonio.models.errors import GonioError

RHO = 0.6
GRID = scan("isotropic", step=math.radians(15), theta_max=math.radians(75))
STATED = {"gain": "0.5 %", "tilt": "0.1 deg", "theta_i": "0.05 deg", "theta_o": "0.2 deg", "dark": "0.01 %"}


@pytest.fixture(scope="module")
def matt():
    return measure(f"lambert(rho={RHO})", Instrument(photons=1e6, dark=500.0, noise=1e-3), GRID, seed=2)


@pytest.fixture(scope="module")
def result(matt):
    return quantities(matt, budget=True, only=["reflectance"], uncertainty=STATED)


def parts(result, name, place=""):
    k = next(k for k, q in enumerate(result.quantities) if (q.name, q.place) == (name, place))
    return result.quantities[k], {c.name: c.values[k] for c in result.budget.contributions}


@pytest.mark.parametrize("theta", [0, 30, 60, 75])
def test_each_source_moves_the_albedo_of_a_lambertian_as_in_closed_form(result, theta):
    q, u = parts(result, "albedo", f"θi {theta}°")
    assert q.value == pytest.approx(RHO, rel=2e-3)
    assert u["gain"] == pytest.approx(0.005 * RHO, rel=3e-3)
    # The irradiance is reckoned from the table's angle: an error of it by dθ reads RHO·(1 − tan θ dθ).
    tangent = math.tan(math.radians(theta))
    assert abs(u["theta_i"]) == pytest.approx(RHO * tangent * math.radians(0.05), rel=0.01, abs=2e-6)
    assert abs(u["tilt_y"]) == pytest.approx(RHO * tangent * math.radians(0.1), rel=0.01, abs=4e-6)
    assert abs(u["tilt_x"]) < 5e-6 and abs(u["theta_o"]) < 2e-5  # its light goes everywhere alike
    assert u["dark"] == pytest.approx(1e-4 / math.cos(math.radians(theta)), rel=0.01)


def test_reflectance_factors_are_those_of_a_lambertian(result):
    for place in ("0:45", "45:0"):
        q, u = parts(result, "reflectance factor", place)
        assert q.value == pytest.approx(RHO, rel=3e-3) and u["interpolation"] == 0
        assert u["gain"] == pytest.approx(0.005 * RHO, rel=3e-3)


def test_the_noise_is_what_repeated_measurements_scatter_by(matt, result):
    instrument = Instrument(photons=1e6, dark=500.0, noise=1e-3)
    repeats = [quantities(measure(f"lambert(rho={RHO})", instrument, GRID, seed=s), only=["albedo"]) for s in range(30)]
    values = np.array([[q.value for q in r.quantities] for r in repeats])
    basic = [not q.geometry for q in result.quantities]
    noise = {c.name: c.values for c in result.budget.contributions if c.name in ("source", "counting", "background")}
    ratio = values.std(axis=0, ddof=1) / np.sqrt(sum(v**2 for v in noise.values()))[basic]
    assert len(noise) == 3 and np.all((ratio > 0.65) & (ratio < 1.4)) and np.mean(ratio) == pytest.approx(1, abs=0.1)


def test_the_errors_that_a_simulation_had_are_not_used():
    off = Instrument(misalignment=1e-3, calibration=0.01, photons=1e6)
    table = measure(f"lambert(rho={RHO})", off, GRID, seed=5)
    assert table.provenance["systematic"]["gain"] != 1
    told = quantities(table, budget=True, only=["reflectance"])
    without = {k: v for k, v in table.provenance.items() if k != "systematic"}
    blind = quantities(dataclasses.replace(table, provenance=without), budget=True, only=["reflectance"])
    assert told.to_dict() == blind.to_dict() and not told.budget.missing
    _, u = parts(told, "albedo", "θi 30°")
    assert u["gain"] == pytest.approx(0.01 * RHO, rel=0.05)


def test_what_nobody_states_is_listed_and_never_zero():
    rng = np.random.default_rng(0)
    table = Table.from_arrays(0, 0, rng.uniform(0, 1.2, 50), rng.uniform(0, 6, 50), 0.2 + 0.001 * rng.random(50))
    b = quantities(table, budget=True, only=["reflectance"], uncertainty={"tilt": "0.1 deg", "gain": "1 %"}).budget
    assert {"repeatability", "theta_i", "dark", "aperture", "tilt_x"} <= set(b.missing)
    assert "give a model" in b.missing["tilt_x"] and "gain" not in b.missing and not b.to_dict()["complete"]


def test_repeats_tell_the_noise_and_its_degrees_of_freedom():
    rng = np.random.default_rng(1)
    theta_o, phi_o = (np.repeat(a, 4) for a in (np.arcsin(np.sqrt(rng.random(300))), rng.uniform(0, 2 * np.pi, 300)))
    f = 0.2 * (1 + 0.01 * rng.standard_normal(theta_o.size))
    b = quantities(Table.from_arrays(0, 0, theta_o, phi_o, f), budget=True, only=["reflectance"]).budget
    repeats = next(c for c in b.contributions if c.name == "repeatability")
    assert repeats.dof == 900 and repeats.origin == "estimated"
    # 300 directions of equal weight, 4 readings each.
    assert repeats.values[0] == pytest.approx(0.2 * np.pi * 0.01 / math.sqrt(1200), rel=0.3)


def test_a_table_that_misses_the_lobe_has_no_bound():
    theta = np.radians([0, 15, 30, 45, 60])
    table = measure(
        "0.2 * ggx(alpha=0.3)", None, isotropic(theta, theta + math.radians(7), np.radians(range(0, 360, 15)))
    )
    result = quantities(table, budget=True, only=["reflectance", "gloss"])
    b, near = result.budget, np.array([q.group == "albedo" for q in result.quantities])
    assert near.any() and np.isinf(b.standard[near]).all() and b.unbounded[near].all()
    assert {"gloss 20°", "8°:di"} <= {u.name for u in result.undecided}
    assert quantities("lambert(rho=0.2)", only="all").quantities == quantities("lambert(rho=0.2)").quantities
    assert (
        json.loads(quantities(table, budget=True, only=["reflectance"]).to_json())["quantities"][0][
            "expanded_uncertainty"
        ]
        is None
    )


def test_a_model_has_quantities_and_no_budget():
    made = gonio.quantities("lambert(rho=[0.2, 0.5])", geometries=["20:50:90"])
    named = [q for q in made.quantities if q.place == "20:50:90"]
    assert [q.value for q in named] == pytest.approx([0.2, 0.5])
    assert named[-1].angles == {"theta_i": 20, "theta_o": 50, "delta_phi": 90}
    uniform = [q for q in made.quantities if q.name == "albedo under uniform light"]
    assert [q.value for q in uniform] == pytest.approx([0.2, 0.5], abs=1e-9)
    with pytest.raises(GonioError, match="is a model"):
        gonio.quantities("lambert(rho=0.2)", budget=True, only=["reflectance"])


def test_the_description_of_an_instrument_states_them(matt, tmp_path):
    lab = tmp_path / "lab.toml"
    lab.write_text('gonio_instrument = 1\ncalibration = 0.02\n[uncertainty]\ntilt = "0.1 deg"\n')
    described = quantities(matt, budget=True, only=["reflectance"], instrument=read_instrument(lab))
    stated = quantities(matt, budget=True, only=["reflectance"], uncertainty={"gain": "2 %", "tilt": 0.1})
    assert described.budget.standard == pytest.approx(stated.budget.standard)
    lab.write_text("gonio_instrument = 1\n[uncertainty]\ntitl = 1\n")
    with pytest.raises(GonioError, match="did you mean 'tilt'"):
        read_instrument(lab)


def test_the_command_line_prints_and_writes_all_of_it(matt, tmp_path, capsys):
    matt.save(tmp_path / "t.h5")
    call = ["quantities", str(tmp_path / "t.h5"), "--budget", "--uncertainty", "gain=0.5 %, tilt=0.1 deg"]
    assert main([*call, "--geometry", "30:30", "--json", str(tmp_path / "q.json")]) == 0
    out = capsys.readouterr().out
    assert "U (k = 2)" in out and "calibration factor" in out and "30:30" in out
    content = json.loads((tmp_path / "q.json").read_text())
    size = len(content["quantities"])
    assert all(len(c["contributions"]) == size for c in content["budget"]["contributions"])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("--budget --uncertainty gain", "give NAME=U"),
        ("--budget --uncertainty gian=1", "did you mean 'gain'"),
        ("--uncertainty gain=1", "give --budget too"),
        ("--geometry 30", "is no geometry"),
        ("--geometry 45:90", "is no geometry"),
        ("--budget --instrument none.toml", "does not exist"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(matt, tmp_path, capsys, words, sentence):
    matt.save(tmp_path / "t.h5")
    assert main(["quantities", str(tmp_path / "t.h5"), *words.split()]) == 2
    error = capsys.readouterr().err
    assert sentence in error and error.count("\n") == 1


def test_the_azimuth_of_the_light_does_not_matter():
    theta, phi = np.radians(np.arange(0, 76, 15)), np.radians(np.arange(0, 360, 30))
    delta = np.multiply.outer(np.multiply.outer(np.sin(theta), np.sin(theta)), np.cos(phi))
    f = (0.2 - 0.1 * delta)[:, None, ..., None]
    values = []
    for light in np.radians([0.0, 120.0]):
        order = np.argsort((phi + light) % (2 * np.pi))
        layout = spherical(theta, [light], theta, np.sort((phi + light) % (2 * np.pi)))
        table = whole_table_of_values(layout, f[:, :, :, order], Channels.grey())
        values.append([q.value for q in quantities(table, only="multi-angle").quantities])
        fitted = quantities(table, only="multi-angle", fit=gonio.fit(table, "lambert")).quantities
        assert [q.value for q in fitted[: len(values[0])]] == pytest.approx(values[0], rel=1e-6)
    assert values[0] == pytest.approx(values[1], rel=1e-9) and len(values[0]) >= 4
