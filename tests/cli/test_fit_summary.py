"""What a fit says on a terminal: the same as it knows."""

import re

import numpy as np
import pytest

from gonio.__main__ import main
from gonio.cli.fit_summary import summary
from gonio.data.flags import Flag
from gonio.data.hdf5.writer import write_table
from gonio.fitting.fit_table import fit
from support.fit_tables import table_of


@pytest.fixture(scope="module")
def table():
    made = table_of("lambert(rho=[.1,.2,.4])+[.6,.5,.4]*ggx(alpha=0.3)", noise=0.02)
    valid = np.flatnonzero(made.flag.ravel() == Flag.VALID)
    made.flag.ravel()[valid[::100]] = Flag.SATURATED
    made.f.ravel()[valid[1::100]] *= -1
    made.name = "mine"
    return made


def test_lines_hold_what_the_result_knows(table):
    result = fit(table, "lambert + ggx", starts=0, bootstrap=5, robust=True)
    said = summary(result)
    text = "\n".join(said)
    for p in result.parameters:
        (line,) = [x for x in text.splitlines() if x.startswith(p.label)]
        assert f"{p.value:.8g}" in line and line.endswith(p.status)
    assert "robust tukey" in said[0] and "5 refits, 0 failed" in text and "95 % of refits" in text
    assert f"CIEDE2000 {result.colour_difference['mean']:.3g}" in text
    assert f"{result.counts['saturated']} masked as saturated" in text and "negative (used as they are)" in text
    assert all(f"residuals: {s}" in said for s in result.residuals.sentences)


def test_options_reach_the_fit(table, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_table("t.h5", table)
    base = ["fit", "t.h5", "-m", "lambert + ggx", "--starts", "0", "-o", "t.fit.toml", "--force"]
    assert main([*base, "--robust", "--bootstrap", "4", "--bootstrap-kind", "block_pairs", "--weight", "cosine"]) == 0
    said = capsys.readouterr().out
    assert "weight cosine, robust tukey" in said and "bootstrap (block_pairs): 4 refits" in said
    for bad, word in (
        (["--robust", "tuky"], "tukey"),
        (["--bootstrap", "1"], "from 2"),
        (["--weight", "cos"], "cosine"),
    ):
        assert main([*base, *bad]) == 2
        error = capsys.readouterr().err
        assert word in error and "Traceback" not in error


def test_the_report_page_shows_it_too(table):
    from gonio.reports.build import report

    result = fit(table, "lambert + ggx", starts=0, bootstrap=5, robust=True)
    page = report([table], fits=[result], check=False)
    assert "incident and outgoing angle" in page and "half and difference angle" in page
    for sentence in result.residuals.sentences:
        assert sentence[1:40] in page
    text = re.sub(r"<[^>]*>", "", page)
    assert "Bootstrap (wild): 5 refits" in text and "95 % of refits" in text
    assert f"CIEDE2000 {result.colour_difference['mean']:#.3g}" in text and "robust tukey" in text
