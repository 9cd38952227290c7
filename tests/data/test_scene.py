"""Scenes: what they see, what they say of a model, and one sentence for each fault of a file."""

import numpy as np
import pytest

from gonio.data.scene import Range, Scene, load_scene, read_scene, shipped_scenes
from gonio.models.errors import GonioError

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


@pytest.mark.parametrize("angle", [0.3, 2.0, 5.5])
def test_a_turned_scene_sees_turned_pairs(angle):
    def scene(turn):
        light = Range((0.2, 1.2), (0.1 + turn, 1.0 + turn), 2.0, fills=True)
        return Scene("s", 0.1, (light,), (Range((0.0, 1.0), (turn, 3.0 + turn), 1.0),)).pairs(400)

    plain, turned = scene(0.0), scene(angle)
    c, s = np.cos(angle), np.sin(angle)
    for a, b in ((plain.wi, turned.wi), (plain.wo, turned.wo)):
        np.testing.assert_allclose(b, [c * a.x - s * a.y, s * a.x + c * a.y, a.z], atol=1e-12)
    np.testing.assert_allclose(turned.amount, plain.amount)
    np.testing.assert_allclose(turned.share, plain.share, rtol=1e-9)


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
        (GOOD + "[[view]]\ntheta = 3\n" * 300, "at most 256"),
    ],
)
def test_each_fault_of_a_file_is_one_sentence(tmp_path, text, words):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(GonioError) as error:
        read_scene(path)
    message = str(error.value)
    assert "\n" not in message and "scene.toml" in message and any(w in message for w in words.split("|"))


def test_many_lights_and_views_are_one_scene_and_too_many_are_refused():
    parts = [Range(HALF.theta, (k / 50, (k + 1) / 50), 1.0) for k in range(50)]
    pairs = Scene("s", 0.1, tuple(parts), tuple(parts)).pairs(20_000)
    np.testing.assert_allclose(pairs.share.sum(), 1)
    angles = np.unique(np.floor(np.arctan2(pairs.wo.y, pairs.wo.x)[np.diff(pairs.view, prepend=-1) != 0] * 50))
    assert set(range(50)) <= set(angles.astype(int))


def test_what_a_scene_or_a_table_lacks_is_named():
    with pytest.raises(GonioError, match=r"'X'.*R, G, B"):
        Scene("s", 0.1, (HALF,), (HALF,), channels=("X",)).channels_of(("R", "G", "B"))
    with pytest.raises(GonioError, match="matte_room"):
        load_scene("matte_rom")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a" + ".b" * 100_000 + " = 1", "more than 32 parts"),
        ("x = {y = 1, a" + " . b" * 50_000 + " = 1}", "more than 32 parts"),
        ("[a" + ".b" * 100_000 + "]", "more than 32 parts"),
        ("a" * 200_000, ""),
        ("x = " + "1" * 5000, "digits"),
        ("x = " + "[" * 90_000, ""),
    ],
    ids=["a deep key", "a deep key inside", "a deep header", "a long word", "a long integer", "deep lists"],
)
def test_a_file_that_would_exhaust_the_parser_is_refused_at_once(tmp_path, text, reason):
    path = tmp_path / "s.scene.toml"
    path.write_text(f"gonio_scene = 1\n{text}\n")
    with pytest.raises(GonioError, match=f"is not a TOML file .*{reason}") as caught:
        load_scene(path)
    assert len(str(caught.value)) < 300
