"""The options of a report on the command line: a page is whole or not there, and its command makes it again."""

import dataclasses
import json
import shlex

from gonio.__main__ import main
from gonio.data.hdf5.writer import write_table
from support.tables import grey_table
from support.undrawn import undrawn


def test_a_page_is_whole_or_not_there(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["report", "perfect_diffuser", "--no-check", "-o", "r.html"]) == 0
    assert "gonio report perfect_diffuser --no-check -o r.html" in (tmp_path / "r.html").read_text()
    (tmp_path / "charts").mkdir()
    (tmp_path / "empty").mkdir()
    (tmp_path / "charts" / "charts.json").write_text('{"charts": {"tables": {"points": 3}}}')
    write_table(tmp_path / "t.h5", dataclasses.replace(grey_table(0.3), name="t"))
    (tmp_path / "v.json").write_text("mine")
    (tmp_path / "other.toml").write_text(
        'gonio_material = 1\nname = "o"\nmodel = "lambert(rho=0.1)"\n[fit]\ntable = "another"\n'
    )
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    capsys.readouterr()
    for command, words in (
        ("perfect_diffuser -o r.html", "exists already"),
        ("perfect_diffuser -o v.html", "v.json exists"),
        ("perfect_diffuser -o new.json", "end it in .html"),
        ("absent.h5 -o new.html", "does not exist"),
        ("perfect_difuser -o new.html", "perfect_diffuser"),
        ("empty -o new.html", "folder"),
        ("v.json -o new.html", "v.json"),
        ("t.h5 -o t.h5 --force", "input"),
        ("perfect_diffuser -o no/new.html", "folder"),
        ("perfect_diffuser --fit gold -o new.html", "not a fitted material"),
        ("t.h5 --fit other.toml -o new.html", "'another', not of t"),
        ("perfect_diffuser --chart empty -o new.html", "charts.json"),
        ("perfect_diffuser --chart charts -o new.html", "no list of charts"),
        ("perfect_diffuser --chart absent -o new.html", "no folder"),
        ("perfect_diffuser --figures v.json -o new.html", "is a file"),
        ("perfect_diffuser --chart charts -o charts/charts.html --force", "input"),
    ):
        assert main(["report", "--no-check", *command.split()]) == 2, command
        out, err = capsys.readouterr()
        assert words in err and err.count("\n") == 1 and out == "", (command, err)
        assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")} == before, command


def test_the_command_on_the_page_makes_it_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_table(tmp_path / "a table.h5", dataclasses.replace(grey_table(0.3), name="t"))
    with undrawn():
        assert main(["report", "a table.h5", "--no-check", "--title", "it's $HOME", "-o", "r.html"]) == 0
        first = json.loads((tmp_path / "r.json").read_text())
        (tmp_path / "r.html").unlink(), (tmp_path / "r.json").unlink()
        assert main(shlex.split(first["command"])[1:]) == 0
    again = json.loads((tmp_path / "r.json").read_text())
    assert {k: v for k, v in again.items() if k != "made"} == {k: v for k, v in first.items() if k != "made"}
