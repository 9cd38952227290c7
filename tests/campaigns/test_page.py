"""The page of a campaign: what it counts, what it draws, and that a stranger's name is no code."""

import re

import numpy as np
import pytest

from gonio.campaigns.catalogue import rows_of
from gonio.campaigns.page import number_panels, page, write_page
from gonio.campaigns.store import DONE, REFUSED, Record, Store
from gonio.campaigns.summary import failing, fits_by_model, noise_curves, number_scatter, quartiles
from gonio.campaigns.tasks import LABELS

HOSTILE = "<script>alert(1)</script> & $x^2$"
SIGMA = 3e-3


def fit(photons, seed, model="ggx", subject=HOSTILE, **row):
    rng = np.random.default_rng([seed, int(photons)])
    u = SIGMA / np.sqrt(photons / 1e4)
    labels = dict.fromkeys(LABELS) | {"subject": subject, "photons": photons, "seed": seed, "model": model}
    labels |= {"instrument": "ideal", "scan": "default"}
    verdict = "good" if model == "ggx" else "failed"
    row = {"verdict": verdict, "relative_rms": 1 / np.sqrt(photons), "reduced_chi2": 1.0, "sentence": "why", **row}
    row["parameters"] = [["ggx.alpha", 0.2 + u * rng.standard_normal(), u, 0.1, 0.3, "determined"]]
    return Record(f"{model}{photons}{seed}", "fit", DONE, verdict == "good", labels, row, "", 0.2, 0.1, "fits/x.toml")


@pytest.fixture(scope="module")
def rows():
    records = [fit(photons, seed) for photons in (1e4, 1e6) for seed in range(200)]
    records += [fit(1e4, seed, "lambert", relative_rms=0.5) for seed in range(2)]
    labels = dict.fromkeys(LABELS) | {"subject": "<b>bad</b>"}
    records.append(Record("t", "measure", REFUSED, False, labels, {}, "it was <i>refused</i>"))
    old = fit(1e4, 999)
    return rows_of([*records, old], [r.key for r in records])


def test_counts_and_medians_are_of_the_last_recipe(rows):
    right, wrong = fits_by_model(rows)
    assert right.verdicts == {"good": 400} and wrong.verdicts == {"failed": 2}
    assert wrong.relative_rms == (0.5, 0.5, 0.5) and right.relative_rms[1] == pytest.approx((1e-2 + 1e-3) / 2)
    assert [r["kind"] for r in failing(rows)] == ["measure", "fit", "fit"]
    assert np.isnan(quartiles([{"x": None}], "x")).all()


def test_residuals_are_shown_against_photons(rows):
    (curve,) = noise_curves(rows)[HOSTILE]
    assert curve.model == "ggx" and curve.photons.tolist() == [1e4, 1e6]
    np.testing.assert_allclose(curve.rms, np.broadcast_to([1e-2, 1e-3], (3, 2)))


def test_scatter_of_honest_fits_is_what_they_state(rows):
    scatter = number_scatter(rows)
    assert [s.count for s in scatter] == [200, 200]  # two fits have no scatter
    for s in scatter:
        assert s.ratio == pytest.approx(1, abs=4 / np.sqrt(400)) and s.median == pytest.approx(0.2, abs=s.uncertainty)
    assert len(number_panels(scatter, fits_by_model(rows))) == 1


def test_a_page_is_self_contained_and_no_name_is_code(rows):
    text = page("<em>campaign</em>", rows)
    assert "<script" not in text and "<em>" not in text and "<i>" not in text and "<b>bad" not in text
    assert "&lt;script&gt;" in text and not re.search(r'(?:src|href)="(?!#|data:)', text)
    assert text.count("<svg") == 2 and "1 results of other recipes" in text


def test_a_page_of_nothing_is_a_page():
    assert "no task was refused" in page("", []) and "not done" not in page("", [])


def test_a_page_says_how_many_tasks_are_not_done(tmp_path, rows):
    store = Store(tmp_path)
    store.prepare()
    store.write_plan("half done", ["a" * 32, "b" * 32, "c" * 32])
    store.write_record(Record("b" * 32, "fit", "refused", False, {}, {}, "no reading"))
    assert store.not_done() == 2
    assert "2 tasks are not done" in write_page(store, rows).read_text("utf-8")
