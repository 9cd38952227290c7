"""A fit on a terminal: its lines hold what the result holds."""

import re

import numpy as np
import pytest

from gonio.__main__ import main
from gonio.cli.verbs.fit_verb import summary
from gonio.data.flags import Flag
from gonio.data.hdf5.writer import write_table
from gonio.fitting.fit_table import fit
from support.fit_tables import table_of
from support.undrawn import undrawn


@pytest.fixture(scope="module")
def table():
    noisy = table_of("lambert(rho=[.1,.2,.4])+[.6,.5,.4]*ggx(alpha=0.3)", noise=0.02)
    valid = np.flatnonzero(noisy.flag.ravel() == Flag.VALID)
    noisy.flag.ravel()[valid[::100]] = Flag.SATURATED
    noisy.f.ravel()[valid[1::100]] *= -1
    noisy.name = "noisy"
    return noisy


def test_lines_hold_what_the_result_holds(table):
    result = fit(table, "lambert + ggx", starts=0, bootstrap=5, robust=True)
    lines = summary(result)
    text = "\n".join(lines)
    for p in result.parameters:
        (line,) = [x for x in text.splitlines() if x.startswith(p.label)]
        assert f"{p.value:.8g}" in line and line.endswith(p.status)
    assert lines[0] == result.judgement.sentence and "robust tukey" in lines[1]
    assert "5 refits, 0 failed" in text and "95 % of refits" in text
    assert f"CIEDE2000 {result.colour_difference['mean']:.3g}" in text
    assert f"{result.counts['saturated']} masked as saturated" in text and "negative (used as they are)" in text
    assert all(f"residuals: {s}" in lines for s in result.residuals.sentences)


def test_options_reach_the_fit(table, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_table("t.h5", table)
    base = ["fit", "t.h5", "-m", "lambert + ggx", "--starts", "0", "-o", "t.fit.toml", "--force"]
    assert main([*base, "--robust", "--bootstrap", "4", "--bootstrap-kind", "block_pairs", "--weight", "cosine"]) == 0
    out = capsys.readouterr().out
    assert "weight cosine, robust tukey" in out and "bootstrap (block_pairs): 4 refits" in out


def test_an_old_name_of_a_bootstrap_is_replaced_with_a_remark(table, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_table("t.h5", table.only(["R"]))
    # A diffuser explains nothing of a lobe: the status is that of a fit that failed.
    assert main(["fit", "t.h5", "-m", "lambert", "--starts", "0", "--bootstrap", "2", "--bootstrap-kind", "pairs"]) == 1
    out, err = capsys.readouterr()
    assert out.startswith("A FAILED FIT")
    assert "bootstrap (block_pairs): 2 refits" in out and "pairs is called block_pairs now" in err


def test_the_report_page_shows_it_too(table):
    from gonio.reports.build import report

    result = fit(table, "lambert + ggx", starts=0, bootstrap=5, robust=True)
    with undrawn():
        page = report([table], fits=[result], check=False)
    assert "incident and outgoing angle" in page and "half and difference angle" in page
    for sentence in result.residuals.sentences:
        assert sentence[1:40] in page
    text = re.sub(r"<[^>]*>", "", page)
    assert "Bootstrap (wild): 5 refits" in text and "95 % of refits" in text
    assert f"CIEDE2000 {result.colour_difference['mean']:#.3g}" in text and "robust tukey" in text
