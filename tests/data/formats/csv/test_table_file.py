"""Plain CSV: what is written is what is read, and whatever is wrong is said with its line."""

import io

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.formats.csv.columns import CsvText, write_columns
from gonio.data.formats.csv.table_file import read_csv, read_directions, write_csv
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError

GRID = layouts.isotropic(np.radians([0, 17, 60]), np.radians([0, 33, 88, 90]), np.radians([0, 77, 180, 355]))
HEAD = "theta_i,phi_i,theta_o,phi_o,f\n"


def saved(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_angles_are_written_as_people_write_them(tmp_path):
    write_csv(tmp_path / "t.csv", whole_table_of_values(GRID, np.ones(GRID.shape)))
    text = CsvText(tmp_path / "t.csv")
    assert set(text.numbers(["theta_o"])["theta_o"]) == {0.0, 33.0, 88.0}
    assert "\n17.0,0.0,33.0,77.0,1.0\n" in (tmp_path / "t.csv").read_text()


def test_columns_may_come_in_any_order_with_comments_and_others(tmp_path):
    text = "\ufeff# measured on a Monday\n\n# and more\n name ,f_2, phi_o,theta_o,phi_i,theta_i,f_1\r\n"
    text += "a,2,-90,30,10,20,1\n# half-time\n\nb,-4,350,0,360,0,3 # good\n"
    table = read_csv(saved(tmp_path / "t.csv", text))
    np.testing.assert_array_equal(table.f, [[1, 2], [3, -4]])
    np.testing.assert_allclose(np.degrees(table.layout.angles()), [[20, 0], [10, 0], [30, 0], [270, 350]], atol=1e-12)
    assert table.provenance["ignored_columns"] == ["name"] and table.counts()["negative"] == 1


def test_vectors_are_read_as_angles(tmp_path):
    text = "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,f\n0,0,1,0.6,0,0.8,0.5\n0,-0.6,0.8,0,0,1.0004,0.25\n"
    table = read_csv(saved(tmp_path / "t.csv", text))
    wi, wo = table.layout.directions()
    np.testing.assert_allclose(wi, [[0, 0], [0, -0.6], [1, 0.8]], atol=1e-15)
    np.testing.assert_allclose(wo, [[0.6, 0], [0, 0], [0.8, 1]], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("\n\n# nothing\n", "is empty"),
        (HEAD, "header but no rows"),
        (HEAD + "# only a comment\n", "header but no rows"),
        ("theta_i,phi_i,theta_o,f\n1,2,3,4\n", "not phi_o"),
        ("theta_i,phi_i,theta_o,phi_o,value\n1,2,3,4,5\n", "no column f"),
        ("theta_i,phi_i,theta_o,phi_o,f,f\n1,2,3,4,5,6\n", "column 'f' twice"),
        (HEAD + "10,0,20,0,0.3\n\n10,0,twenty,0,0.3\n", "line 4: theta_o is 'twenty'"),
        (HEAD + "10,0,20,0,-inf\n", "line 2: f is -inf"),
        (HEAD + "10,0,20,0,0.1\n10,0,20\n", "line 3: 3 columns"),
        (HEAD + "10,0,20,180,0,3\n", "line 2: 6 columns under a header of 5"),
        (HEAD + "10,0,20,0,0.3\n# x\n10,0,195,0,0.3\n", "line 4: theta_o = 195; expected 0 to 180 degrees"),
        (HEAD + "10,0,20,400,0.3\n", "line 2: phi_o = 400"),
        ("wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,f\n0,0,2,0,0,1,1\n", "line 2: wi is no unit vector"),
        (HEAD.strip() + ",u_f\n10,0,20,0,0.3,-1\n", "line 2: u_f is negative"),
        (HEAD.strip() + ",u_f_1,u_f_2\n10,0,20,0,0.3,1,1\n", "give one for each channel"),
        (HEAD.strip() + ",flag\n10,0,20,0,0.3,9\n", "line 2: a flag is none of 0 to 5"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, said):
    with pytest.raises(GonioError, match=said) as error:
        read_csv(saved(tmp_path / "t.csv", text))
    assert "t.csv" in str(error.value) and "\n" not in str(error.value)


def test_readings_on_the_horizon_have_no_value(tmp_path):
    table = read_csv(saved(tmp_path / "t.csv", HEAD + "90,0,20,0,0.3\n10,0,90,0,0\n10,0,80,0,0.2\n"))
    assert table.flag.ravel().tolist() == [Flag.BELOW_HORIZON, Flag.BELOW_HORIZON, Flag.VALID]


def test_binary_is_no_csv(tmp_path):
    (tmp_path / "t.csv").write_bytes(b"\xff\xfe\x01theta")
    with pytest.raises(GonioError, match="no text file"):
        read_csv(tmp_path / "t.csv")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(alphabet='0123456789.,-+eEnaif \n"#;\t\u00e9', max_size=60), st.booleans())
def test_any_text_reads_or_is_refused_in_one_sentence(tmp_path, text, with_header):
    path = tmp_path / "t.csv"
    path.write_text((HEAD if with_header else "") + text, encoding="utf-8", newline="")
    try:
        table = read_csv(path)
    except GonioError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(table.f[table.layout.readable()]).all()


def test_directions_for_eval_come_with_their_own_columns(tmp_path):
    text = "f,theta_o,phi_o,theta_i,phi_i\n1,30,0.1,90,10\n2,0,360,45,-20\n"
    wi, wo, columns = read_directions(saved(tmp_path / "d.csv", text))
    assert list(columns) == ["theta_o", "phi_o", "theta_i", "phi_i"]
    np.testing.assert_array_equal(columns["phi_i"], [10, -20])
    np.testing.assert_allclose(wi.z, np.cos(np.radians([90, 45])), atol=1e-15)
    np.testing.assert_allclose(wo.x[0], np.sin(np.radians(30)) * np.cos(np.radians(0.1)), rtol=1e-15)
    with pytest.raises(GonioError, match="line 2: theta_o = 191"):
        read_directions(saved(tmp_path / "d.csv", "theta_i,phi_i,theta_o,phi_o\n1,2,191,4\n"))
    out = io.StringIO()
    write_columns(out, {"theta_i": columns["theta_i"], "f": np.array([0.1 + 0.2, 1e-300])})
    assert out.getvalue() == "theta_i,f\n90.0,0.30000000000000004\n45.0,1e-300\n"


def test_nothing_is_written_for_a_table_without_a_reading(tmp_path):
    table = whole_table_of_values(GRID, np.full(GRID.shape, np.nan))
    with pytest.raises(GonioError, match="no valid reading"):
        write_csv(tmp_path / "t.csv", table)
    assert list(tmp_path.iterdir()) == []
    assert set(np.unique(table.flag)) == {Flag.BELOW_HORIZON, Flag.INVALID}
