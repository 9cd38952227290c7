"""Laboratories' headers of two lines, wavelengths as rows, degree signs in cells and remarks below the last row."""

import numpy as np
import pytest

from gonio.data.formats.registry import read
from gonio.models.errors import GonioError

TWO_LINES = (
    "Prüfbericht 17;;;;;\nBezug: ideal mattweiße Fläche;;;;;\nEinstrahlwinkel;Beobachtungswinkel;450 nm;;550 nm;\n"
    "θi / °;θr / °;β / %;U (k=2) / %;β / %;U (k=2) / %\n0;-45;21,5;0,8;33,25;0,6\n45;0;21,25;0,8;33,0;0,6\n"
)


def test_the_upper_line_of_a_header_names_groups_of_columns(tmp_path):
    path = tmp_path / "de.csv"
    path.write_text("\ufeff" + TWO_LINES, encoding="utf-8")
    table = read(path)
    assert table.channels.wavelengths_nm == (450.0, 550.0)
    np.testing.assert_allclose(table.f * np.pi * 100, [[21.5, 33.25], [21.25, 33.0]])
    np.testing.assert_allclose(table.u_f * np.pi * 100, [[0.4, 0.3]] * 2)
    assert any("two lines" in s for s in table.provenance["understood"])


@pytest.mark.parametrize("upper", ["", ";;450 nm;;450 nm;", "a;b;c"])
def test_names_that_stay_the_same_twice_are_refused(tmp_path, upper):
    path = tmp_path / "de.csv"
    path.write_text(TWO_LINES.replace("Einstrahlwinkel;Beobachtungswinkel;450 nm;;550 nm;", upper), encoding="utf-8")
    with pytest.raises(GonioError, match="twice"):
        read(path)


def test_rows_of_wavelengths_under_pairs_of_angles_are_turned_over(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text("# Radiance factor of T-3\nwavelength (nm),0/45,45/-15,8/8\n400,0.2,0.3,0.4\n550,0.5,0.6,0.7\n")
    table = read(path)
    assert table.channels.wavelengths_nm == (400.0, 550.0) and table.provenance["quantity"] == "reflectance_factor"
    theta_i, _, theta_o, _ = np.degrees(table.layout.angles())
    f = dict(zip(zip(theta_i.round().tolist(), theta_o.round().tolist(), strict=True), table.f * np.pi, strict=True))
    np.testing.assert_allclose([f[0, 45], f[45, 15], f[8, 8]], [[0.2, 0.5], [0.3, 0.6], [0.4, 0.7]])
    path.write_text(path.read_text().replace("550,", "n/a,"))
    with pytest.raises(GonioError, match="not theta_i"):
        read(path)


def test_sides_with_degree_signs_and_a_last_remark(tmp_path):
    path = tmp_path / "tab.txt"
    header = "Goniometer GX-2\tOperator: N.N.\n\nIncidence [°]\tDetector [°]\tAzimuth [°]\tBRDF [1/sr]\n"
    path.write_text(header + "8°\t8°\t180°\t1.5E-1\n8°\t30°\t0°\t1.2E-1\n\nend of data\n", encoding="latin-1")
    table = read(path)
    np.testing.assert_allclose(table.f[:, 0], [0.15, 0.12])
    assert any("'end of data' below the last row" in s for s in table.provenance["understood"])
