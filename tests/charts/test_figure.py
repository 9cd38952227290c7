"""Pictures of charts: labels that hide neither each other nor a point, and all of the points."""

import matplotlib
import numpy as np
import pytest

from gonio.charts.figure import CEILING, chart_figure, places
from gonio.charts.point import Axis, Chart, Point
from gonio.figures.style import styled

FRAMES = ((Axis("cost", "cost, ms"), Axis("error", "error")),)


def crowd(count, seed=0):
    rng = np.random.default_rng(seed)
    costs, errors = 10 ** rng.normal(0, 0.6, count), 10 ** rng.normal(-4, 1, count)
    values = [{"cost": float(c), "error": float(e)} for c, e in zip(costs, errors, strict=True)]
    return [Point("p", f"m{k % 4}", f"model {k}", v) for k, v in enumerate(values)]


def test_places_overlap_with_nothing():
    rng = np.random.default_rng(2)
    points, sizes = rng.uniform(20, 480, (60, 2)), np.stack([rng.uniform(15, 60, 60), np.full(60, 10.0)], -1)
    found = places(points, sizes, (0.0, 0.0, 500.0, 500.0), np.full(60, 3.0))
    assert all(found)
    boxes = [np.array([c, np.add(c, s)]) for c, s in zip(found, sizes, strict=True)]
    for k, a in enumerate(boxes):
        assert np.all(a >= 0) and np.all(a <= 500)
        assert not any(np.all(a[0] < b[1]) and np.all(b[0] < a[1]) for b in boxes[:k])
        assert not any(np.all(a[0] < p + 3) and np.all(p - 3 < a[1]) for p in points)


def test_a_label_without_room_is_not_placed():
    assert places(np.array([[5.0, 5.0]]), np.array([[50.0, 10.0]]), (0.0, 0.0, 10.0, 10.0), np.array([2.0])) == [None]


@pytest.mark.parametrize("count", [12, 76])
def test_every_point_is_drawn_and_named(count):
    points = crowd(count)
    with styled():
        fig = chart_figure(Chart("x", "Title", "About.", FRAMES, iter), points, "Caption.", 1e-4)
        renderer = fig.canvas.get_renderer()
        (ax,) = fig.axes
        texts = [t for t in ax.texts if t.get_text().startswith("model ")]
        boxes = [t.get_window_extent(renderer) for t in texts]
    assert {t.get_text() for t in texts} == {p.setting for p in points}
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    drawn = {(line.get_xdata()[0], line.get_ydata()[0]) for line in ax.lines if len(line.get_xdata()) == 1}
    assert {(p.value("cost"), p.value("error")) for p in points} <= drawn


def test_errors_beyond_all_measure_stand_on_the_edge():
    points = [
        Point("p", "m", "a", {"cost": 1.0, "error": 1e6, "bound": np.inf}),
        Point("p", "m", "b", {"cost": 2.0, "error": 1e-3, "bound": 1e-2}),
        Point("p", "m", "c", {"cost": 3.0, "error": 0.0}),
    ]
    with styled(), matplotlib.rc_context({"font.size": 9}):
        fig = chart_figure(Chart("x", "Title", "About.", FRAMES, iter), points, "Caption.")
    heights = {y for line in fig.axes[0].lines for y in np.atleast_1d(line.get_ydata()) if np.isfinite(y)}
    assert CEILING in heights and fig.axes[0].get_ylim()[1] >= CEILING and min(fig.axes[0].get_ylim()) > 0
