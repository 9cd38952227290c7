"""Charts of speed against accuracy: that costs, errors and bounds are what they are called, and files whole."""

import csv
import dataclasses
import json
import math

import numpy as np
import pytest

from gonio.__main__ import main
from gonio.charts import albedos as hemisphere
from gonio.charts import diagrams, evaluation, tables
from gonio.charts.diagrams import CHARTS, chart
from gonio.charts.fits import cosines, lambert_ggx
from gonio.charts.point import GAIN, Axis, Chart, Point, Settings, cheapest, front
from gonio.charts.result import to_csv
from gonio.charts.tables import light_of
from gonio.charts.timing import in_turns, precision
from gonio.data import layouts
from gonio.data.tabulate import grid_values
from gonio.instrument.pace import Pace
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build


def point(cost, error, panel="p", method="m", note="", **values):
    return Point(panel, method, f"{cost:g}", {"cost": cost, "error": error, **values}, note)


def test_the_front_is_what_no_other_point_beats():
    rng = np.random.default_rng(1)
    points = [point(c, e) for c, e in rng.lognormal(size=(60, 2))] + [point(1.0, math.nan), point(math.nan, 1e-9)]
    kept = front(points, "cost", "error")
    usable = points[:60]

    def beaten(p):
        others = [q for q in usable if q is not p and q.value("cost") <= p.value("cost")]
        return any(q.value("error") <= p.value("error") for q in others)

    assert not any(beaten(p) for p in kept)
    # What is missing gains less than a hundredth over what is there for less.
    for p in usable:
        cheaper = [k.value("error") for k in kept if k.value("cost") <= p.value("cost")]
        assert p in kept or GAIN * min(cheaper) <= p.value("error")
    costs = [p.value("cost") for p in kept]
    assert costs == sorted(costs)


def test_the_cheapest_is_within_the_tolerance_and_none_cheaper_is():
    points = [point(1, 1e-2), point(2, 1e-3), point(3, 1e-5), point(4, 0.0, known=1e-4)]
    assert cheapest(points, "cost", "error", 1e-3) is points[1]
    assert cheapest(points, "cost", "error", 5e-5) is points[2]
    assert cheapest(points, "cost", "error", 1e-6) is None  # an error that is known to 1e-4 only is no 0


def test_a_bound_is_held_against_the_error_as_far_as_that_is_known():
    assert point(1, 2e-3, bound=1e-3).holds is False
    assert point(1, 2e-3, bound=1e-3, known=2e-3).holds is True
    assert point(1, 2e-3).holds is None


def test_a_scan_takes_the_time_that_its_moves_add_up_to():
    pace = Pace(axis_speed=math.radians(10), settling=0.5, count_rate=1e6)
    grid = layouts.isotropic(np.radians([0, 30]), np.radians([0, 20, 40]), np.radians([0, 90, 180, 270]))
    # Rows go there and back: 90° of azimuth between readings, 20° at each turn of a row, 30° of the light once; azimuth
    # needs no flying back.
    moves = 2 * 3 * 3 * 90 + 2 * 2 * 20 + 30
    readings = grid.size
    assert pace.seconds(grid, 2e6) == pytest.approx(moves / 10 + readings * (0.5 + 2.0))
    grazing = layouts.isotropic(np.radians([0]), np.radians([0, 90]), np.radians([0]))
    assert pace.seconds(grazing, 0.0) == pytest.approx(0.5)
    with pytest.raises(GonioError, match="settling is -1"):
        Pace(settling=-1.0)


def test_times_are_those_of_the_call_itself():
    def busy(n):
        return lambda: sum(range(n))

    short, long = in_turns([busy(20_000), busy(2_000_000)], rounds=3)
    assert long.median > 10 * short.median and short.result == sum(range(20_000))


def test_precision_is_given_back():
    import jax
    import jax.numpy as jnp

    before = jax.config.jax_enable_x64
    with pytest.raises(ZeroDivisionError), precision("float32"):
        assert jnp.zeros(1).dtype == np.float32
        1 / 0  # noqa: B018
    assert jax.config.jax_enable_x64 == before


def test_misplaced_light_of_a_known_error():
    """Lambert of twice the albedo misplaces all that there is; a scaled lobe its share."""
    light = light_of(build("lambert(rho=0.3)"), 2000)
    assert light.misplaced(build("lambert(rho=0.6)")) == pytest.approx(1.0, rel=1e-9)
    assert light.misplaced(build("lambert(rho=0.3)")) == 0.0
    # ∫∫ f cosθi cosθo over both caps of 80° is ρπ sin⁴(80°); light is drawn within the cap.
    whole = np.sum(light.weight * light.f) / light.f.size
    assert whole == pytest.approx(0.3 * math.sin(math.radians(80)) ** 2, rel=0.02)


@pytest.mark.parametrize(
    ("rule", "setting"), [("lobe map", 1e-7), ("rings", 1e-7), ("product rule", 128), ("sampling", 4096)]
)
def test_rules_know_the_closed_form(rule, setting):
    """GGX of α = 1 with F = 1: E = 1 − μ log(1 + 1/μ) (bounds hold; the rule without one is near)."""
    make, _ = hemisphere.RULES[rule]
    mu = np.cos(hemisphere.THETA)
    value, bound = make(build("ggx(alpha=1)"), setting)()
    assert np.all(np.abs(value - (1 - mu * np.log(1 + 1 / mu))) <= np.where(np.isnan(bound), 1e-6, bound))


def test_interpolations_are_exact_at_the_nodes():
    brdf = build("lambert(rho=0.2) + 0.5 * ggx(alpha=0.3)")
    grid = tables._isotropic(15.0)
    f = grid_values(brdf, grid)
    inner = layouts.isotropic(*(a[1:-1] for a in grid.axes.values()))
    wi, wo = inner.directions()
    found = np.asarray(evaluate(tables.INTERPOLATIONS["linear in log f"](grid, f), wi, wo)).reshape(inner.shape)
    np.testing.assert_allclose(found, f[1:-1, 1:-1, 1:-1, 0], rtol=1e-9)


def test_the_nearest_node_is_the_nearest():
    brdf = build("lambert(rho=0.2) + 0.5 * ggx(alpha=0.3)")
    grid = tables._isotropic(15.0)
    nearest = tables._nearest(grid, grid_values(brdf, grid))
    off, at = (layouts.isotropic(*(np.radians([a]) for a in angles)) for angles in ((37, 22, 99), (30, 15, 105)))
    there = np.asarray(evaluate(brdf, *at.directions())).ravel()
    np.testing.assert_allclose(np.asarray(evaluate(nearest, *off.directions())).ravel(), there, rtol=1e-12)


def test_the_model_that_scipy_fits_is_ours():
    wi, wo = layouts.isotropic(np.radians([10, 70]), np.radians([5, 80]), np.radians([40, 180])).directions()
    ours = np.asarray(evaluate(build("lambert(rho=0.3) + 0.5 * ggx(alpha=0.2)"), wi, wo))
    np.testing.assert_allclose(lambert_ggx(np.array([0.3, 0.5, 0.2]), cosines(wi, wo)), ours, rtol=1e-12)


def fake(points, name="fits"):
    axes = ((Axis("cost", "cost, ms"), Axis("error", "error")),)
    return Chart(name, "A chart", "What it shows.", axes, lambda settings: iter(points))


POINTS = [
    point(1.0, 1e-2, bound=3e-2), point(10.0, 1e-4, bound=2e-4), point(20.0, 1e-3, method="<other>", note="slow"),
    point(5.0, 0.0, panel="q", known=1e-12), point(6.0, math.inf, panel="q", method="<other>"),
]  # fmt: skip


def test_what_is_written_is_what_was_measured(tmp_path, monkeypatch, capsys):
    made = []

    def count(settings):
        made.append(settings.quick)
        return iter(POINTS)

    monkeypatch.setitem(CHARTS, "fits", dataclasses.replace(fake(POINTS), points=count))
    words = ["chart", "fits", "-o", str(tmp_path), "--tolerance", "1e-3"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "written to" in out and "claims none" in out and "p  m                10" in " ".join(out.split("\n"))
    rows = list(csv.DictReader((tmp_path / "fits.csv").read_text(encoding="utf-8").splitlines()))
    assert [float(r["cost"]) for r in rows] == [p.value("cost") for p in POINTS]
    assert [r["on_front"] for r in rows] == ["1", "1", "0", "1", "0"] and rows[0]["bound_holds"] == "1"
    assert (tmp_path / "fits.png").read_bytes()[:4] == b"\x89PNG"
    assert "&lt;other&gt;" in (tmp_path / "fits.svg").read_text(encoding="utf-8")
    # Again: nothing is measured anew, unless it is forced, and other settings are refused.
    assert main(words) == 0 and made == [False]
    assert main([*words, "--quick"]) == 2 and "of other settings" in capsys.readouterr().err
    assert main([*words, "--quick", "--force"]) == 0 and made == [False, True]
    held = json.loads((tmp_path / "charts.json").read_text(encoding="utf-8"))
    assert held["charts"]["fits"]["points"][4]["values"]["error"] == "inf"


def test_a_killed_run_goes_on(tmp_path, monkeypatch):
    made = []

    def killed(settings):
        yield POINTS[0]
        raise KeyboardInterrupt

    def done(name):
        return lambda settings: made.append(name) or iter(POINTS)

    axes = fake(POINTS).frames
    monkeypatch.setitem(CHARTS, "fits", Chart("fits", "F", "f", axes, done("fits")))
    monkeypatch.setitem(CHARTS, "tables", Chart("tables", "T", "t", axes, killed))
    with pytest.raises(KeyboardInterrupt):
        chart(["fits", "tables"], output=tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["charts.json", "fits.csv", "fits.png", "fits.svg"]
    monkeypatch.setitem(CHARTS, "tables", Chart("tables", "T", "t", axes, done("tables")))
    first, second = chart(["fits", "tables"], output=tmp_path)
    assert made == ["fits", "tables"] and to_csv([first]).replace("fits,", "tables,") == to_csv([second])


def test_a_run_killed_while_it_drew_draws_again(tmp_path, monkeypatch):

    made, whole = [], diagrams.picture_files

    def killed(*args):
        raise KeyboardInterrupt

    again = dataclasses.replace(fake(POINTS), points=lambda settings: made.append(1) or iter(POINTS))
    monkeypatch.setitem(CHARTS, "fits", again)
    monkeypatch.setattr(diagrams, "picture_files", killed)
    with pytest.raises(KeyboardInterrupt):
        chart("fits", output=tmp_path)
    monkeypatch.setattr(diagrams, "picture_files", whole)
    chart("fits", output=tmp_path)
    assert made == [1] and (tmp_path / "fits.svg").exists()


def test_a_bound_that_does_not_hold_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(CHARTS, "fits", fake([point(1.0, 1e-2, bound=1e-3), point(2.0, 1e-3, bound=1e-2)]))
    assert main(["chart", "fits", "-o", str(tmp_path)]) == 1
    said = capsys.readouterr()
    assert "bound does not hold: p, m 1" in said.out and "1 of 2 claimed bounds hold" in said.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fist"], "Unknown chart 'fist'; did you mean 'fits'?"),
        (["--tolerance", "0"], "the tolerance is 0; give an error above 0"),
        (["--settling", "-1"], "settling is -1; give a number above 0"),
        (["--axis-speed", "nan"], "axis speed is nan"),
    ],
)
def test_bad_words_are_refused(words, said, capsys):
    assert main(["chart", *words]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_a_folder_that_is_none(tmp_path, capsys):
    (tmp_path / "file").write_text("kept")
    assert main(["chart", "fits", "-o", str(tmp_path / "file")]) == 2
    (tmp_path / "charts.json").write_text("nonsense")
    assert main(["chart", "fits", "-o", str(tmp_path)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert "cannot be a folder" in said[0] and "is no list of charts" in said[1]


def test_evaluation_is_measured_at_forty_digits(monkeypatch):
    monkeypatch.setattr(evaluation, "QUICK", ("lambert",))
    monkeypatch.setattr(evaluation, "QUICK_BATCHES", {"10": 10})
    double, single = evaluation.points(Settings(quick=True))
    # ρ/π: rounded once, or as single precision holds ρ, π and their quotient.
    assert double.value("error") < 3e-16 and 1e-9 < single.value("error") < 3e-7
    assert all(p.value(axis.key) >= 0 for p in (double, single) for pair in evaluation.CHART.frames for axis in pair)
