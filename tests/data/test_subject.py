"""One answer to what a subject is, for every verb."""

import dataclasses
import io
import math
from pathlib import Path

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.formats.material_file import write_material
from gonio.data.hdf5.writer import write_table
from gonio.data.material import Material, material_of
from gonio.data.subject import LARGEST_STREAM, load_material, resolve_subject
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from support.undrawn import undrawn

GRID = layouts.isotropic(np.radians([5.0, 30, 60, 80]), np.radians([5.0, 30, 60, 80]), np.radians(range(0, 360, 45)))
EXPRESSION = "lambert(rho=0.5)"


@dataclasses.dataclass
class Fitted:
    material: Material


@pytest.fixture
def table_file(tmp_path) -> Path:
    table = whole_table_of_values(GRID, np.full(GRID.shape, 0.5 / math.pi), name="flat")
    return write_table(tmp_path / "flat.h5", table)


def test_a_model_is_one_subject_however_it_comes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    material = load_material(EXPRESSION)
    write_material("half.toml", material)
    Path("p.fit").write_text("half = Lambertian(albedo=0.5)\n")
    subjects = [EXPRESSION, material, build(EXPRESSION), Fitted(material), "half.toml", Path("half.toml")]
    for given in [*subjects, io.BytesIO(Path("half.toml").read_bytes()), "p.fit:half", Path("p.fit:half")]:
        found = resolve_subject(given)
        assert found.kind == "model" and found.table is None
        assert found.material.expression == EXPRESSION and len(found.channels) == 1
        with pytest.raises(GonioError, match="is a model, not a table; measure it first"):
            found.require_table()


def test_a_table_is_one_subject_however_it_comes(table_file):
    table = gonio.open(table_file)
    given = [table, str(table_file), table_file, io.BytesIO(table_file.read_bytes())]
    for subject in (*given, load_material(table_file), resolve_subject(table)):
        found = resolve_subject(subject)
        assert found.kind == "table" and found.name == "flat" and found.material is None
        np.testing.assert_array_equal(found.require_table().f, table.f)
        assert found.as_material().expression is None


@pytest.mark.parametrize("subject", [3, None, [EXPRESSION], np.zeros(3), Fitted])
def test_what_is_no_subject_is_refused_by_one_text_in_every_verb(subject):
    verbs = (
        gonio.measure, gonio.fit, gonio.check, gonio.repair, gonio.material,
        lambda s: gonio.reduce(s, "matte_room"), lambda s: gonio.report((s,)),
    )  # fmt: skip
    for verb in verbs:
        with pytest.raises(GonioError, match="is neither a table nor a model; give a file"):
            verb(subject)


def test_every_verb_takes_a_path_and_names_the_remedy_for_a_model(table_file, tmp_path):
    assert gonio.fit(table_file, "lambert").converged
    assert gonio.check(table_file).kind == "table" and gonio.measure(table_file, scan=GRID).layout == GRID
    with undrawn():
        assert "flat" in gonio.report([table_file], check=False)
    for verb in (gonio.fit, gonio.repair, lambda s: gonio.reduce(s, "matte_room")):
        with pytest.raises(GonioError, match="measure it first"):
            verb(EXPRESSION)


def test_streams_are_bounded_and_binary(table_file):
    class Endless(io.RawIOBase):
        name = "/somewhere/endless.bin"

        def read(self, size=-1):
            return bytes(LARGEST_STREAM // 8)

    with pytest.raises(GonioError, match=r"^endless\.bin gives more than 256 MiB; give the file's path$"):
        resolve_subject(Endless())
    with pytest.raises(GonioError, match="gives text, not bytes; open the file as 'rb'"):
        resolve_subject(io.StringIO("f"))
    with pytest.raises(GonioError, match=r"^stream is binary of an unknown kind"):
        resolve_subject(io.BytesIO(b"\0" * 99))


def test_a_bare_model_is_named_by_its_expression():
    assert material_of(build(EXPRESSION)).name == EXPRESSION
