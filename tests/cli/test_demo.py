"""The demonstration: its commands are a user's own, and it ends by naming the page."""

from gonio.__main__ import main
from gonio.cli.verbs import demo_verb


def test_the_demonstration_does_the_whole_job(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demo_verb, "SAMPLES", (demo_verb.Sample("grey_card", ("lambert",)),))
    monkeypatch.setattr(demo_verb, "INSTRUMENT", "--photons 1e6")
    assert main(["demo", "-o", "here"]) == 0
    out = capsys.readouterr().out
    commands = [line.split()[2] for line in out.splitlines() if line.startswith("$ gonio")]
    assert commands == ["measure", "fit", "check", "check", "report"]
    page = tmp_path / "here" / "report.html"
    assert out.rstrip().endswith(f"Open this page in a browser: {page}") and page.stat().st_size > 50_000
    files = {"grey_card.h5", "grey_card.fit.toml", "report.html", "report.json"}
    assert {p.name for p in (tmp_path / "here").iterdir()} == files


def test_a_file_in_the_way_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demo").write_text("mine")
    assert main(["demo"]) == 2
    assert "is a file" in capsys.readouterr().err and (tmp_path / "demo").read_text() == "mine"
