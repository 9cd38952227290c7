"""Models for scenes: the nearest readings, errors of the radiance, and the cheapest model within a tolerance."""

import numpy as np
import pytest

from gonio.data.scene import Range, Scene
from gonio.fitting.fit_table import fit
from gonio.fitting.problem.readings import readings_of
from gonio.fitting.selection.scene_selection import COST, view_of
from gonio.fitting.selection.term_spec import DIFFUSERS, FACETS, OTHER_LOBES
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from support.fit_tables import COARSE_ISOTROPIC as ISOTROPIC
from support.fit_tables import COARSE_SPHERICAL as ROUND
from support.fit_tables import ONE_LOBE as ONE
from support.fit_tables import coarse_table_of as table_of

HALF = Range((0.0, np.pi / 2), (0.0, 2 * np.pi), 1.0)


@pytest.mark.parametrize(("layout", "anisotropic", "step"), [(ISOTROPIC, False, 10), (ROUND, True, 35)])
def test_a_view_takes_the_nearest_readings(layout, anisotropic, step):
    table = table_of(ONE, layout, noise=0.0)
    view = view_of(Scene("all", 0.1, (HALF,), (HALF,)), readings_of(table), anisotropic)
    assert 0 < view.distance < step
    readings = readings_of(table).part(view.cells)
    truth = np.asarray(evaluate(build(ONE), view.pairs.wi, view.pairs.wo))
    off = np.abs(readings.f[view.nearest] / truth - 1)
    assert np.median(off) < 0.3  # as far as the lobe changes over a cell
    assert view.error(1.05 * readings.f, readings.f) == pytest.approx(0.05)


def test_noise_is_taken_off_the_error():
    table = table_of(ONE, noise=0.1)
    readings, truth = readings_of(table), readings_of(table_of(ONE, noise=0.0))
    view = view_of(Scene("all", 0.1, (HALF,), (HALF,)), readings, False)
    y, t = readings.f[view.cells], truth.f[view.cells]
    assert view.error(t, y) > 0.05
    assert view.error(t, y, 0.1 * t) < 0.6 * view.error(t, y)
    assert view.error(1.2 * t, y, 0.1 * t) == pytest.approx(0.2, rel=0.15)


def test_a_scene_takes_the_cheapest_model_that_it_allows():
    """A plastic under ceiling lights passes for matte at 10 %, not at 1 %; the note names what the table asks for."""
    table = table_of("lambert(rho=[.3,.4,.5]) + [.9,.7,.8]*ggx(alpha=.25, f0=0.04)", noise=0.01)
    above = Range((0.0, np.radians(60)), (0.0, 2 * np.pi), 1.0, fills=True)
    view = Range((0.0, np.radians(70)), (0.0, 2 * np.pi), 1.0)
    loose, strict = (fit(table, scene=Scene("room", t, (above,), (view,)), starts=0) for t in (0.1, 0.003))
    assert loose.requested == "lambert" and strict.requested != "lambert" and loose.weight == "scene"
    assert "error of the radiance" in loose.notes[0] and "lambert + ggx(f0=0.04)" in loose.notes[0]
    chosen = next(row for row in loose.alternatives if row["verdict"].startswith("chosen"))
    assert chosen["scene_error"] <= 0.1 and chosen["model"] == "lambert"
    named = fit(table, "lambert", scene=Scene("room", 0.1, (above,), (view,)), starts=0)
    assert "room" in named.notes[0] and "tolerance 10 %" in named.notes[0]


def test_a_tolerance_that_nothing_meets_is_noted():
    table = table_of(ONE, noise=0.1)
    table.f = np.where(np.arange(table.f.size).reshape(table.f.shape) % 5 == 0, 3.0, 1.0) * table.f
    result = fit(table, scene=Scene("all", 1e-4, (HALF,), (HALF,)), starts=0)
    assert "which no model tried meets" in result.notes[0]


def test_a_scene_excludes_other_weights():
    with pytest.raises(GonioError, match="excludes the weight"):
        fit(table_of(ONE), "lambert", scene="matte_room", weight="cosine")


def test_every_model_of_the_family_has_a_measured_cost():
    assert {"lambert", "ggx", *DIFFUSERS, *FACETS, *OTHER_LOBES} <= COST.keys()
