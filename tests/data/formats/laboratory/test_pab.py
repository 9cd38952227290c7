"""Goniophotometer text of pab: one incidence a file, or several joined; the readings are of a closed form."""

import numpy as np
import pytest

from gonio.data.formats.registry import read
from gonio.models.errors import GonioError
from support.closed_form import anisotropic, largest_error, vector


def text(theta_i, phi_i, kind="DSF", end="\n", key="#intheta {}\n#inphi {}\n"):
    """A file of one incidence, degrees, of detector directions on both sides of the sample."""
    rng = np.random.default_rng(int(theta_i))
    theta, phi = np.concatenate([rng.uniform(0, 85, 15), rng.uniform(95, 180, 15)]), rng.uniform(0, 360, 30)
    wi = vector(*np.radians([[theta_i], [phi_i]]))
    f = anisotropic(wi, vector(np.radians(theta), np.radians(phi)))
    values = f * np.abs(np.cos(np.radians(theta))) if kind == "DSF" else f
    rows = "".join(f"{a!r}\t{b!r}\t{v!r}\n" for a, b, v in np.column_stack([theta, phi, values]).tolist())
    head = f'#sample_name "a sheet"\n#format: theta phi {kind}\n' + key.format(theta_i, phi_i)
    return (head + rows).replace("\n", end)


@pytest.mark.parametrize(("kind", "end"), [("DSF", "\n"), ("BSDF", "\r\n"), ("BRDF", "\n\r")])
def test_one_incidence_with_reflection_and_transmission(tmp_path, kind, end):
    (tmp_path / "a.dat").write_text(text(30, 200, kind, end), newline="")
    table = read(tmp_path / "a.dat")
    assert table.name == "a sheet" and table.sides == {(1, 1), (1, -1)}
    assert largest_error(table, anisotropic) < 1e-12 and table.f.size == 30


def test_joined_files_have_an_incidence_each_and_light_may_come_from_behind(tmp_path):
    (tmp_path / "a.dat").write_text(text(10, 0) + text(130, 40, key="#incident_angle {} {}\n"))
    table = read(tmp_path / "a.dat")
    assert largest_error(table, anisotropic) < 1e-12
    assert set(table.sides) == {(1, 1), (1, -1), (-1, 1), (-1, -1)}


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (text(30, 0).replace("#inphi", "#in"), "the direction of the light"),
        (text(30, 0).replace("phi DSF", "phi counts"), "expected '#format: theta phi BSDF'"),
        (text(30, 0, "BSDF") + text(40, 0), "joins files of"),
        ("#intheta 3\n#inphi x\n", "#inphi is 'x'"),
        ("#intheta 3\n#inphi 3\n#format: theta phi DSF\n", "no rows of readings"),
        (text(30, 0) + "1 2\n", "2 columns, expected 3"),
    ],
)
def test_a_header_without_incidence_or_quantity_is_refused(tmp_path, made, expected):
    (tmp_path / "bad.dat").write_text(made)
    with pytest.raises(GonioError, match=expected):
        read(tmp_path / "bad.dat")
