"""CSV as people, spreadsheets and instruments write it: read where it is unambiguous, else refused with the remedy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.formats.csv.table_file import read_csv, read_directions
from gonio.models.errors import GonioError

GRID = layouts.isotropic(np.radians([10, 30, 60]), np.radians([0, 20, 50, 80]), np.radians(np.r_[0:360:60]))
NAMES = ("theta_i", "phi_i", "theta_o", "phi_o")
HEAD = "theta_i,phi_i,theta_o,phi_o,f\n"
ROW = "10,0,20,0,0.3\n"


def surface(theta_i, phi_i, theta_o, phi_o):
    """f of a reciprocal, bright surface with a wide lobe about the mirror direction."""
    x = np.sin(theta_i) * np.cos(phi_i) + np.sin(theta_o) * np.cos(phi_o)
    y = np.sin(theta_i) * np.sin(phi_i) + np.sin(theta_o) * np.sin(phi_o)
    return 0.05 + 0.2 * np.exp(-3 * (x**2 + y**2))


ANGLES = np.array(GRID.angles())
F = surface(*ANGLES)
DEGREES = np.degrees(ANGLES)


def write(path, header, columns, delimiter=",", decimal=".", encoding="utf-8", before=""):
    """A CSV of columns of numbers or of texts."""
    cells = [[c if isinstance(c, str) else f"{c:.10g}".replace(".", decimal) for c in column] for column in columns]
    lines = [delimiter.join(header), *(delimiter.join(row) for row in zip(*cells, strict=True))]
    path.write_bytes((before + "\n".join(lines) + "\n").encode(encoding))
    return path


@pytest.fixture
def path(tmp_path):
    return tmp_path / "t.csv"


def assert_truth(table, scale=1.0):
    assert table.layout.name == "isotropic" and table.layout.shape == GRID.shape
    valid = table.flag[..., 0] == Flag.VALID
    np.testing.assert_allclose(table.f[..., 0][valid], scale * F.reshape(GRID.shape)[valid], rtol=1e-8)
    return valid


@pytest.mark.parametrize("header", [
    ("Theta_i [deg]", "Phi_i [deg]", "Theta_r [deg]", "Phi_r [deg]", "BRDF [1/sr]"),
    ("theta_in (degrees)", "phi_in (degrees)", "theta_out (degrees)", "phi_out (degrees)", "f (sr^-1)"),
    ("θi", "φi", "θr", "φr", "fr"),
    ("incident zenith_deg", "incident azimuth_deg", "view zenith_deg", "view azimuth_deg", "BRDF_1/sr"),
    ("THETAI", "PHII", "THETAR", "PHIR", "bsdf"),
])  # fmt: skip
@pytest.mark.parametrize("delimiter", [";", "\t", ",", "|", "  "])
@pytest.mark.parametrize("decimal", [".", ","])
def test_headers_delimiters_and_decimal_commas(path, header, delimiter, decimal):
    if delimiter == "  ":
        header = [name.replace(" ", "_").replace("_[", " [").replace("_(", " (") for name in header]
    if delimiter == "," and decimal == ",":
        columns = [[f'"{x:.10g}"'.replace(".", ",") for x in c] for c in (*DEGREES, F)]
        write(path, header, columns)
    else:
        write(path, header, (*DEGREES, F), delimiter, decimal)
    assert_truth(read_csv(path)).all()


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_encodings_and_lines_before_the_header(path, encoding):
    write(path, (*NAMES, "f"), (*DEGREES, F), encoding=encoding, before="Prüfling 7\nInstrument: §3\n\n# ±0.1\n")
    assert_truth(read_csv(path)).all()


@pytest.mark.parametrize("before", ["", "# deg deg deg deg 1/sr\n"])
def test_headers_as_numpy_writes_them_and_units_in_a_row(path, before):
    write(path, ("# theta_i", *NAMES[1:], "f"), (*DEGREES, F), " ")
    assert_truth(read_csv(path)).all()
    units = [[u, *map(str, c)] for u, c in zip(("rad", "rad", "rad", "rad", "1/sr"), (*ANGLES, F), strict=True)]
    write(path, (*NAMES, "f"), units, ";")
    table = read_csv(path)
    assert_truth(table).all()
    assert table.provenance["angles"] == "radians (the header says so)"


@pytest.mark.parametrize("missing", ["", "nan", "NaN", "NA", " ", "-"])
def test_missing_cells_are_missing_and_flagged(path, missing):
    cells = [missing if k % 7 == 0 else f"{f:.10g}" for k, f in enumerate(F)]
    write(path, (*NAMES, "f"), (*DEGREES, cells))
    table = read_csv(path)
    valid = assert_truth(table)
    assert (~valid).sum() == len(cells[::7]) == table.counts()["not_measured"]
    assert any("missing" in sentence for sentence in table.provenance["understood"])


@pytest.mark.parametrize("number", [-999, -9999, -99, -999.9, 9999, 1e30, -1])
def test_numbers_that_look_like_no_reading_are_asked(path, number):
    values = np.where(np.arange(F.size) % 5 == 0, number, F)
    write(path, (*NAMES, "f"), (*DEGREES, values))
    with pytest.raises(GonioError, match=rf"line 2: f is .*state --missing {number:g}".replace("+", r"\+")):
        read_csv(path)
    assert read_csv(path, missing=number).counts()["not_measured"] == np.sum(values == number)
    assert read_csv(path, missing="none").counts()["not_measured"] == 0
    write(path, (*NAMES, "f"), (*DEGREES, values), before=f"# missing value: {number:.10g}\n")
    assert_truth(read_csv(path))


def test_signed_polar_angles_lie_on_the_other_side(path):
    signed = np.arange(-80.0, 81, 10)
    write(path, (*NAMES, "f"), (np.full(17, -30.0), np.zeros(17), signed, np.zeros(17), np.full(17, 0.1)))
    table = read_csv(path)
    assert table.layout.name == "in_plane" and np.allclose(table.layout.angles()[0], np.radians(30))
    _, wo = table.layout.directions()
    np.testing.assert_allclose(np.sort(np.degrees(np.arctan2(wo.x, wo.z))), np.sort(signed), atol=1e-12)
    assert sum("phi + 180" in s for s in table.provenance["understood"]) == 2


@pytest.mark.parametrize(("columns", "values"), [
    (("theta_i", "theta_o", "delta_phi"), (0, 2, 3)),
    (("aoi", "theta_r", "Δφ"), (0, 2, 3)),
    (("theta_i", "theta_o", "phi_i", "dphi"), (0, 2, 1, 3)),
])  # fmt: skip
def test_azimuth_differences(path, columns, values):
    write(path, (*columns, "f"), (*DEGREES[list(values)], F))
    assert_truth(read_csv(path)).all()


def test_half_and_difference_angles(path):
    grid = layouts.half_difference(*(np.radians(np.r_[0:90:step]) for step in (10, 15)), np.radians(np.r_[0:180:30]))
    nodes = [
        np.degrees(a[k])
        for a, k in zip(grid.axes.values(), np.unravel_index(range(grid.size), grid.shape), strict=True)
    ]
    write(path, ("theta_h", "theta_d", "phi_d", "f"), (*nodes, np.full(grid.size, 0.1)))
    table = read_csv(path)
    assert table.layout.name == "half_difference" and table.layout.shape == grid.shape
    assert table.counts()["valid"] == grid.readable().sum()


@pytest.mark.parametrize(("names", "nm"), [
    (("f_450", "f_550", "f_650"), (450, 550, 650)),
    (("650", "450", "550"), (650, 450, 550)),
    (("450nm", "550nm", "650nm"), (450, 550, 650)),
    (("BRDF@633", "BRDF@532", "BRDF@1064"), (633, 532, 1064)),
    (("f_0.45", "f_0.55", "f_0.65"), (450, 550, 650)),
    (("0.45um", "3.2um", "10.6um"), (450, 3200, 10600)),
    (("f(450)", "f(550)", "f(650.5)"), (450, 550, 650.5)),
    (("f_532 [nm]", "f_633 [nm]", "f_700 [nm]"), (532, 633, 700)),
    (("4.5e-7 m", "5.5e-7 m", "6.5e-7 m"), (450, 550, 650)),
])  # fmt: skip
def test_wavelengths_in_the_header_are_channels_in_order(path, names, nm):
    write(path, (*NAMES, *names), (*DEGREES, *(F * (1 + w / 1e4) for w in nm)))
    table = read_csv(path)
    assert table.channels.wavelengths_nm == tuple(sorted(map(float, nm)))
    for k, w in enumerate(sorted(nm)):
        np.testing.assert_allclose(table.f[..., k].ravel(), F * (1 + w / 1e4), rtol=1e-8)


def test_wavelengths_in_a_comment_and_in_rows(path):
    write(path, (*NAMES, "f_1", "f_2"), (*DEGREES, F, 2 * F), before="# wavelengths: 0.45, 0.55 um\n")
    assert read_csv(path).channels.wavelengths_nm == (450, 550)
    wavelengths, rows = np.repeat([633.0, 532.0], F.size), np.tile(DEGREES, 2)
    write(path, ("lambda [nm]", *NAMES, "f"), (wavelengths, *rows, np.r_[2 * F, F]))
    table = read_csv(path)
    assert table.channels.wavelengths_nm == (532, 633)
    assert_truth(table).all()
    np.testing.assert_allclose(table.f[..., 1], 2 * table.f[..., 0])
    write(path, ("lambda [nm]", *NAMES, "f"), [c[:-3] for c in (wavelengths, *rows, np.r_[2 * F, F])])
    assert read_csv(path).counts()["not_measured"] == 3


@pytest.mark.parametrize(("unit", "scale"), [("degrees", 180 / np.pi), ("radians", 1.0)])
@pytest.mark.parametrize("comment", ["# angles in {}\n", "# all angles: {}\n", "# theta and phi are {}, steradian\n"])
def test_the_unit_of_angles_is_read_or_stated(path, unit, scale, comment):
    write(path, (*NAMES, "f"), (*ANGLES * scale, F), before=comment.format(unit))
    table = read_csv(path)
    assert_truth(table).all()
    assert table.provenance["angles"] == f"{unit} (a comment says so)" and "warnings" not in table.provenance
    write(path, (*NAMES, "f"), (*ANGLES * scale, F))
    assert_truth(read_csv(path, angles=unit)).all()
    np.testing.assert_allclose(read_directions(path, unit).wi.z, np.cos(ANGLES[0]))


@pytest.mark.parametrize(("quantity", "factor"), [
    ("brdf", np.ones_like(F)),
    ("brdf_cos", np.cos(ANGLES[2])),
    ("brdf_cos_i", np.cos(ANGLES[0])),
    ("reflectance_factor", np.full_like(F, np.pi)),
    ("i_over_f", np.pi * np.cos(ANGLES[0])),
])  # fmt: skip
def test_the_quantity_is_stated_or_read(path, quantity, factor):
    header = {"brdf": "BRDF", "brdf_cos": "f cos(theta_o)", "brdf_cos_i": "f_cos_theta_i", "i_over_f": "I/F"}
    for name, options, before in (
        ("f", {"quantity": quantity}, ""),
        (header.get(quantity, "Reflectance Factor"), {}, ""),
        ("f", {}, f"# quantity: {quantity}\n"),
    ):
        write(path, (*NAMES, name, "u_f"), (*DEGREES, F * factor, 0.01 * F * factor), before=before)
        table = read_csv(path, **options)
        assert_truth(table).all()
        np.testing.assert_allclose(table.u_f, 0.01 * table.f)
        assert table.provenance["quantity"].split()[0] == quantity


def test_uncertainties_expanded_and_in_per_cent(path):
    write(path, (*NAMES, "f", "u_f"), (*DEGREES, F, 0.02 * F), before="# expanded uncertainties, k = 2\n")
    np.testing.assert_allclose(read_csv(path).u_f[..., 0].ravel(), 0.01 * F)
    write(path, (*NAMES, "f", "u_f [%]"), (*DEGREES, F, np.full(F.size, 3.0)))
    np.testing.assert_allclose(read_csv(path).u_f[..., 0].ravel(), 0.03 * F)
    write(path, (*NAMES, "Reflectance factor [%]"), (*DEGREES, 100 * np.pi * F))
    assert_truth(read_csv(path)).all()


def test_azimuth_0_again_at_360_is_one_reading(path):
    again = DEGREES[3] == 0
    columns = np.hstack([DEGREES, DEGREES[:, again] + [[0], [0], [0], [360]]])
    write(path, (*NAMES, "f"), (*columns, np.r_[F, F[again]]))
    assert_truth(read_csv(path)).all()
    write(path, (*NAMES, "f", "u_f"), (*columns, np.r_[F, 3 * F[again]], np.ones(columns.shape[1])))
    table = read_csv(path)
    np.testing.assert_allclose(table.f[..., 0, 0], 2 * F.reshape(GRID.shape)[..., 0])
    np.testing.assert_allclose(table.u_f[..., 0, 0], np.sqrt(0.5))


def test_readings_taken_again_and_again_stay_a_list(path):
    write(path, (*NAMES, "f"), (*np.hstack([DEGREES, DEGREES]), np.r_[F, F]))
    table = read_csv(path)
    assert table.layout.name == "scattered" and table.layout.size == 2 * F.size


PLAIN = (np.degrees(ANGLES[0]), np.degrees(ANGLES[2]), DEGREES[3], np.pi * F)
LABORATORIES = {
    "the detector's azimuth alone": ("Theta_i [°]", "Theta_r [°]", "Phi_r [°]", "Beta [-]", "U(Beta) (k=2) [%]"),
    "an azimuth of neither side": (
        "incidence angle (deg)", "viewing angle", "azimuth (deg)", "reflectance factor", "expanded uncertainty %"),
    "relative": ("theta_i", "theta_v", "phi_v", "BRF", "U95_rel_percent"),
}  # fmt: skip


@pytest.mark.parametrize("header", LABORATORIES.values(), ids=LABORATORIES)
@pytest.mark.parametrize("mirror", [180, 0])
def test_columns_of_laboratories_with_one_azimuth_and_expanded_uncertainties(path, header, mirror):
    """Reflectance factors with k = 2 uncertainties of 3 %, in a file whose azimuth is counted from the light's."""
    theta_i, theta_o, phi, beta = PLAIN
    columns = (theta_i, theta_o, (phi + 180 - mirror) % 360, beta, np.full(beta.size, 3.0))
    write(path, header, columns, ";", ",", encoding="latin-1", before="Probe;17\n")
    table = read_csv(path, mirror_azimuth=None if mirror == 180 else 0)
    assert_truth(table)
    values = table.read_values()
    np.testing.assert_allclose(values["u_f"], 0.015 * values["f"], rtol=1e-6)
    understood = "; ".join(table.provenance["understood"])
    assert "azimuth" in understood and "expanded by k = 2" in understood and "per cent of f" in understood


def test_signed_angles_of_half_planes_with_the_mirror_side_at_0(path):
    theta_i, theta_o, phi, beta = PLAIN
    turned = (phi >= 180) & (theta_o > 0)
    signed, plane = np.where(turned, -theta_o, theta_o), np.where(turned, phi - 180, phi)
    write(path, ("theta_i", "theta_r", "phi_r", "BRF"), (theta_i, signed, (plane + 180) % 360, beta))
    assert_truth(read_csv(path, mirror_azimuth=0))


def test_the_coverage_of_uncertainties_is_told_or_stated(path):
    write(path, (*NAMES, "f", "U [%]"), (*DEGREES, F, np.full(F.size, 2.0)))
    table = read_csv(path)
    assert any("k = 1" in s and "--coverage" in s for s in table.provenance["understood"])
    np.testing.assert_allclose(read_csv(path, coverage=2).u_f, 0.5 * table.u_f)
    with pytest.raises(GonioError, match="coverage factor"):
        read_csv(path, coverage=0)
    write(path, ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z", "f"), [[v] for v in (0.6, 0, 0.8, -0.6, 0, 0.8, 1)])
    with pytest.raises(GonioError, match="no azimuths"):
        read_csv(path, mirror_azimuth=0)
    write(path, (*NAMES, "f"), (*DEGREES, F))
    with pytest.raises(GonioError, match="give 0 or 180"):
        read_csv(path, mirror_azimuth=90)


@pytest.mark.parametrize(("text", "options", "remedy"), [
    ("theta_i,phi_i,theta_s,phi_s,f\n" + ROW, {}, "theta_s may be either side's"),
    ("theta_i,theta_o,f\n10,20,0.3\n", {}, "delta_phi"),
    ("theta_i [gon],phi_i,theta_o,phi_o,f\n" + ROW, {}, "convert it to deg or rad"),
    ("theta_i,phi_i,theta_o,phi_o,f_3,f_5,f_8\n10,0,20,0,1,2,3\n", {}, "number channels from 1, or write the unit"),
    ("theta_i,phi_i,theta_o,phi_o,f,f_450\n10,0,20,0,1,2\n", {}, "keep one column f"),
    ("theta_i,phi_i,theta_o,phi_o,f_450,f_450nm\n10,0,20,0,1,2\n", {}, "450 nm twice"),
    ("theta_i,phi_i,theta_o,phi_o,f [%]\n" + ROW, {}, "expected 1/sr"),
    ("lambda," + HEAD + "1," + ROW, {}, "'lambda \\[nm\\]'"),
    ("# angles in radians\n" + HEAD + ROW, {}, "expected 0 to 3.14159 radians"),
    ("# angles in radians or degrees\n" + HEAD + ROW, {}, "state --angles"),
    ("# reflectance factors divided by pi\n" + HEAD + ROW, {}, "state --quantity"),
    ("theta_i [deg],phi_i,theta_o,phi_o,f\n" + ROW, {"angles": "radians"}, "leave --angles out"),
    ("# angles in radians\n" + HEAD + ROW, {"angles": "degrees"}, "leave --angles out"),
    ("# gonio: angles in degrees\n" + HEAD + ROW, {"angles": "radians"}, "leave --angles out"),
    (HEAD + ROW, {"angles": "gon"}, "give degrees or radians"),
    (HEAD + ROW, {"quantity": "brf"}, "is unknown"),
    (HEAD + ROW, {"missing": "x"}, "give it, or none"),
    (HEAD.replace(",", ";") + "10;0;20;0;1.234,5\n", {}, "f is '1.234,5'"),
    ("# wavelengths: 450, 550 nm\ntheta_i,phi_i,theta_o,phi_o,f_1\n" + ROW, {}, "list one each"),
])  # fmt: skip
def test_what_cannot_be_known_is_asked_with_the_remedy(path, text, options, remedy):
    path.write_text(text, encoding="utf-8")
    with pytest.raises(GonioError, match=remedy) as error:
        read_csv(path, **options)
    assert "\n" not in str(error.value) and len(str(error.value)) < 300 + len(str(path))


def test_ten_thousand_columns_are_refused_in_a_short_sentence(path):
    write(path, ("theta_i", *(f"c{k}" for k in range(10_000))), [[1]] * 10_001)
    with pytest.raises(GonioError, match="10001 columns") as error:
        read_csv(path)
    assert len(str(error.value)) < 300 + len(str(path))


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        (HEAD + f'10,0,20,0,"{"7" * 200_000}"\n', "hold no cells"),
        ("theta_i," * 100_000 + "\n" + ROW, "has 100,001 columns in its first line"),
        (" é" * 300_000, "has 300,000 columns in its first line"),
    ],
    ids=["cell", "columns", "blanks"],
)
def test_what_is_no_table_at_all_is_refused_at_once(path, text, remedy):
    path.write_text(text, encoding="utf-8")
    with pytest.raises(GonioError, match=remedy) as error:
        read_csv(path)
    assert "\n" not in str(error.value) and len(str(error.value)) < 400


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_columns_rows_units_and_forms_at_random(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("forms") / "t.csv"
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    unit = data.draw(st.sampled_from(["deg", "rad"]))
    form = data.draw(st.sampled_from(["{} [%s]", "{} (%s)", "{}_%s"])) % unit
    delimiter, decimal = data.draw(st.sampled_from([(";", ","), (";", "."), (",", "."), ("\t", ","), ("|", ".")]))
    angles = DEGREES if unit == "deg" else ANGLES
    header, columns = [*map(form.format, NAMES), "f_450nm", "f_0.55um"], [*angles, F, 3 * F]
    rows, order = rng.permutation(F.size), rng.permutation(6)
    write(path, [header[k] for k in order], [columns[k][rows] for k in order], delimiter, decimal)
    table = read_csv(path)
    assert_truth(table).all()
    assert table.channels.names == ("450 nm", "550 nm")
    np.testing.assert_allclose(table.f[..., 1], 3 * table.f[..., 0], rtol=1e-8)


@pytest.mark.parametrize(
    ("name", "u"),
    [
        ("u_f", 2.0), ("uncertainty", 2.0), ("U(f) (k=2)", 1.0), ("expanded uncertainty (k = 2)", 1.0), ("U95", 1.0),
        ("U_k2_percent", 0.5), ("U95 (%)", 0.5), ("rel. uncertainty [%]", 1.0), ("u_rel", 100.0),
        ("relative expanded uncertainty (k=2) [%]", 0.5), ("standard_uncertainty", 2.0), ("sigma_f_percent", 1.0),
    ],
)  # fmt: skip
def test_uncertainties_say_k_and_per_cent_in_their_names(path, name, u):
    write(path, [*NAMES, "f", name], [[0.0] * 3, [0.0] * 3, [0.0, 10.0, 25.0], [0.0] * 3, [50.0] * 3, [2.0] * 3])
    np.testing.assert_allclose(read_csv(path).read_values()["u_f"], u)


def test_one_column_of_per_cents_is_of_all_wavelengths(path):
    columns = [[0.0] * 3, [0.0] * 3, [0.0, 10.0, 25.0], [0.0] * 3, [50.0] * 3, [10.0] * 3, [2.0] * 3]
    write(path, [*NAMES, "f_450nm", "f_550nm", "U_k2_percent"], columns)
    np.testing.assert_allclose(read_csv(path).read_values()["u_f"], [[0.5, 0.1]] * 3)


@pytest.mark.parametrize(("light", "mirror"), [(1, 1), (-1, 1)])
def test_signed_angles_without_azimuths_are_in_the_plane_of_incidence(path, light, mirror):
    """With the light above 0 the mirror side is above 0; with the light below 0 both angles are in one frame."""
    theta_i, theta_o = (a.ravel() for a in np.meshgrid([20.0, 45.0], np.arange(-60, 61, 15.0), indexing="ij"))
    f = np.where(theta_o > 0, 1.0, 0.5)
    write(path, ["theta_i", "theta_r", "f"], [light * theta_i, mirror * theta_o, f])
    table = read_csv(path)
    assert table.layout.in_one_plane
    wo, wi = table.read().wo, table.read().wi
    specular = -np.asarray(wo.x) * np.asarray(wi.x) > 1e-9
    np.testing.assert_allclose(table.read_values()["f"][:, 0], np.where(specular, 1.0, 0.5))


def test_unsigned_angles_without_azimuths_are_refused(path):
    write(path, ["theta_i", "theta_r", "f"], [[20.0, 20.0], [10.0, 30.0], [0.5, 0.5]])
    with pytest.raises(GonioError, match="above 0 on the mirror side"):
        read_csv(path)


def test_fortrans_exponents_and_the_typesetters_minus_are_numbers(path):
    columns = [[f"{c:.10E}".replace("E", "D").replace("-", "\N{MINUS SIGN}") for c in column] for column in DEGREES]
    write(path, (*NAMES, "f"), (*columns, [f"{x:.12E}".replace("E", "d") for x in F]), ";")
    assert_truth(read_csv(path)).all()
    path.write_text(HEAD + "10,0,20,0,0.5-100\n")
    with pytest.raises(GonioError, match=r"f is '0\.5-100'; expected a number"):
        read_csv(path)


def test_elevations_are_refused_with_what_to_do(path):
    write(path, ("elevation_i", "phi_i", "elev_o", "phi_o", "f"), (*DEGREES, F))
    with pytest.raises(GonioError, match="elevation_i counts from the surface: give 90° less it"):
        read_csv(path)


@pytest.mark.parametrize(
    "u, factor, warned", [(None, 1.02, False), (None, 1.5, True), (0.02, 1.02, False), (1e-4, 1.02, True)]
)
def test_readings_repeated_with_other_values_are_averaged_and_contradictions_said(path, u, factor, warned):
    again = np.flatnonzero(ANGLES[2] > 0)[::5]
    columns = [np.r_[c, c[again]] for c in (*DEGREES, F)]
    columns[-1][F.size :] *= factor
    names = (*NAMES, "f")
    if u is not None:
        columns, names = [*columns, u * columns[-1]], (*names, "u_f")
    table = read_csv(write(path, names, columns))
    read = table.f[..., 0].ravel()[again]
    np.testing.assert_allclose(read, F[again] * (1 + factor) / 2, rtol=1e-8)
    assert any("differ by" in sentence for sentence in table.provenance["understood"])
    assert any("read again" in sentence for sentence in table.provenance.get("warnings", [])) is warned


@pytest.mark.parametrize("pi", ["3.14159265359", "3.141592741", "3.1415926535897936"])
def test_half_a_turn_in_radians_may_end_above_its_last_digit(path, pi):
    """As many digits round π up, or single precision does."""
    path.write_text(f"theta_i [rad],phi_i [rad],theta_o [rad],phi_o [rad],f\n0.1,0,{pi},0,0.3\n", encoding="utf-8")
    assert read_csv(path).layout.angles()[2] == np.pi
