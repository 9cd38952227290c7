"""BiRD JSON: the three forms made here of a closed form, and what gonio writes, read as others would and as it does."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.formats.registry import read, write
from gonio.data.table import Table, whole_table_of_values
from gonio.models.errors import GonioError
from support.closed_form import anisotropic, largest_error, pairs, vector

ANGLES = pairs(12, 7)
F = anisotropic(vector(*ANGLES[:2]), vector(*ANGLES[2:]))


def schema_1(rows=2, unit="deg", **more):
    """Each geometry at several wavelengths."""
    scale = {"deg": 180 / np.pi, "°": 180 / np.pi, "rad": 1.0}[unit]
    names = ("theta_i", "phi_i", "theta_r", "phi_r")
    data = {
        n: {"unit": unit, "values": np.repeat(a * scale, rows).tolist()} for n, a in zip(names, ANGLES, strict=True)
    }
    data["wavelength_i"] = {"unit": "μm", "values": [0.45, 0.65, 0.85][:rows] * 12}
    data["BRDF"] = {"unit": "sr^-1", "values": np.outer(F, np.arange(1, rows + 1)).ravel().tolist()}
    return {"metadata": {"sample": {"name": "tile"}}, "data": data | more}


def written(path, content):
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.parametrize("unit", ["deg", "°", "rad"])
def test_schema_1_has_a_channel_for_each_wavelength(tmp_path, unit):
    table = read(written(tmp_path / "a.brdf", schema_1(unit=unit)))
    assert table.name == "tile" and table.channels.wavelengths_nm == (450, 650)
    assert largest_error(table, anisotropic) < 1e-12
    assert largest_error(table, lambda wi, wo: 2 * anisotropic(wi, wo), 1) < 1e-12


def test_polarisations_are_channels_by_letters_or_stokes_vectors(tmp_path):
    stokes = {"notation": "inStokes", "values": [[1, 1, 0, 0], [1, -1, 0, 0]] * 12}
    made = schema_1(polarization_i=stokes)
    made["data"]["wavelength_i"]["values"] = [0.5] * 24
    table = read(written(tmp_path / "a.json", made))
    assert table.channels.names == ("500 nm s", "500 nm p") and table.channels.wavelengths_nm == (500, 500)
    assert largest_error(table, lambda wi, wo: 2 * anisotropic(wi, wo), 1) < 1e-12


@pytest.mark.parametrize(
    ("more", "options", "expected"),
    [
        ({"uBRDF": {"unit": "1/sr", "values": [0.02] * 24}}, {}, 0.02),
        ({"uBRDF": {"unit": "%", "values": [4] * 24, "comments": "expanded, k = 2"}}, {}, "2 %"),
        ({"uBRDF": {"unit": "sr^-1", "values": [0.02] * 24}}, {"coverage": 2}, 0.01),
    ],
)
def test_uncertainties_become_standard_ones(tmp_path, more, options, expected):
    table = read(written(tmp_path / "a.json", schema_1(**more)), **options)
    assert np.allclose(table.u_f, np.abs(table.f) * 0.02 if expected == "2 %" else expected)
    assert any("standard" in sentence for sentence in table.provenance["understood"])


def test_one_uncertainty_may_be_of_all_readings(tmp_path):
    made = schema_1()
    made["data"]["BRDF"]["uncertainty"] = {"value": 0.6, "unit": "%"}
    table = read(written(tmp_path / "a.json", made))
    assert np.allclose(table.u_f, 0.006 * table.f)


def test_rows_of_variables_are_read(tmp_path):
    data = schema_1()["data"]
    data["wavelength"] = data.pop("wavelength_i")
    variables = [{"name": name, "unit": column["unit"], "type": "number"} for name, column in data.items()]
    rows = np.column_stack([column["values"] for column in data.values()]).tolist()
    table = read(written(tmp_path / "a.json", {"data": {"variables": variables, "values": rows}}))
    assert table.channels.wavelengths_nm == (450, 650) and largest_error(table, anisotropic) < 1e-12


def test_the_older_form_has_signed_polar_angles(tmp_path):
    signed = np.where(np.arange(12) % 2, -1, 1)
    theta_v, phi_v = np.degrees(ANGLES[2]) * signed, np.degrees(ANGLES[3]) + 180 * (signed < 0)
    data = {
        "wavelengths": [500, 600],
        "theta_i": np.degrees(ANGLES[0]).tolist(),
        "phi_i": np.degrees(ANGLES[1]).tolist(),
    }
    data |= {
        "theta_v": theta_v.tolist(),
        "phi_v": phi_v.tolist(),
        "pol": ["s"] * 12,
        "data": [F.tolist(), (2 * F).tolist()],
    }
    table = read(written(tmp_path / "a.json", {"head": {"date": "today"}, "data": data}))
    assert largest_error(table, anisotropic) < 1e-9 and table.channels.wavelengths_nm == (500, 600)
    assert "polarisation s" in table.provenance["understood"]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: d.pop("theta_r"), "it has no data.theta_r"),
        (lambda d: d["phi_i"]["values"].pop(), "has 23 entries, expected 24"),
        (lambda d: d["theta_i"].update(unit="grad"), "has the unit 'grad'"),
        (lambda d: d.update(uBRDF={"unit": "1/sr", "values": [-1] * 24}), "is negative"),
        (lambda d: d.update(BRDF=[1, 2]), "is no JSON object"),
        (lambda d: d.update(BRDF={"values": [[1], [2, 3]]}), "is not a list of numbers"),
    ],
)
def test_damaged_files_are_refused_in_a_sentence(tmp_path, change, expected):
    made = schema_1()
    change(made["data"])
    with pytest.raises(GonioError, match=expected):
        read(written(tmp_path / "bad.json", made))


def test_others_read_what_gonio_writes_by_the_schema_alone(tmp_path):
    table = read(written(tmp_path / "a.json", schema_1(uBRDF={"unit": "1/sr", "values": [0.02] * 24})))
    write(tmp_path / "b.json", table)
    content = json.loads((tmp_path / "b.json").read_text())
    assert {"metadata", "data"} == set(content) and content["metadata"]["type"] == "BRDF"
    assert {len(v["values"]) for k, v in content["data"].items() if k != "adhoc_variables"} == {24}
    del content["metadata"]["adhoc_section"], content["data"]["adhoc_variables"]
    again = read(written(tmp_path / "c.json", content))
    assert np.array_equal(again.f, table.f) and np.array_equal(again.u_f, table.u_f)


def _random_table(seed: int, gridded: bool) -> Table:
    rng = np.random.default_rng(seed)
    channels = Channels.rgb() if seed % 2 else Channels.of_wavelengths([450.5, 450.5000001, 700])
    grid = layouts.isotropic([0.1, 0.7], [0.0, 0.4, 1.5707963267948966], np.radians([0, 90, 180]))
    layout = grid if gridded else layouts.scattered(*pairs(9, seed))
    table = whole_table_of_values(layout, rng.normal(size=(*layout.shape, 3)), channels, name="any")
    u_f = np.where(rng.random(table.shape) < 0.3, np.nan, rng.random(table.shape))
    u_f[rng.random(table.shape) < 0.1] = 0
    flag = np.where(table.flag == Flag.VALID, rng.choice([0, 0, 0, 2, 3, 4, 5], table.shape), table.flag)
    flag = flag.astype(np.uint8)
    flag.reshape(-1, 3)[1] = [0, 2, 0]
    unread = flag != Flag.VALID
    f, u_f = np.where(unread, np.nan, table.f), np.where(unread, np.nan, u_f)
    return dataclasses.replace(table, f=f, flag=flag, u_f=None if seed % 5 == 0 else u_f)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32), gridded=st.booleans())
def test_written_and_read_again_it_is_the_same(tmp_path_factory, seed, gridded):
    table, path = _random_table(seed, gridded), tmp_path_factory.mktemp("bird") / "t.json"
    report = write(path, table)
    again = read(path)
    assert (report.max_absolute, report.lost) == (0, 0)
    assert again.channels == table.channels and again.layout.name == table.layout.name
    assert np.allclose(again.layout.angles(), table.layout.angles(), rtol=0, atol=1e-15)
    assert np.array_equal(again.flag, table.flag) and np.array_equal(again.f, table.f, equal_nan=True)
    known = None if table.u_f is None or np.isnan(table.u_f).all() else table.u_f
    assert (again.u_f is None) == (known is None)
    assert known is None or np.array_equal(again.u_f, known, equal_nan=True)
