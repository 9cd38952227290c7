"""JSON of every verb that says numbers: valid, of one convention, alone on standard output."""

import argparse
import json
import math

import pytest

from gonio.__main__ import VERBS, main
from gonio.charts.point import Axis, Chart, Point
from gonio.cli.arguments import writing_json
from gonio.cli.program import WITHOUT_JSON
from gonio.data.serialise import finite

GREY = "lambert(rho=0.25)"
COMMANDS = {
    "materials": "gold",
    "models": "ggx",
    "eval": f"{GREY} --theta-i 30 --theta-o 0:80:40",
    "measure": f"{GREY} --step 30 --dry-run",
    "plan": f"{GREY} --budget 10min -o p.csv",
    "info": "t.h5 d.csv",
    "fit": "t.h5 -m lambert -o t.fit.toml",
    "check": f"{GREY} nothing",
    "quantities": GREY,
    "campaign": "campaign.toml -o runs --dry-run",
    "chart": "tables --quick",
    "stress": "lambert --quick --processes 1",
    "reduce": "t.h5 --scene matte_room -o r.h5",
    "report": f"{GREY} --no-check -o r.html",
    "convert": "t.h5 t.csv",
}
REFUSED = {"check", "info"}
"""Of these commands one subject is none: the status of the others is not lost by it."""


def refuse(token):
    raise AssertionError(f"{token} is no JSON")


@pytest.fixture
def quick(monkeypatch):
    """A chart and an atlas that take no time; what they are made of is their own tests' to say."""
    from gonio.charts import diagrams
    from gonio.stability import survey
    from gonio.stability.outcome import Cell

    axes = Axis("time", "time"), Axis("error", "error")
    points = [Point("p", "m", "s", {"time": 1.0, "error": math.nan}), Point("p", "n", "s", {"time": 2.0, "error": 0.1})]
    chart = Chart("tables", "tables", "about", (axes,), lambda settings: iter(points))
    monkeypatch.setitem(diagrams.CHARTS, "tables", chart)
    cell = Cell("value", "lambert", "lambert(rho=1)", "grazing", "float64", "silently wrong", math.inf, 0.0, "far off")
    monkeypatch.setattr(survey, "atlas", lambda *_: iter([(("lambert", "value"), [cell])]))


def test_every_verb_is_tried():
    assert COMMANDS.keys() == VERBS.keys() - set(WITHOUT_JSON)


@pytest.mark.parametrize("verb", COMMANDS)
def test_json_is_valid_alone_and_of_one_convention(here, quick, capsys, verb):
    (here / "q").mkdir()
    status = main([verb, *split(COMMANDS[verb]), "--json"])
    out, _ = capsys.readouterr()
    content = json.loads(out, parse_constant=refuse)
    head = dict(list(content.items())[:4])
    assert head["gonio_json"] == 1 and head["verb"] == verb and head["exit_status"] == status
    assert status in (0, 1, 3) or verb in REFUSED
    for pointer, reason in content.get("null", {}).items():
        assert (reason and at(content, pointer) is None) or isinstance(at(content, pointer), list)


def split(text):
    import shlex

    return shlex.split(text.replace(GREY, f"'{GREY}'"))


def at(content, pointer):
    for key in pointer.split("/")[1:]:
        content = content[int(key) if isinstance(content, list) else key.replace("~1", "/").replace("~0", "~")]
    return content


def test_reasons_stand_beside_nulls_by_their_pointers():
    content = {"a/b": {"c": [1.0, math.nan, math.inf]}, "d": -math.inf, "e": 1}
    assert finite(content) == {
        "a/b": {"c": [1.0, None, None]},
        "d": None,
        "e": 1,
        "null": {"/a~1b/c": "2 of 3: infinite, not known", "/d": "minus infinite"},
    }
    assert at(finite(content), "/a~1b/c") == [1.0, None, None] and "null" not in finite({"e": 1})


def test_json_and_the_other_output_are_both_there_or_neither(here):
    args = argparse.Namespace(json=str(here / "x.json"), verb="fit", force=False)
    with pytest.raises(RuntimeError), writing_json(args, {"a": 1}):
        raise RuntimeError
    assert not (here / "x.json").exists()
    with writing_json(args, {"a": 1}, 3):
        pass
    assert json.loads((here / "x.json").read_text())["exit_status"] == 3
