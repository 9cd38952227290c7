"""Scenes: what they see, what they say of a model, and one sentence for each fault of a file."""

import numpy as np
import pytest

from gonio.data.scene import Range, Scene, load_scene, read_scene, shipped_scenes
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

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


SPHERE = Range((0.0, np.pi), (0.0, 2 * np.pi), 1.0, fills=True)
BEHIND = Range((np.radians(91), np.pi), (0.0, 2 * np.pi), 1.0, fills=True)


def radiances(expression, lights, views=(HALF,), count=6000, index=1.0):
    """Radiances (K,) of views, and what each counts with."""
    pairs = Scene("s", 0.1, lights, views).pairs(count, index)
    f = np.asarray(evaluate(build(expression), pairs.wi, pairs.wo)).reshape(pairs.view.size, -1)
    return pairs.radiances(f)[:, 0], pairs.share


def uniform(front, behind):
    """Light of one radiance on either side: its weight is that times its solid angle."""
    ranges = ((0.0, np.pi / 2), front), ((np.pi / 2, np.pi), behind)
    return tuple(Range(theta, (0.0, 2 * np.pi), 2 * np.pi * radiance, fills=True) for theta, radiance in ranges)


def test_light_on_the_back_reaches_a_view_through_the_sheet():
    """τ of the radiance behind, in any view; a diffuser that reflects alone is dark."""
    lights = uniform(0.0, 3.0)
    through, share = radiances("lambert_transmission(tau=0.4)", lights)
    np.testing.assert_allclose(through, 0.4 * 3.0, rtol=0.06)
    assert np.sum(share * through) == pytest.approx(0.4 * 3.0, rel=2e-3)
    assert not radiances("lambert(rho=0.5)", lights[1:])[0].any()
    shown, share = radiances("lambert_transmission(tau=0.4)", lights, (SPHERE,))
    assert np.sum(share * shown) == pytest.approx(0.4 * 3.0 / 2, rel=2e-2)  # half of the views are behind


def test_a_sheet_in_a_uniform_sphere_shows_what_it_does_not_absorb():
    """A furnace: R + T of the radiance all round, whichever way it looks, and whichever way the sky is written."""
    whole = Range(SPHERE.theta, SPHERE.phi, SPHERE.solid_angle, fills=True)
    for lights in (uniform(1.0, 1.0), (whole,)):
        shown, share = radiances("thin_sheet(rho=0.3, tau=0.5)", lights, (SPHERE,))
        assert np.sum(share * shown) == pytest.approx(0.8, rel=5e-3)


def test_an_interface_between_uniform_media_is_as_bright_as_they_are():
    """L/n² of one all round: a view gets n² (R + T), both of light that came its way, from either side.

    Lobes under a sky: its directions must not follow those of the views, which was off by 3 to 5 %.
    """
    glass, lights = "rough_dielectric(alpha=0.4, eta=1.5)", uniform(1.0, 1.5**2)
    cosines = np.linspace(np.cos(np.radians(89)), 1.0, 12)
    theta = np.arccos(np.concatenate([cosines, -cosines]))
    sent = [np.ravel(g(build(glass), theta, 0.0, 1e-4).value) for g in (directional_albedo, directional_transmittance)]
    for view, n, share_sent in zip((HALF, BEHIND), (1.0, 1.5), np.split(sum(sent), 2), strict=True):
        pairs = Scene("s", 0.1, lights, (view,)).pairs(200_000, 1.5)
        f = np.asarray(evaluate(build(glass), pairs.wi, pairs.wo))
        shown = pairs.radiances(f.reshape(-1, 1))[:, 0]
        cos_o = np.abs(pairs.wo.z[np.unique(pairs.view, return_index=True)[1]])
        expected = n**2 * np.interp(cos_o, cosines, share_sent)
        assert np.sum(pairs.share * shown) == pytest.approx(np.sum(pairs.share * expected), rel=0.02)


@pytest.mark.parametrize("index", [1.0, 1.5])
def test_a_small_light_behind_is_met_where_it_shines_through(index):
    """The mean radiance of a narrow lobe, by many views or by few, which even views alone would miss."""
    lamp = (Range((np.radians(140), np.radians(175)), (0.0, 2 * np.pi), 1.0),)
    model = "0.5 * transmitted(base=ggx(alpha=0.02))" if index == 1.0 else "rough_dielectric(alpha=0.02, eta=1.5)"
    means = []
    for count in (1500, 24_000):
        shown, share = radiances(model, lamp, (HALF,), count, index)
        means.append(np.sum(share * shown))
    assert means[0] == pytest.approx(means[1], rel=0.1) and means[1] > 0


def test_pairs_by_side_are_all_of_them_and_their_radiances_add_up():
    pairs = Scene("s", 0.1, (SPHERE, HALF, Range((2.0, 2.5), (0.0, 1.0), 1.0)), (HALF, BEHIND)).pairs(900)
    f = np.random.default_rng(1).random((pairs.view.size, 2))
    assert (np.abs(pairs.wi.z[pairs.wi.z < 0]) >= np.cos(np.radians(89)) - 1e-9).all()
    parts = pairs.by_side()
    assert set(parts) == {(1, 1), (1, -1), (-1, 1), (-1, -1)}
    np.testing.assert_allclose(sum(p.radiances(f[here]) for here, p in parts.values()), pairs.radiances(f))
    for (light, detector), (here, part) in parts.items():
        assert (part.wi.z > 0).all() and (part.wo.z > 0).all()
        assert (pairs.wi.z[here] * light > 0).all() and (pairs.wo.z[here] * detector > 0).all()


def test_a_scene_names_what_a_table_does_not_hold_of_it():
    scene = Scene("window", 0.1, (BEHIND,), (HALF,))
    scene.require_sides(scene.sides, "t")
    with pytest.raises(GonioError, match="'window' looks at transmission, lit from behind, which t does not hold"):
        scene.require_sides(frozenset({(1, 1), (1, -1)}), "t")


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
        (GOOD.replace("[0, 60]", "[0, 185]"), "0 to 180"),
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
