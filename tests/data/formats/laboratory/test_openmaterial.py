"""OpenMATERIAL look-up tables: JSON made here of a closed form; wavelengths in m, angles in radians."""

import json

import numpy as np
import pytest

from gonio.data.formats.registry import read
from gonio.models.errors import GonioError
from support.closed_form import isotropic, largest_error, vector


def content(wavelengths=(9.05e-07, 5e-7), **brdf):
    axes = np.meshgrid(wavelengths, np.radians([0, 30, 60]), np.radians([0, 45, 90]), np.radians([0, 90, 180, 270]))
    nm, theta_i, theta_o, phi_o = (a.ravel() for a in axes)
    f = isotropic(vector(theta_i, 0 * theta_i), vector(theta_o, phi_o)) * nm * 1e6
    rows = np.column_stack([nm, np.round(theta_i, 6), np.round(theta_o, 6), np.round(phi_o, 6), f]).tolist()
    return {"metadata": {"name": "asphalt"}, "brdf": {"wavelengths": list(wavelengths), "lookupTable": rows, **brdf}}


def written(path, content):
    path.write_text(json.dumps(content))
    return path


def test_rows_become_a_grid_with_a_channel_for_each_wavelength(tmp_path):
    angles = [{"wavelength": w, "solidAngle": 0.002} for w in (5e-7, 9.05e-7)]
    table = read(written(tmp_path / "a.xompt", content(receiverSolidAngles=angles)))
    assert (table.name, table.layout.name, table.layout.shape) == ("asphalt", "isotropic", (3, 3, 4))
    assert table.channels.wavelengths_nm == (500, 905) and table.receiver_solid_angle == 0.002
    for k, scale in enumerate((0.5, 0.905)):
        assert largest_error(table, lambda wi, wo, s=scale: s * isotropic(wi, wo), k) < 1e-6
    assert table.counts()["below_horizon"] == 2 * 3 * 4


def test_null_is_not_measured_and_azimuths_of_the_ray_can_be_stated(tmp_path):
    made = content([5e-7])
    for row in made["brdf"]["lookupTable"]:
        row[3] = (row[3] + np.pi) % (2 * np.pi)
    made["brdf"]["lookupTable"][3][4] = None
    table = read(written(tmp_path / "a.json", made), mirror_azimuth=0)
    assert largest_error(table, lambda wi, wo: 0.5 * isotropic(wi, wo)) < 1e-6
    assert table.counts()["not_measured"] == 1


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda c: c["brdf"].pop("lookupTable"), "no brdf.lookupTable"),
        (lambda c: c["brdf"]["lookupTable"][0].pop(), "rows of as many numbers each"),
        (lambda c: c["brdf"]["lookupTable"][0].__setitem__(1, None), "null in place of a wavelength or an angle"),
        (lambda c: c["brdf"]["lookupTable"][0].__setitem__(0, -1), "has the wavelength"),
        (lambda c: c["brdf"]["lookupTable"][0].__setitem__(2, 1e9), "expected polar angles"),
        (lambda c: c["brdf"]["lookupTable"][0].__setitem__(4, {}), "rows of as many numbers each"),
    ],
)
def test_damaged_tables_are_refused_in_a_sentence(tmp_path, change, expected):
    made = content() | {"$schema": "material_brdf_schema.json"}
    change(made)
    with pytest.raises(GonioError, match=expected):
        read(written(tmp_path / "bad.xompt", made))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[" * 10**5 + "]" * 10**5, "more than 32 brackets"),
        ('"x": ' + "9" * 10**6, "lookupTable is not a list"),
        ('"x": "' + '\\"' * 10**6, "is damaged JSON"),
        ('"x": [' + "[]," * (1 << 21) + "[]]", "lists and objects"),
    ],
)
def test_bombs_are_refused_before_they_are_parsed(tmp_path, text, expected):
    (tmp_path / "bomb.xompt").write_text('{"brdf": {"lookupTable": 1}, ' + text + "}")
    with pytest.raises(GonioError, match=expected):
        read(tmp_path / "bomb.xompt")
