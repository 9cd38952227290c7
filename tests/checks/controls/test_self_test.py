import json

import pytest

from gonio.__main__ import main
from gonio.checks.certify import check
from gonio.checks.controls import self_test as testing
from gonio.checks.controls.model_mutants import mutants
from gonio.checks.controls.self_test import Judgement, confusion, must_fail, must_pass
from gonio.checks.controls.table_mutants import honest_tables, table_mutants
from gonio.models.errors import GonioError


@pytest.mark.parametrize("part", [5, pytest.param(1, marks=pytest.mark.thorough)], ids=["one in five", "every one"])
def test_mutant_tables_are_caught_by_what_gives_them_away_and_the_honest_ones_pass(part):
    for t in honest_tables():
        assert must_pass("honest", t.mistake, check(t.table, against=t.meant), undecided=t.undecided).right
    mutant_tables = table_mutants()
    judged = [must_fail("", m.mistake, m.gives_away, check(m.table, against=m.meant)) for m in mutant_tables[::part]]
    assert [one.subject for one in judged if not one.right] == []
    assert sum(-1 in {side for pair in m.table.sides for side in pair} for m in mutant_tables) == 14


@pytest.mark.parametrize("mistake", ["α taken for α²", "channels exchanged"])
def test_mutant_models_are_caught_by_what_gives_them_away(mistake):
    m = next(m for m in mutants() if m.mistake == mistake)
    assert must_fail("", "", m.gives_away, check(m.model, against=m.meant)).right


def test_a_model_agrees_with_itself_and_counts_where_it_does_not():
    assert check("lambert(rho=0.5)", against="lambert(rho=0.5)").overall == "pass"
    certificate = check("lambert(rho=0.5)", against="lambert(rho=0.51)")
    assert certificate.overall == "fail" and certificate["agreement"].residual == pytest.approx(0.01 / 0.505)


def test_channels_that_cannot_be_compared_are_refused():
    with pytest.raises(GonioError, match="channels"):
        check("lambert(rho=[0.5, 0.2])", against="lambert(rho=[0.5, 0.2, 0.1])")


@pytest.mark.parametrize(("right", "status"), [(True, 0), (False, 1)])
def test_the_self_test_ends_well_only_if_every_verdict_is_right(monkeypatch, tmp_path, capsys, right, status):
    judgements = [Judgement("liar", "a", "energy", "energy", True), Judgement("honest", "b", "pass", "energy", right)]
    monkeypatch.setattr(testing, "self_test", lambda: iter(judgements))
    assert main(["check", "--self-test", "--json", str(tmp_path / "t.json")]) == status
    assert "2 subjects" in capsys.readouterr().out
    assert json.loads((tmp_path / "t.json").read_text())["confusion"] == confusion(judgements)
    assert confusion(judgements)["honest: pass"] == {"right": int(right), "wrong": int(not right)}
