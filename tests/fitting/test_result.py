"""The result of a fit as a subject: saved, read, measured and checked again."""

import tomllib

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.data.hdf5.writer import write_table
from gonio.models.errors import GonioError
from support.fit_tables import COARSE_ISOTROPIC, ONE_LOBE, table_of

MODEL = "lambert + ggx(f0=0.04)"


@pytest.fixture(scope="module")
def table():
    return table_of(ONE_LOBE, COARSE_ISOTROPIC, noise=0.02, name="mine")


@pytest.fixture(scope="module")
def result(table):
    return gonio.fit(table, MODEL, starts=0)


def test_it_is_saved_as_the_command_line_writes_it(table, result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_table("t.h5", table)
    assert main(["fit", "t.h5", "-m", MODEL, "--starts", "0", "-o", "line.fit.toml"]) == 0
    result.save("face.fit.toml")
    line, face = (tomllib.loads((tmp_path / f"{name}.fit.toml").read_text()) for name in ("line", "face"))
    assert (line.pop("name"), face.pop("name")) == ("line", "face")
    fits = [content.pop("fit") for content in (line, face)]
    assert line == face
    for key in fits[0].keys() - {"seconds"}:
        assert repr(fits[0][key]) == repr(fits[1][key]), key  # maps have cells without a reading, NaN


def test_a_saved_fit_is_not_replaced_unasked(result, tmp_path):
    path = result.save(tmp_path / "a.fit.toml")
    with pytest.raises(GonioError, match="exists"):
        result.save(path)
    assert result.save(path, force=True) == path
    again = gonio.material(path)
    assert again.expression == result.expression and again.meta["fit"]["converged"] is True


def test_its_material_is_a_subject(result):
    material = result.material
    assert material.expression == result.expression and material.channels == result.channels
    assert material.meta["fit"]["cost"] == result.cost and material.name == "fit of mine"
    measured = gonio.measure(result, scan=COARSE_ISOTROPIC)
    assert np.nanmax(np.asarray(measured.f)) > 0
    assert gonio.check(result).overall == gonio.check(material).overall == "pass"
