"""The report in a real browser: silent console, no request, all figures laid out, a telephone's width, print."""

import dataclasses
import re
import zlib

import pytest

import gonio
from support.browser import CHROMIUM, browser
from support.tables import grey_table

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to load the page in")

LAID_OUT = """(async () => {
    for (let y = 0; y < document.documentElement.scrollHeight; y += 800) {
        scrollTo(0, y);
        await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
    }
    const tall = e => e.getBoundingClientRect().height > 20;
    const drawn = c => c.getContext("2d").getImageData(0, 0, c.width, c.height).data.some(v => v > 0);
    return {
        hidden: [...document.querySelectorAll("svg.panel")].filter(e => !tall(e) && !e.closest(".still")).length,
        figures: [...document.querySelectorAll("figure[id], .bar[id]")].filter(tall).length,
        lobes: [...document.querySelectorAll("canvas")].filter(c => tall(c) && drawn(c)).length,
        wide: document.documentElement.scrollWidth,
        resources: performance.getEntriesByType("resource").filter(r => !r.name.startsWith("data:")).length,
        equations: [...document.querySelectorAll("math[display=block]")].filter(tall).length,
    };
})()"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A page of one checked table, and one of several materials."""
    folder = tmp_path_factory.mktemp("pages")
    one = dataclasses.replace(grey_table(0.2), name="a " + "very_long_name" * 8)
    gonio.report(one, folder / "one.html")
    several = [f"lambert(rho={(k + 1) / 13:.3f}) + ggx(alpha=0.{k + 10})" for k in range(3)]
    gonio.report(several, folder / "several.html", check=False)
    return folder


def figures_in_pdf(data):
    """Pages of a PDF, and how many figure captions are in its tagged structure."""
    texts = []
    for match in re.finditer(rb"stream\r?\n(.*?)endstream", data, re.S):
        try:
            texts.append(zlib.decompress(match[1]))
        except zlib.error:
            continue
    whole = data + b"".join(texts)
    return len(re.findall(rb"/Type\s*/Page\b", whole)), len(re.findall(rb"/S\s*/Figure\b", whole))


@pytest.mark.parametrize(("name", "subjects"), [("one", 1), ("several", 3)])
def test_a_browser_shows_it_without_complaint(pages, name, subjects):
    path = pages / f"{name}.html"
    expected = len(re.findall(r'<(?:figure|div class="bar") id=', path.read_text()))
    assert expected >= 9 * subjects
    with browser() as b:
        for width, mobile, dark in ((1280, False, False), (390, True, True)):
            b.screen(width, mobile=mobile, dark=dark)
            b.open(path.as_uri())
            shown = b.evaluate(LAID_OUT)
            assert shown["figures"] == expected and shown["lobes"] == subjects and shown["hidden"] == 0, shown
            assert shown["wide"] <= width and shown["resources"] == 0 and shown["equations"] >= 4, shown
        assert b.console == [] and all(r.startswith(("file:", "data:")) for r in b.requests)
        assert {r for r in b.requests if r.startswith("file:")} == {path.as_uri()[:200]}


def test_lobes_turn_by_keys_and_pointer(pages):
    with browser() as b:
        b.screen(1280)
        b.open((pages / "one.html").as_uri())
        look = "document.querySelector('canvas').toDataURL().length + document.querySelector('canvas').toDataURL()"
        wait = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        b.evaluate("document.querySelector('canvas').scrollIntoView()")
        b.evaluate(f"{wait}.then(() => {wait})")
        pictures = [b.evaluate(look)]
        b.evaluate("document.querySelector('canvas').focus()")
        for key in ("ArrowLeft", "ArrowUp", "+"):
            b.ask("Input.dispatchKeyEvent", type="keyDown", key=key)
            b.evaluate(wait)
            pictures.append(b.evaluate(look))
        middle = (
            "(r => [r.x + r.width / 2, r.y + r.height / 2])(document.querySelector('canvas').getBoundingClientRect())"
        )
        box = b.evaluate(middle)
        for kind, dx in (("mousePressed", 0), ("mouseMoved", 60), ("mouseReleased", 60)):
            b.ask(
                "Input.dispatchMouseEvent", type=kind, x=box[0] + dx, y=box[1], button="left", buttons=1, clickCount=1
            )
        b.evaluate(wait)
        pictures.append(b.evaluate(look))
        b.ask("Input.dispatchKeyEvent", type="keyDown", key="Home")
        b.evaluate(wait)
        assert len(set(pictures)) == len(pictures) and b.evaluate(look) == pictures[0]


def test_paper_has_all_the_figures(pages):
    path = pages / "one.html"
    expected = path.read_text().count('class="panel"')
    with browser() as b:
        b.screen(1280)
        b.open(path.as_uri())
        data = b.pdf()
        b.ask("Emulation.setEmulatedMedia", media="print")
        tall = "[...document.querySelectorAll('svg.panel')].filter(e => e.getBoundingClientRect().height > 20).length"
        assert b.evaluate(tall) == expected
        assert b.evaluate("document.documentElement.scrollWidth") <= 1280
    sheets, figures = figures_in_pdf(data)
    assert 2 <= sheets <= 12 and figures >= expected, (sheets, figures)
