"""The summary of residuals of a fit: noise or structure, outliers, counts, and what is written of them."""

import dataclasses

import numpy as np
import pytest

from gonio.data.flags import Flag
from gonio.fitting.fit_table import fit
from support.fit_tables import ISOTROPIC, table_of

TRUTH = "lambert(rho=[.1,.2,.4])+[.6,.5,.4]*ggx(alpha=0.3)"


@pytest.fixture(scope="module")
def right():
    return fit(table_of(TRUTH, noise=0.01), "lambert + ggx", starts=0)


def test_a_right_model_leaves_noise_and_a_wrong_one_structure(right):
    assert right.residuals.noisiness.verdict == "noise" and "are noise" in right.residuals.sentences[0]
    assert right.residuals.scale == pytest.approx(0.01, rel=0.05)
    wrong = fit(table_of(TRUTH, noise=0.01), "lambert", starts=0)
    assert wrong.residuals.noisiness.verdict == "structure"
    assert "structure, not noise" in wrong.residuals.sentences[0] and "darker" in wrong.residuals.worst_region
    assert right.colour_difference["mean"] < 1 < 5 < wrong.colour_difference["mean"]
    assert wrong.residuals.maps["half_difference"].median_relative[0, 0] < -0.3


def test_everything_is_in_what_is_written(right):
    import json

    import tomli_w

    from gonio.data.serialise import plain

    written = right.to_dict()
    assert written["residuals"]["maps"]["incident_outgoing"]["count"] and written["colour_difference"]["pixels"] > 100
    assert "evidence" not in written and written["counts"]["used"] == right.samples
    json.dumps(plain(written), allow_nan=False)
    tomli_w.dumps(right.to_material_dict("right"))
    assert dataclasses.replace(right, notes=[]).residuals.noisiness == right.residuals.noisiness


def test_masked_missing_and_negative_are_counted_apart():
    table = table_of("lambert(rho=0.3)")
    valid = np.flatnonzero(table.flag.ravel() == Flag.VALID)
    for k, flag in enumerate((Flag.SATURATED, Flag.SHADOWED, Flag.NOT_MEASURED)):
        table.flag.ravel()[valid[k::50]] = flag
    table.f.ravel()[valid[10::50]] *= -1
    remaining = valid.size - sum(valid[k::50].size for k in range(3))
    near = np.minimum(*(w.z for w in ISOTROPIC.directions())) > np.cos(np.radians(60))
    counts = fit(table, "lambert", theta_max=np.radians(60)).counts
    usable = (table.flag.ravel() == Flag.VALID) & near
    assert counts["used"] == np.count_nonzero(usable) and counts["left_out"] == remaining - counts["used"]
    assert counts["saturated"] == valid[::50].size and counts["shadowed"] == valid[1::50].size
    assert counts["missing"] == valid[2::50].size
    assert counts["negative"] == np.count_nonzero(usable & (table.f.ravel() < 0)) > 0


def test_numbers_that_go_together_are_listed():
    table = table_of("0.6*ggx(alpha=0.3, f0=0.1)+lambert(rho=.2)", noise=0.01)
    result = fit(table, "lambert + ggx(f0=?)", theta_max=np.radians(56), starts=0)
    (pair, *_) = result.correlated
    assert {pair["a"], pair["b"]} == {"ggx.f0", "ggx.scale"} and pair["correlation"] < -0.95
