"""Scenes: what they see, what they say of a model, and one sentence for each fault of a file."""

import numpy as np
import pytest

from gonio.data.scene import Range, Scene, load_scene, read_scene, shipped_scenes
from gonio.fitting.fit_table import fit
from gonio.fitting.problem.readings import readings_of
from gonio.fitting.selection.scene_selection import seen
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from support.fit_tables import COARSE_ISOTROPIC as ISOTROPIC
from support.fit_tables import COARSE_SPHERICAL as ROUND
from support.fit_tables import ONE_LOBE as ONE
from support.fit_tables import coarse_table_of as table_of

HALF = Range((0.0, np.pi / 2), (0.0, 2 * np.pi), 1.0)
GOOD = "gonio_scene = 1\ntolerance = 0.1\n[[light]]\ntheta = [0, 60]\n[[view]]\ntheta = 30\n"


def test_what_a_scene_sees_of_a_diffuser():
    """Lambert under a light that fills the hemisphere: ρ/π times the mean cosine, one half, for every view."""
    sky = Scene("sky", 0.1, (Range((0.0, np.pi / 2), (0.0, 2 * np.pi), 3.0, fills=True),), (HALF,))
    pairs = sky.pairs(8000)
    radiances = pairs.radiances(np.full((pairs.view.size, 1), 0.4 / np.pi))
    assert pairs.share.sum() == pytest.approx(1) and np.unique(pairs.view).size == pairs.share.size
    np.testing.assert_allclose(radiances, 3.0 * 0.4 / np.pi / 2, rtol=0.05)
    assert np.mean(radiances) == pytest.approx(3.0 * 0.4 / np.pi / 2, rel=2e-3)
    sun = Scene("sun", 0.1, (Range((0.5, 0.5), (0.0, 0.0), 2.0),), (HALF,)).pairs(4000)
    np.testing.assert_allclose(sun.radiances(np.ones((sun.view.size, 2))), 2.0 * np.cos(0.5), rtol=1e-12)
    # Views are even over the solid angle and count by their cosine: the mean cosine is ∫cos²/∫cos = 2/3.
    assert np.sum(sun.share * sun.wo.z) == pytest.approx(2 / 3, rel=1e-3)


def test_an_error_is_that_of_the_radiance():
    scene = Scene("sun", 0.1, (HALF,), (HALF,)).pairs(500)
    f = np.random.default_rng(0).random((scene.view.size, 3))
    assert scene.error(1.07 * f, f) == pytest.approx(0.07)
    assert np.isnan(scene.error(f, 0 * f))


@pytest.mark.parametrize(("layout", "turned", "step"), [(ISOTROPIC, False, 10), (ROUND, True, 35)])
def test_a_scene_looks_at_the_readings_nearest_to_it(layout, turned, step):
    table = table_of(ONE, layout, noise=0.0)
    look = seen(Scene("all", 0.1, (HALF,), (HALF,)), readings_of(table), turned)
    assert 0 < look.distance < step
    readings = readings_of(table).part(look.cells)
    truth = np.asarray(evaluate(build(ONE), look.pairs.wi, look.pairs.wo))
    off = np.abs(readings.f[look.at] / truth - 1)
    assert np.median(off) < 0.3  # as far as the lobe changes over a cell
    assert look.error(1.05 * readings.f, readings.f) == pytest.approx(0.05)


def test_noise_is_taken_off_the_error():
    table = table_of(ONE, noise=0.1)
    readings, truth = readings_of(table), readings_of(table_of(ONE, noise=0.0))
    look = seen(Scene("all", 0.1, (HALF,), (HALF,)), readings, False)
    y, t = readings.f[look.cells], truth.f[look.cells]
    assert look.error(t, y) > 0.05
    assert look.error(t, y, 0.1 * t) < 0.6 * look.error(t, y)
    assert look.error(1.2 * t, y, 0.1 * t) == pytest.approx(0.2, rel=0.15)


def test_a_scene_takes_the_cheapest_model_that_it_allows():
    """A plastic under ceiling lights passes for matte at 10 %, not at 1 %; what the table asks for is said."""
    table = table_of("lambert(rho=[.3,.4,.5]) + [.9,.7,.8]*ggx(alpha=.25, f0=0.04)", noise=0.01)
    above = Range((0.0, np.radians(60)), (0.0, 2 * np.pi), 1.0, fills=True)
    view = Range((0.0, np.radians(70)), (0.0, 2 * np.pi), 1.0)
    loose, strict = (fit(table, scene=Scene("room", t, (above,), (view,)), starts=0) for t in (0.1, 0.003))
    assert loose.requested == "lambert" and strict.requested != "lambert" and loose.weight == "scene"
    assert "error of the reflected radiance" in loose.notes[0] and "lambert + ggx(f0=0.04)" in loose.notes[0]
    chosen = next(row for row in loose.alternatives if row["verdict"].startswith("chosen"))
    assert chosen["scene_error"] <= 0.1 and chosen["model"] == "lambert"
    named = fit(table, "lambert", scene=Scene("room", 0.1, (above,), (view,)), starts=0)
    assert "room" in named.notes[0] and "tolerance 10 %" in named.notes[0]


def test_a_tolerance_that_nothing_meets_is_said():
    table = table_of(ONE, noise=0.1)
    table.f = np.where(np.arange(table.f.size).reshape(table.f.shape) % 5 == 0, 3.0, 1.0) * table.f
    result = fit(table, scene=Scene("all", 1e-4, (HALF,), (HALF,)), starts=0)
    assert "which no model tried meets" in result.notes[0]


def test_shipped_scenes_are_read_by_name(tmp_path):
    assert {"matte_room", "low_sun_car", "satellite_nadir"} <= set(shipped_scenes())
    for name in shipped_scenes():
        scene = load_scene(name)
        assert 0 < scene.tolerance < 1 and scene.pairs(300).share.sum() == pytest.approx(1)
    path = tmp_path / "s.toml"
    path.write_text(GOOD)
    assert read_scene(path).views[0].theta == pytest.approx((np.pi / 6, np.pi / 6))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("tolerance = 0.1", "gonio_scene = 1"),
        ("gonio_scene = 2", "format 2"),
        (GOOD.replace("tolerance", "tolerence"), "did you mean|tolerance"),
        (GOOD.replace("0.1", "1.5"), "0 to 1"),
        (GOOD.replace("0.1", "0"), "above 0"),
        (GOOD.replace("0.1", "nan"), "0 to 1"),
        (GOOD.replace("[0, 60]", "[60, 0]"), "smaller angle first"),
        (GOOD.replace("[0, 60]", "[0, 95]"), "0 to 90"),
        (GOOD.replace("[0, 60]", '"low"'), "[from, to]"),
        (GOOD.replace("theta = 30", "fills = true"), "fills"),
        (GOOD.replace("theta = 30", ""), "theta is not given"),
        (GOOD.split("[[view]]")[0], "[[view]]"),
        (GOOD + "weight = 0", "above it"),
        ("channels = 'R'\n" + GOOD, "list of names"),
        ("= 3", "not a TOML file"),
    ],
)
def test_each_fault_of_a_file_is_one_sentence(tmp_path, text, words):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(GonioError) as error:
        read_scene(path)
    said = str(error.value)
    assert "\n" not in said and "scene.toml" in said and any(w in said for w in words.split("|"))


def test_what_a_table_lacks_is_said():
    table = table_of(ONE)
    with pytest.raises(GonioError, match=r"'X'.*R, G, B"):
        fit(table, "lambert", scene=Scene("s", 0.1, (HALF,), (HALF,), channels=("X",)))
    with pytest.raises(GonioError, match="excludes the weight"):
        fit(table, "lambert", scene="matte_room", weight="cosine")
    with pytest.raises(GonioError, match="matte_room"):
        load_scene("matte_rom")
