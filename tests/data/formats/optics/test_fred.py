"""FRED files: the specular direction, signed angles, logarithms and scale, VIAVI's form, and what is refused."""

import numpy as np
import pytest

from gonio.data.flags import Flag
from gonio.data.formats.registry import read, sniff
from gonio.models.errors import GonioError

HEAD = "type bsdf_data\nformat angles=deg bsdf=value scale=1\n"
PLANE = "".join(f"{t} 0\n" + "".join(f"{s} 0 {1 + t + s / 100:.3f}\n" for s in range(-60, 61, 20)) for t in (0, 15, 40))


def written(folder, text):
    path = folder / "t.txt"
    path.write_text(text)
    return path


def test_signed_angles_of_one_plane_are_a_grid_with_the_specular_side_positive(tmp_path):
    path = written(tmp_path, HEAD + PLANE)
    table = read(path)
    assert sniff(path).name == "FRED" and table.layout.name == "in_plane"
    np.testing.assert_allclose(np.degrees(table.layout.axes["theta_o"]), range(-60, 61, 20))
    np.testing.assert_array_equal(table.f[1, :, 0], [round(1 + 15 + s / 100, 3) for s in range(-60, 61, 20)])


def test_the_light_comes_from_the_other_side_of_the_specular_direction(tmp_path):
    table = read(written(tmp_path, HEAD + "30 20\n30 20 5\n30 200 1\n30 110 2\n"))
    block = table.read()
    mirror = np.argmin(np.abs(block.wi.x + block.wo.x) + np.abs(block.wi.y + block.wo.y))
    retro = np.argmin(np.abs(block.wi.x - block.wo.x) + np.abs(block.wi.y - block.wo.y))
    assert block.f[mirror, 0] == 5 and block.f[retro, 0] == 1
    assert np.degrees(np.arctan2(block.wi.y[0], block.wi.x[0])) % 360 == pytest.approx(200)


def test_logarithms_and_the_scale(tmp_path):
    text = HEAD.replace("value", "log").replace("scale=1", "scale = 2") + "0 0\n10 0 -2\n20 0 -1\n30 0 nan\n"
    table = read(written(tmp_path, text))
    np.testing.assert_allclose(table.f[:2, 0], [0.02, 0.2])
    assert table.flag[:, 0].tolist() == [Flag.VALID, Flag.VALID, Flag.INVALID]


def test_the_form_of_viavi_and_directions_behind_the_sample(tmp_path):
    rows = "".join(f"{t}.0000 {p}.0000 {0.5 / (1 + t):.4f}\n" for t in range(0, 80, 20) for p in range(0, 360, 60))
    table = read(written(tmp_path, "!!EDS10 10-105     RPC Photonics\n!!BSDF Data\n10.000 105.000\n" + rows))
    assert table.provenance["comments"][1] == "BSDF Data" and (table.flag == Flag.VALID).all()
    behind = read(written(tmp_path, HEAD + "10 0\n" + rows.replace("20.0000 ", "120.0000 ")))
    assert behind.sides == {(1, -1)}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD.replace("deg", "sin") + "0 0\n0 0 1\n", "its angles are 'sin', whose order nobody states"),
        (HEAD + "0 0 1\n", "a value comes before any specular direction"),
        (HEAD + "0 0\n", "it has no reading"),
        (HEAD + "95 0\n0 0 1\n", "the specular direction has theta 95"),
        (HEAD + "0 0\n0,5 0 1\n", "has decimal commas; write the file with decimal points"),
        (HEAD + "0 0\n0 0 1 2\n", "expected theta and phi in degrees, or these and a value"),
        (HEAD + "0 0\nnan 0 1\n", "expected theta and phi in degrees"),
        (HEAD.replace("scale=1", "scale=1,5") + "0 0\n0 0 1\n", "its scale is '1,5'"),
        (HEAD.replace("value", "power") + "0 0\n0 0 1\n", "its bsdf is 'power'"),
    ],
)
def test_what_is_damaged_is_refused_in_one_sentence(tmp_path, text, said):
    with pytest.raises(GonioError) as error:
        read(written(tmp_path, text))
    assert said in str(error.value) and "\n" not in str(error.value)
