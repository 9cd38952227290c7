"""What spots of finite size lose on a translucent sample: in the readings, their budget, and by name."""

import dataclasses
import itertools

import numpy as np
import pytest

import gonio
from gonio.instrument.scans import isotropic
from gonio.models.errors import GonioError
from gonio.models.subsurface.evaluation import evaluated, totals

TRANSLUCENT = "dipole(sigma_a=[0.1, 0.01], sigma_s=2)"
SPOTS = {"illuminated_radius": 1.0, "viewed_radius": 0.0}
SCAN = isotropic(step=np.radians(30), theta_max=np.radians(60))


@pytest.fixture(scope="module")
def table():
    with pytest.warns(UserWarning, match="edge loss"):
        return gonio.measure(TRANSLUCENT, gonio.Instrument(**SPOTS), SCAN)


def test_a_reading_lacks_what_leaves_beside(table):
    bssrdf = gonio.material(TRANSLUCENT).brdf.bssrdf
    kept = evaluated(bssrdf, "cumulative", 1.0) / totals(bssrdf)  # of a point in the middle of the lit spot
    assert table.f / gonio.measure(TRANSLUCENT, scan=SCAN).f == pytest.approx(np.broadcast_to(kept, table.shape))
    assert table.provenance["edge_loss"]["lost"] == pytest.approx(1 - kept)


def test_check_and_budget_name_it(table):
    assert any("edge loss" in note and "mm radius" in note for note in gonio.check(table).notes)
    result = gonio.quantities(table, budget=True, only=["reflectance"])
    rows = {c.name: c for c in result.budget.contributions}
    lost = dict(zip(table.channels.names, table.provenance["edge_loss"]["lost"], strict=True))
    linear = [q.group in ("albedo", "reflectance") for q in result.quantities]
    for q, shift in itertools.compress(zip(result.quantities, rows["edge_loss"].values, strict=True), linear):
        assert shift * np.sqrt(3) == pytest.approx(q.value * lost[q.channel] / (1 - lost[q.channel]))
    damaged = dataclasses.replace(table, provenance=table.provenance | {"edge_loss": {"lost": ["much"]}})
    assert "edge_loss" not in {
        c.name for c in gonio.quantities(damaged, budget=True, only=["reflectance"]).budget.contributions
    }


def test_an_opaque_sample_loses_nothing():
    opaque = gonio.measure("grey_card", gonio.Instrument(**SPOTS), SCAN)
    assert "edge_loss" not in opaque.provenance and (opaque.f == gonio.measure("grey_card", scan=SCAN).f).all()


def test_half_of_a_pair_of_spots_is_refused():
    with pytest.raises(GonioError, match="give both"):
        gonio.Instrument(viewed_radius=1.0)
    with pytest.raises(GonioError, match="sends no light"):
        gonio.measure(TRANSLUCENT, gonio.Instrument(illuminated_radius=0, viewed_radius=1), SCAN)
