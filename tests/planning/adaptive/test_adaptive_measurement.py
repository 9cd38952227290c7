"""Adaptive measurement: it ends as it says, keeps to its time, and goes on bit for bit where it was killed."""

import itertools

import numpy as np
import pytest

import gonio
from gonio.data.hdf5.writer import open_table
from gonio.data.interpolation.multilinear import as_material
from gonio.data.subject import load_material
from gonio.instrument.instrument import Instrument
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical
from gonio.planning.adaptive import adaptive_measurement
from gonio.planning.adaptive.accuracy import difference, random_directions
from gonio.planning.ways import ways_of

SATIN = "lambert(rho=0.3) + ggx(alpha=0.3, f0=0.04)"


def true_error(table, material=SATIN):
    """Of the table as everything reads it, over new directions."""
    angles = random_directions(1000, Instrument(), True, np.random.default_rng(7))
    wi, wo = (from_spherical(*angles[k : k + 2], np) for k in (0, 2))
    values = [
        np.asarray(evaluate(b, wi, wo)).reshape(1000, -1) for b in (as_material(table), load_material(material).brdf)
    ]
    return float(np.sqrt(np.mean(difference(*values)[0] ** 2)))


def test_a_target_is_shown_and_true():
    lines = []
    table = gonio.adapt(SATIN, target=0.03, log=lines.append)
    kept = table.provenance["adaptive"]
    assert kept["shown"] and kept["error"] <= kept["bound"] <= 0.03 and "target shown" in kept["verdict"]
    assert true_error(table) < 0.03
    ends = [r["readings"] for r in kept["rounds"]]
    assert ends[0][0] == 0 and ends[-1][1] == table.layout.size < 250 and len(lines) == len(ends)
    assert all(a[1] == b[0] for a, b in itertools.pairwise(ends))
    assert [r["purpose"] for r in kept["rounds"]][:: len(ends) - 1] == ["start", "check"]


def test_a_model_is_selected_and_its_prediction_shown():
    material = "lambert(rho=[0.05, 0.13, 0.42]) + 1 * ggx(alpha=0.2, f0=0.04)"
    table = gonio.adapt(material, Instrument(photons=1e5), target=0.02, strategy="model")
    kept = table.provenance["adaptive"]
    assert kept["shown"] and "ggx" in kept["rounds"][-1]["model"] and table.layout.size < 200
    assert gonio.fit(table, kept["rounds"][-1]["model"]).metrics["reduced_chi2"] == pytest.approx(1.0, abs=0.5)


def test_a_model_that_leaves_structure_is_told():
    table = gonio.adapt(SATIN, Instrument(photons=1e5), target=0.02, strategy="model", model="lambert")
    kept = table.provenance["adaptive"]
    assert not kept["shown"] and kept["error"] > 0.02 and "no larger model" in kept["verdict"]
    assert any("counting_s" in r for r in kept["rounds"])


def test_a_budget_is_kept_and_what_was_reached_is_told():
    instrument = Instrument(photons=1e5)
    table = gonio.adapt(SATIN, instrument, budget=300.0, target=1e-6, seed=3)
    kept = table.provenance["adaptive"]
    angles = [np.asarray(a) for a in table.layout.angles()]
    assert instrument.pace.path_seconds(angles, 1.0) == pytest.approx(kept["rounds"][-1]["seconds"], abs=1e-2)
    assert 200 < kept["rounds"][-1]["seconds"] <= 300 and not kept["shown"] and "budget spent" in kept["verdict"]
    assert true_error(table) < kept["bound"] and (np.asarray(table.u_f) > 0).all()


def test_a_killed_measurement_goes_on_bit_for_bit(tmp_path):
    whole = gonio.adapt(SATIN, Instrument(photons=1e6), budget=240.0)
    path, part = tmp_path / "t.h5", tmp_path / "t.h5.part"
    for _ in range(3):

        def killed(line):
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            gonio.adapt(SATIN, Instrument(photons=1e6), budget=240.0, output=path, log=killed)
    assert not path.exists()
    with pytest.raises(KeyboardInterrupt):
        gonio.adapt(SATIN, Instrument(photons=1e6), budget=240.0, output=path, log=_Twice())
    assert open_table(part).layout.size == whole.provenance["adaptive"]["rounds"][0]["readings"][1]
    with pytest.raises(gonio.GonioError, match="another recipe"):
        gonio.adapt(SATIN, Instrument(photons=1e6), budget=300.0, output=path)
    table = gonio.adapt(SATIN, Instrument(photons=1e6), budget=240.0, output=path)
    np.testing.assert_array_equal(table.f, whole.f)
    assert not part.exists() and table.provenance["adaptive"] == whole.provenance["adaptive"]


class _Twice:
    """Kills at the second line."""

    count = 0

    def __call__(self, line):
        self.count += 1
        if self.count == 2:
            raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give a target"),
        ({"target": 1.5}, "between 0 and 1"),
        ({"budget": -3.0}, "more than 0"),
        ({"budget": 20.0}, "too short"),
        ({"target": 0.1, "seed": -1}, "the seed"),
        ({"target": 0.1, "strategy": "grid"}, "table or model"),
        ({"target": 0.1, "model": "lambert"}, "leave it out"),
        ({"target": 0.1, "strategy": "model", "model": "lambrt"}, "did you mean 'lambert'"),
    ],
)
def test_what_is_no_measurement_is_refused(options, message):
    with pytest.raises(gonio.GonioError, match=message):
        gonio.adapt("lambert(rho=0.5)", **options)


def test_a_file_that_is_no_adaptive_measurement_is_kept(tmp_path):
    part = tmp_path / "t.h5.part"
    part.write_text("mine")
    with pytest.raises(gonio.GonioError, match="no unfinished adaptive measurement"):
        gonio.adapt("lambert(rho=0.5)", target=0.1, output=tmp_path / "t.h5", force=True)
    assert part.read_text() == "mine"


def test_what_says_nothing_is_refused_and_nothing_stays(tmp_path):
    plane = gonio.measure("lambert(rho=0.5)", None, "in-plane")
    with pytest.raises(gonio.GonioError, match="0 are valid"):
        gonio.adapt(plane, target=0.1, output=tmp_path / "t.h5")
    assert not list(tmp_path.iterdir())


def test_of_a_sheet_both_sides_are_read_and_the_target_shown_is_true():
    sheet = "thin_sheet(rho=0.3, tau=0.4)"
    instrument = gonio.Instrument(photons=1e5)
    table = gonio.adapt(sheet, instrument, target=0.02, strategy="model", model="thin_sheet")
    assert table.sides == {(1, 1), (1, -1)} and table.provenance["adaptive"]["shown"]
    fitted = gonio.fit(table, "thin_sheet").material.brdf
    assert float(fitted.rho) == pytest.approx(0.3, rel=0.02) and float(fitted.tau) == pytest.approx(0.4, rel=0.02)


def test_without_a_model_each_side_is_shown_by_readings_that_were_not_used():
    """Unlike lobes either way, lit from behind: the target holds on each side, and nothing is read of the front's."""
    sheet = "thin_sheet(rho=0.1, tau=0.02, rho_behind=0.4) + 0.4 * transmitted(base=ggx(alpha=0.3))"
    table = gonio.adapt(sheet, gonio.Instrument(photons=1e6), target=0.08, lit="back")
    kept = table.provenance["adaptive"]
    assert table.sides == {(-1, -1), (-1, 1)} and kept["shown"] and kept["lit"] == "back"
    last = kept["rounds"][-1]
    first, count = last["readings"]
    assert set(last["by_side"]) == {"reflection, lit from behind", "transmission, lit from behind"}
    assert sum(side["readings"] for side in last["by_side"].values()) == count - first
    assert max(side["bound"] for side in last["by_side"].values()) == kept["bound"] <= 0.08
    instrument, brdfs = Instrument(), (as_material(table), load_material(sheet).brdf)
    for way in ways_of(brdfs[1], "back"):
        angles = random_directions(500, instrument, True, np.random.default_rng(7), (way,))
        wi, wo = (from_spherical(*angles[k : k + 2], np) for k in (0, 2))
        values = [np.asarray(evaluate(b, wi, wo)).reshape(500, -1) for b in brdfs]
        assert np.sqrt(np.mean(difference(*values)[0] ** 2)) < 0.08


def test_a_target_that_no_table_of_readings_reaches_ends_early_and_says_so(monkeypatch):
    monkeypatch.setattr(adaptive_measurement, "MOST", 200)
    table = gonio.adapt("rough_dielectric(alpha=0.2, eta=1.5)", target=0.02, hemisphere="transmission")
    kept = table.provenance["adaptive"]
    assert not kept["shown"] and kept["error"] > 0.02 and table.layout.size < 200
    assert kept["verdict"].startswith(
        "out of reach: as the error fell so far, 2 % would take more than the 200 readings"
    )


def test_sides_that_are_not_there_are_refused():
    with pytest.raises(gonio.GonioError, match="no light on in transmission that comes from there"):
        gonio.adapt("lambert(rho=0.5)", target=0.1, hemisphere="transmission")
    with pytest.raises(gonio.GonioError, match="lit is 'below'; give front, back or both"):
        gonio.adapt("thin_sheet(rho=0.3, tau=0.4)", target=0.1, lit="below")
