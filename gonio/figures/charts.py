"""Speed against accuracy on logarithmic axes: methods as marks, their bounds as bars, the Pareto front as a line."""

import io
import math
import textwrap
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from gonio.charts.points import Axis, Chart, Point, cheapest, front, shown
from gonio.figures.label_places import nearest_of, places
from gonio.figures.style import FAINT, INK, MARKERS, PALETTE, RULE, mix, styled, svg
from gonio.figures.ticks import decades_between, sr_label

WIDTH, HEIGHT = 5.4, 4.5  # inches of a frame
LARGE = (7.6, 6.4)  # of one with very many points
MANY = 45
COLUMNS = 3
MARK, RING = 5.0, 11.0  # points across
CEILING = 10.0
"""Errors beyond are drawn on the upper edge: they are as wrong as can be."""
LETTERS = 8.0


def chart_figure(chart: Chart, points: Sequence[Point], caption: str, tolerance: float | None = None) -> Figure:
    """A frame for each panel and pair of axes; `caption` says where and how the points were measured.

    Labels that find no room are counted in their frame. The cheapest method within `tolerance` is ringed. Call it, and
    write its figure, inside of `gonio.figures.style.styled`.
    """
    panels = list(dict.fromkeys(p.panel for p in points))
    methods = list(dict.fromkeys(p.method for p in points))
    looks = {m: _look(k) for k, m in enumerate(methods)}
    drawn = [(axes, panel) for axes in chart.frames for panel in panels]
    most = max(sum(p.panel == panel for p in points) for panel in panels)
    width, height = LARGE if most > MANY else (WIDTH, HEIGHT)
    columns = len(chart.frames) if len(panels) == 1 else 2 if len(panels) == 4 else min(COLUMNS, len(panels))
    rows = math.ceil(len(drawn) / columns)
    words = textwrap.wrap(f"{chart.about} {caption}", round(columns * width * 15.5))
    foot = 0.16 * len(words) + 0.15
    size = (columns * width, rows * height + foot + 0.75)
    fig = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(fig)
    fig.get_layout_engine().set(rect=(0, foot / size[1], 1, 1 - (foot + 0.75) / size[1]), w_pad=0.08, h_pad=0.08)
    every = np.ravel(fig.subplots(rows, columns, squeeze=False))
    for ax in every[len(drawn) :]:
        ax.set_visible(False)
    for ax, ((cost, error), panel) in zip(every, drawn, strict=False):
        _frame(ax, cost, error, [p for p in points if p.panel == panel], looks, tolerance, panel)
    _legend(fig, chart, methods, looks, size, tolerance, any("bound" in p.values for p in points))
    fig.text(0.012, 0.08 / size[1], "\n".join(words), fontsize=8, color=FAINT, va="bottom")
    fig.draw_without_rendering()
    fig.set_layout_engine("none")
    for ax, ((cost, error), panel) in zip(every, drawn, strict=False):
        _labels(fig, ax, cost, error, [p for p in points if p.panel == panel], looks, tolerance)
    return fig


def _look(number: int) -> tuple[str, str]:
    # Colour and mark: no two of the first 35 are alike.
    return PALETTE[number % len(PALETTE)], MARKERS[(number + number // len(PALETTE)) % len(MARKERS)]


def _legend(fig: Figure, chart: Chart, methods, looks, size, tolerance, bounds: bool) -> None:
    fig.text(0.012, 1 - 0.1 / size[1], chart.title, fontsize=12, weight="bold", va="top", color=INK)
    handles = [Line2D([], [], ls="", marker=looks[m][1], color=looks[m][0], ms=MARK + 1, label=m) for m in methods]
    handles.append(Line2D([], [], color=INK, lw=1.0, ls=(0, (4, 2)), label="Pareto front"))
    if bounds:
        handles.append(Line2D([], [], color=FAINT, lw=0.8, marker="_", ms=6, label="claimed bound"))
    if tolerance is not None:
        ring = {"marker": "o", "ms": RING, "mfc": "none", "color": INK, "ls": ""}
        handles.append(Line2D([], [], **ring, label=f"cheapest within {sr_label(tolerance)}"))
    room = max(2, int(size[0] / 2.1))
    fig.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(0.006, 1 - 0.28 / size[1]), ncols=min(room, len(handles)),
        handletextpad=0.4, columnspacing=1.2, fontsize=8.5,
    )  # fmt: skip


def _height(point: Point, error: Axis, floor: float) -> float:
    value = shown(point, error.key)
    return min(max(value, floor), CEILING) if math.isfinite(value) else CEILING


def _floor(points: Sequence[Point], error: Axis) -> float:
    # Nothing is drawn as exact: an error of 0 stands at the least one there is, or at the rounding of a double.
    seen = [v for p in points if (v := shown(p, error.key)) > 1e-17]
    return min(seen, default=1e-16)


def _frame(ax: Axes, cost: Axis, error: Axis, points, looks, tolerance, panel: str) -> None:
    floor = _floor(points, error)
    ax.set_xscale("log")
    ax.set_yscale("log")
    kept = front(points, cost.key, error.key)
    ax.plot(
        [p.value(cost.key) for p in kept], [_height(p, error, floor) for p in kept], color=INK, lw=1.0, ls=(0, (4, 2)),
        zorder=1.5,
    )  # fmt: skip
    for p in points:
        x, y = p.value(cost.key), _height(p, error, floor)
        colour, mark = looks[p.method]
        bound = p.value("bound")
        if error.key == "error" and not math.isnan(bound):
            top = min(bound, CEILING)
            ax.plot([x, x], [y, max(top, y)], color=colour, lw=0.7, alpha=0.55, zorder=1.6)
            ax.plot(
                [x], [max(top, y)], marker="_" if bound <= CEILING else "^", ms=6, color=colour, alpha=0.7, zorder=1.6
            )
        broken = p.holds is False
        ax.plot([x], [y], ls="", marker=mark, ms=MARK, color=colour, mec="#c4161c" if broken else "white",
                mew=1.6 if broken else 0.5, zorder=3)  # fmt: skip
    if tolerance is not None:
        ax.axhline(tolerance, color=FAINT, lw=0.8, zorder=1)
        best = cheapest(points, cost.key, error.key, tolerance)
        if best is not None:
            at = [best.value(cost.key)], [_height(best, error, floor)]
            ax.plot(*at, marker="o", ms=RING, mfc="none", mec=INK, zorder=4)
    _scales(ax, cost, error, points, floor)
    ax.set_title(panel, loc="left", color=INK)


def _scales(ax: Axes, cost: Axis, error: Axis, points, floor: float) -> None:
    heights = [_height(p, error, floor) for p in points]
    heights += [min(b, CEILING) for p in points if error.key == "error" and not math.isnan(b := p.value("bound"))]
    widths = [p.value(cost.key) for p in points]
    for axis, values, pad, place in (
        (ax.xaxis, widths, 1.7, ax.set_xlim),
        (ax.yaxis, heights, 2.2, ax.set_ylim),
    ):
        low, high = min(values) / pad, max(values) * pad
        place(low, high)
        ticks = [t for t in decades_between(low, high) if low <= t <= high]
        if len(ticks) < 3:
            ticks = [s * 10.0**e for e in range(-20, 20) for s in (1, 2, 5) if low <= s * 10.0**e <= high]
        axis.set_major_locator(FixedLocator(ticks))
        axis.set_minor_locator(FixedLocator([]))
        axis.set_major_formatter(FuncFormatter(lambda v, _: sr_label(v)))
        axis.set_minor_formatter(NullFormatter())
    ax.set_xlabel(cost.title)
    ax.set_ylabel(error.title)
    ax.grid(color=RULE)


def _labels(fig: Figure, ax: Axes, cost: Axis, error: Axis, points, looks, tolerance) -> None:
    floor = _floor(points, error)
    renderer = fig.canvas.get_renderer()
    kept = front(points, cost.key, error.key)
    # The front first: it is what a reader looks for.
    order = sorted(points, key=lambda p: (p not in kept, p.value(cost.key)))
    at = ax.transData.transform([(p.value(cost.key), _height(p, error, floor)) for p in order])
    texts = [
        ax.text(0, 0, p.setting, fontsize=LETTERS, color=mix(looks[p.method][0], "black", 0.25), zorder=5)
        for p in order
    ]
    boxes = [t.get_window_extent(renderer) for t in texts]
    sizes = np.array([(b.width, b.height) for b in boxes])
    frame = ax.bbox
    inside = (frame.x0 + 1, frame.y0 + 1, frame.x1 - 1, frame.y1 - 1)
    ringed = None if tolerance is None else cheapest(points, cost.key, error.key, tolerance)
    unit = fig.dpi / 72
    radii = np.array([RING / 2 + 1 if p is ringed else 0.6 * MARK for p in order]) * unit
    ends = _bound_ends(ax, cost, error, points, 3 * unit)
    corners = places(at, sizes, inside, radii, ends)
    missing = 0
    for text, corner, point, size in zip(texts, corners, at, sizes, strict=True):
        if corner is None:
            text.remove()
            missing += 1
            continue
        _move(ax, text, corner)
        end = nearest_of(corner, size, point)
        if math.dist(end, point) > 8 * unit:
            line = ax.transAxes.inverted().transform([point, end])
            ax.plot(*line.T, transform=ax.transAxes, color=FAINT, lw=0.4, zorder=2, scalex=False, scaley=False)
    if missing:
        said = f"{missing} labels found no room; the CSV has them"
        ax.text(0.99, 1.01, said, transform=ax.transAxes, ha="right", va="bottom", fontsize=7.5, color=FAINT)


def _bound_ends(ax: Axes, cost: Axis, error: Axis, points, half: float) -> list[tuple[float, float, float, float]]:
    # Boxes around the bars and arrows where the claimed bounds end.
    ends = [(p.value(cost.key), min(p.value("bound"), CEILING)) for p in points if "bound" in p.values]
    if error.key != "error" or not ends:
        return []
    return [(x - half, y - half, x + half, y + half) for x, y in ax.transData.transform(ends)]


def _move(ax: Axes, text, corner) -> None:
    text.set_verticalalignment("bottom")
    text.set_transform(ax.transAxes)
    text.set_position(ax.transAxes.inverted().transform(corner))


def written(chart: Chart, points: Sequence[Point], caption: str, tolerance: float | None = None) -> dict[str, bytes]:
    """The picture as files: ``{"svg": ..., "png": ...}``."""
    with styled(), matplotlib.rc_context({"font.size": 9}):
        fig = chart_figure(chart, points, caption, tolerance)
        png = io.BytesIO()
        fig.savefig(png, format="png", dpi=144)
        label = f"{chart.title}: {', '.join(dict.fromkeys(p.method for p in points))}"
        text = svg(fig, label).replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    return {"svg": text.encode(), "png": png.getvalue()}
