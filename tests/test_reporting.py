"""The report: everything in one page, nothing from elsewhere, and nobody's names run as code."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.data import layout as layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.models.building import build
from gonio.models.errors import GonioError
from gonio.models.evaluate import evaluate

EVIL = "<script>alert('x')</script></script>&\"$"
CHROMIUM = next((p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None)


def table(name="paint", spelling="lambert(rho=[.1,.2,.4]) + ggx(alpha=.3, eta=1.5)", noise=0.01, **fields):
    theta = np.radians(np.arange(0, 86, 10.0))
    layout = layouts.isotropic(theta, theta, np.radians(np.arange(0, 360, 30.0)))
    f = np.asarray(evaluate(build(spelling), *layout.directions())).reshape(*layout.shape, -1)
    f = f * (1 + noise * np.random.default_rng(1).standard_normal(f.shape))
    return whole_table_of_values(layout, f, name=name, **fields)


@pytest.fixture(scope="module")
def fitted():
    t = table()
    t.u_f = 0.01 * np.nan_to_num(np.abs(t.f))
    return t, gonio.fit(t, ["lambert", "lambert + ggx(eta=1.5)"], starts=1)


@pytest.fixture(scope="module")
def page(fitted):
    t, result = fitted
    evil = table(
        EVIL, "lambert(rho=0.2)", provenance={"comment": EVIL, "source": "</table>"}, channels=Channels((EVIL,))
    )
    evil.f[0, 0, 0, 0] = -0.5
    return gonio.report([t, evil, gonio.material("gold")], fits=[result], title=EVIL, command=f"gonio report {EVIL}")


class Reader(HTMLParser):
    """Tags, texts and the embedded values of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.values, self.inside = [], "", False
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.inside = tag == "script"

    def handle_endtag(self, tag):
        self.inside = False

    def handle_data(self, data):
        if self.inside:
            self.values += data


def test_nothing_comes_from_elsewhere(page):
    reader = Reader(page)
    for tag, attributes in reader.tags:
        for key in ("src", "href", "data", "action"):
            value = attributes.get(key) or ""
            assert value == "" or value.startswith(("#", "data:image/png;base64,")), (tag, value)
    assert not re.search(r"url\((?!#|data:)", page) and "@import" not in page and "<link" not in page


def test_names_of_strangers_are_text(page):
    scripts = [a for t, a in Reader(page).tags if t == "script"]
    assert scripts == [{"type": "application/json", "id": "gonio-values"}]
    assert "alert('x')</script>" not in page and "<script>alert" not in page


def test_every_section_has_its_pictures_and_values(page, fitted):
    reader = Reader(page)
    pictures = [a for t, a in reader.tags if t == "svg"]
    assert len(pictures) >= 3 * 7 and all(a.get("aria-label") for a in pictures)
    values = json.loads(reader.values)
    assert list(values) == ["subject-1", "subject-2", "subject-3"]
    first = values["subject-1"]
    assert first["fit"]["asked"] == "lambert + ggx(eta=1.5)" and first["certificate"]["overall"] in page
    assert [c["theta_i_deg"] for c in first["in_plane"]] == [0, 30, 60, 80]
    points = first["readings_in_plane"][1]
    truth = fitted[0].f[3, :, [0, 6], 0]
    assert {float(f"{v:.6g}") for v in truth.ravel()} <= {row[0] for row in points["f_per_sr"]}
    assert len(points["f_per_sr"]) == truth.size + 10  # along the normal every azimuth is in the plane
    assert values["subject-2"]["facts"]["negative readings"] == "1"


def test_ids_are_unique(page):
    ids = re.findall(r'\sid="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_verdicts_stand_before_the_pictures(page):
    assert page.index("Summary") < page.index('class="verdict') < page.index("<svg")


@pytest.mark.parametrize("kind", ["half/difference", "in-plane", "scattered"])
def test_any_layout_makes_a_page(kind):
    layout = {
        "half/difference": layouts.merl(counts=(12, 10, 18)),
        "in-plane": layouts.in_plane(np.radians([10, 40]), np.radians([-60, -30, 30, 60])),
        "scattered": layouts.scattered(*np.random.default_rng(0).uniform(0, 1.2, (4, 60))),
    }[kind]
    flat = whole_table_of_values(layout, np.full(layout.shape, 0.1), name=kind)
    assert gonio.report(flat, check=False).count("<svg") >= 3


def test_a_page_is_whole_or_not_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["report", "perfect_diffuser", "-o", "r.html"]) == 0
    assert "gonio report perfect_diffuser -o r.html" in (tmp_path / "r.html").read_text()
    for command in (
        ["report", "perfect_diffuser", "-o", "r.html"],
        ["report", "absent.h5", "-o", "new.html"],
        ["report", "perfect_diffuser", "-o", "no/new.html"],
        ["report", "perfect_diffuser", "--fit", "gold", "-o", "new.html"],
    ):
        assert main(command) == 2
        assert [p.name for p in tmp_path.iterdir()] == ["r.html"]


def test_fits_find_their_tables(fitted):
    t, result = fitted
    other = table("other", "lambert(rho=0.3)")
    with pytest.raises(GonioError, match="2 fits came for 1 table"):
        gonio.report([t], fits=[result, result], check=False)
    with pytest.raises(GonioError, match="3 channels and other has 1"):
        gonio.report([other], fits=[result], check=False)
    values = json.loads(Reader(gonio.report([other, t], fits=[result], check=False)).values)
    assert values["subject-1"]["fit"] is None and values["subject-2"]["fit"]["converged"]


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to load the page in")
def test_a_browser_shows_it_without_complaint(page, tmp_path):
    """Loaded with the network off: no console message, all pictures laid out, readable at a telephone's width."""
    path = tmp_path / "page.html"
    probe = """<script>addEventListener("load", () => {
        const pictures = [...document.querySelectorAll("svg")];
        const laid = pictures.filter(e => e.getBoundingClientRect().height > 20).length;
        const fits = document.documentElement.scrollWidth <= innerWidth;
        document.title = [pictures.length, laid, fits, performance.getEntriesByType("resource").length].join();
    })</script>"""
    path.write_text(page.replace("</body>", probe + "</body>"), encoding="utf-8")
    for width in (1200, 500):
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
        options += [f"--window-size={width},900", "--host-resolver-rules=MAP * ~NOTFOUND"]
        options += [f"--user-data-dir={tmp_path / str(width)}", path.as_uri()]
        done = subprocess.run([CHROMIUM, *options], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0 and "CONSOLE" not in done.stderr
        there, laid_out, fits, requests = re.search(r"<title>(.*?)</title>", done.stdout)[1].split(",")
        assert int(there) == int(laid_out) >= 21 and fits == "true" and requests == "0"
