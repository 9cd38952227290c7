"""The report: everything in one page, nothing from elsewhere, nobody's names run as code, every value in its JSON."""

import dataclasses
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.hdf5.writer import write_table
from gonio.data.table import Channels, whole_table_of_values
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from support.fit_tables import table_of
from support.marks import thorough
from support.tables import grey_table
from support.undrawn import undrawn

EVIL = "<script>alert('x')</script></script>&\"$"


PAINT = "lambert(rho=[.1,.2,.4]) + ggx(alpha=.3, eta=1.5)"
PLANE = layouts.in_plane(np.radians([10, 20, 40]), np.radians(np.arange(-60, 61, 10.0)))
POLAR = np.radians(np.arange(0, 86, 10.0))
ISOTROPIC = layouts.isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 30.0)))


def flat_table(layout=PLANE, name="flat", channels=None, f=0.1):
    return whole_table_of_values(layout, np.full((*layout.shape, len(channels or "1")), f), channels, name=name)


@pytest.fixture(scope="module")
def fitted():
    t = table_of(PAINT, ISOTROPIC, noise=0.01, name="paint")
    t.u_f = 0.01 * np.nan_to_num(np.abs(t.f))
    return t, gonio.fit(t, ["lambert", "lambert + ggx(eta=1.5)"], starts=1)


@pytest.fixture(scope="module")
def written(fitted, tmp_path_factory):
    """(path of the page, its text, its values)."""
    t, result = fitted
    evil = dataclasses.replace(
        grey_table(0.2, 10, 30),
        name=EVIL,
        provenance={"comment": EVIL, "source": "</table>"},
        channels=Channels((EVIL,)),
    )
    evil.f[0, 0, 0, 0] = -0.5
    path = tmp_path_factory.mktemp("page") / "r.html"
    gonio.report([t, evil, "lambert(rho=0.5)"], path, fits=[result], title=EVIL, command=f"gonio report {EVIL}")
    return path, path.read_text(), json.loads(path.with_suffix(".json").read_text())


class Reader(HTMLParser):
    """Tags of a page, the texts of its scripts, and of its table cells with the marked values that stand in them."""

    VOID = ("meta", "img", "br", "input", "line", "mspace")

    def __init__(self, text):
        super().__init__()
        self.tags, self.scripts, self.cells, self.marked = [], [], [], []
        self.open = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.tags.append((tag, attributes))
        if tag == "script":
            self.scripts.append("")
        if tag == "td" or (tag == "th" and attributes.get("scope") == "row"):
            self.cells.append("")
        if "data-at" in attributes:
            self.marked.append((attributes["data-at"], ""))
        if tag not in self.VOID:
            self.open.append((tag, "data-at" in attributes))

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        while self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, data):
        names = [tag for tag, _ in self.open]
        if "script" in names:
            self.scripts[-1] += data
        elif any(marked for _, marked in self.open):
            self.marked[-1] = (self.marked[-1][0], self.marked[-1][1] + data)
        elif self.cells and ("td" in names or ("th" in names and "tbody" in names)):
            self.cells[-1] += data


def value_at(values, pointer):
    for key in pointer.split("/")[1:]:
        values = values[int(key)] if isinstance(values, list) else values[key]
    return values


def number(text):
    """(value, half a unit of its last digit) of a number as the page writes it."""
    plain = text.replace("−", "-").replace(",", "")
    mantissa, _, power = plain.partition("×10")
    exponent = int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 0)
    decimals = len(mantissa.partition(".")[2])
    return float(mantissa) * 10.0**exponent, 0.5001 * 10.0 ** (exponent - decimals)


def test_nothing_comes_from_elsewhere(written):
    for tag, attributes in Reader(written[1]).tags:
        for key in ("src", "href", "data", "action"):
            value = attributes.get(key) or ""
            assert value == "" or value.startswith(("#", "data:image/png;base64,")), (tag, value)
    assert not re.search(r"url\((?!#|data:)", written[1]) and "@import" not in written[1] and "<link" not in written[1]


def test_names_of_strangers_are_text(written):
    reader = Reader(written[1])
    scripts = [a for t, a in reader.tags if t == "script"]
    assert scripts == [{"type": "application/json", "id": "gonio-lobes"}, {}]
    assert "alert('x')" not in "".join(reader.scripts) and "<script>alert" not in written[1]
    assert (written[2]["title"], written[2]["subjects"][1]["name"]) == (EVIL, EVIL)


def test_every_number_of_the_tables_is_in_the_values(written):
    """Each cell's digits stand in marked values, and each of those says what the JSON holds at its place."""
    _, text, values = written
    reader = Reader(text)
    assert len(reader.marked) > 200
    unmarked = [cell for cell in reader.cells if re.search(r"\d", cell.replace("95 %", ""))]
    assert unmarked == [] or set(unmarked) == {"1"}, unmarked  # a unit of dimension 1
    numbers = 0
    for pointer, shown in reader.marked:
        expected = value_at(values, pointer)
        if isinstance(expected, int | float) and not isinstance(expected, bool):
            value, half = number(shown)
            assert abs(value - expected) <= max(half, 1e-12 * abs(expected)), (pointer, shown, expected)
            # A number that is not 0 must not look like it, unless its uncertainty says so.
            assert value != 0 or expected == 0 or "parameters" in pointer or "numbers" in pointer, (pointer, shown)
            numbers += 1
        else:
            assert shown == str(expected), pointer
    assert numbers > 100


def test_every_figure_is_there_with_its_numbers(written):
    _, text, values = written
    ids = re.findall(r'\sid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    pictures = [a for t, a in Reader(text).tags if t == "svg" and a.get("class") == "panel"]
    assert all(a["aria-label"] for a in pictures)
    listed = [f for s in values["subjects"] for f in s["figures"]] + values["comparison"]["figures"]
    assert len(pictures) == len(listed) == len({f["id"] for f in listed})
    assert all(f["data"] and f["id"] in ids for f in listed)
    slugs = [{f["id"].removeprefix(f"{s['anchor']}-") for f in s["figures"]} for s in values["subjects"]]
    every = {"polar-linear", "polar-log", "plane-linear", "plane-log", "lobe", "spheres", "albedo", "reciprocity"}
    assert all(every <= s for s in slugs)
    of_fits = {"correlations", "residuals", "residuals-half", "residuals-polar", "slice-model"}
    assert of_fits | {"p-values", "slice-readings"} <= slugs[0]


def test_values_are_those_of_the_table(written, fitted):
    first = written[2]["subjects"][0]
    assert first["fits"][0]["asked"] == "lambert + ggx(eta=1.5)" and first["certificate"]["overall"] in written[1]
    plane = next(f["data"] for f in first["figures"] if f["id"] == "subject-1-polar-log")
    assert [c["theta_i_deg"] for c in plane["lines"]] == [0, 30, 60, 80]
    truth = fitted[0].f[3, :, [0, 6], 1]
    shown = plane["readings"][1]["f_per_sr"]
    assert {float(f"{v:.6g}") for v in truth.ravel()} <= set(shown)
    assert len(shown) == truth.size + 10  # along the normal every azimuth is in the plane
    facts = {f["name"]: f["value"] for f in written[2]["subjects"][1]["facts"]}
    assert facts["negative readings"] == 1
    sphere = next(f["data"] for f in first["figures"] if f["id"].endswith("lobe"))
    assert [s["name"] for s in sphere["sources"]] == ["readings, interpolated", "model fitted"]


def test_verdicts_stand_before_the_pictures(written):
    text = written[1]
    assert text.index("Summary") < text.index('class="verdict') < text.index('<svg viewBox="0 0 3')


def test_energy_that_the_readings_leave_open_is_decided_by_the_fit(written, fitted):
    alone = next(p for p in gonio.check(fitted[0]).properties if p.name == "energy")
    of_page = next(p for p in written[2]["subjects"][0]["certificate"]["properties"] if p["name"] == "energy")
    assert (alone.verdict, of_page["verdict"]) == ("undecided", "pass")
    assert f"Model-assisted: the albedo of {fitted[1].requested}" in of_page["detail"]


def test_agreement_with_a_truth_is_named():
    with undrawn():
        text = gonio.report(flat_table(), against="lambert(rho=0.1)")
    assert "reciprocity, energy and agreement</span>." in text and "✗ " in text


@pytest.mark.parametrize("kind", ["half/difference", "scattered", "masked", *thorough("in-plane", "spectral")])
def test_any_table_makes_a_page(kind):
    scattered = layouts.scattered(*np.random.default_rng(0).uniform(0, 1.2, (4, 60)))
    layout = {"half/difference": layouts.merl(counts=(8, 6, 12)), "in-plane": PLANE}.get(kind, scattered)
    channels = Channels.of_wavelengths(np.linspace(380, 780, 41)) if kind == "spectral" else None
    flat = flat_table(layout, kind, channels, np.nan if kind == "masked" else 0.1)
    text = gonio.report(flat, check=kind == "masked")
    assert text.count('class="panel"') >= (0 if kind == "masked" else 3)
    assert ("No valid reading" in text) == (kind == "masked") and ("not checked" in text)


def test_figures_are_files_too(tmp_path):
    flat = flat_table(name="a/../<b>")
    text = gonio.report(flat, check=False, figures=tmp_path / "figures")
    files = sorted((tmp_path / "figures").iterdir())
    assert len(files) == 2 * text.count('class="panel"') and files[0].name.startswith("01-a_.._b-")
    for file in files:
        start = file.read_bytes()[:200]
        assert start.startswith(b"\x89PNG") or b'xmlns="http://www.w3.org/2000/svg"' in start
    with pytest.raises(GonioError, match="holds files already"):
        gonio.report(flat, check=False, figures=tmp_path / "figures")


def test_fits_find_their_tables(fitted):
    _, result = fitted
    with pytest.raises(GonioError, match="1 fits came for no table"):
        gonio.report(["lambert(rho=0.5)"], fits=[result], check=False)
    with pytest.raises(GonioError, match="is of 'paint', not of other"):
        gonio.report([flat_table(name="other")], fits=[result], check=False)
    with pytest.raises(GonioError, match="3 channels and paint has 1"):
        gonio.report([flat_table(name="paint")], fits=[result], check=False)


def test_every_subject_makes_a_page_and_an_unknown_option_is_refused(fitted, tmp_path):
    path = tmp_path / "t.h5"
    write_table(path, flat_table(name="t"))
    subjects = [path, str(path), fitted[1], build("lambert(rho=0.5)"), gonio.material("lambert(rho=0.5)")]
    with undrawn():
        text = gonio.report(subjects, check=False)
    assert text.count('class="key"') >= 2 * len(subjects) and "t (1)" in text and "A good fit: it converged" in text
    with pytest.raises(TypeError, match="report has no option 'fit'"):
        gonio.report(path, fit=[fitted[1]])
    with pytest.raises(GonioError, match="A dict is neither a table nor a model"):
        gonio.report([{}])
