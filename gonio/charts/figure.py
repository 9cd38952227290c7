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

from gonio.charts.label_placement import nearest_of, places
from gonio.charts.point import Axis, Chart, Point, cheapest, front, shown
from gonio.figures.style import FAINT, INK, MARKERS, PALETTE, RULE, mix, styled, svg
from gonio.figures.ticks import decades_between, sr_label

WIDTH, HEIGHT = 5.4, 4.5  # inches of a frame
LARGE = (7.6, 6.4)  # of one with very many points
MANY = 45
COLUMNS = 3
MARK, RING = 5.0, 11.0  # points across
MARKS = (*MARKERS, "P", "X")
CEILING = 10.0
"""Errors beyond are drawn on the upper edge: they are as wrong as can be."""
LETTERS = 8.0


def chart_figure(chart: Chart, points: Sequence[Point], caption: str, tolerance: float | None = None) -> Figure:
    """A frame for each panel and pair of axes; `caption` says where and how the points were measured.

    Labels that find no room are counted in their frame. The cheapest method within `tolerance` is ringed. Call it, and
    write its figure, inside of `gonio.figures.style.styled`.
    """
    panels = list(dict.fromkeys(p.panel for p in points))
    looks = _looks(list(dict.fromkeys(p.method for p in points)))
    # Several frames of one panel stand side by side, panels below each other.
    drawn = [(axes, panel) for panel in panels for axes in chart.frames]
    most = max(sum(p.panel == panel for p in points) for panel in panels)
    width, height = LARGE if most > MANY else (WIDTH, HEIGHT)
    columns = len(chart.frames) if len(chart.frames) > 1 else 2 if len(panels) == 4 else min(COLUMNS, len(panels))
    rows = math.ceil(len(drawn) / columns)
    words = textwrap.wrap(f"{chart.about} {caption}", round(columns * width * 15.5))
    foot = 0.16 * len(words) + 0.15
    fig = Figure(figsize=(columns * width, rows * height + foot), layout="constrained")
    FigureCanvasAgg(fig)
    every = np.ravel(fig.subplots(rows, columns, squeeze=False))
    for ax in every[len(drawn) :]:
        ax.set_visible(False)
    for ax, ((cost, error), panel) in zip(every, drawn, strict=False):
        _frame(ax, cost, error, [p for p in points if p.panel == panel], looks, tolerance, panel)
    head = _legend(fig, _handles(looks, tolerance, any("bound" in p.values for p in points))) + 0.35
    tall = rows * height + foot + head
    fig.set_size_inches(columns * width, tall)
    fig.legends[0].set_bbox_to_anchor((0.006, 1 - 0.3 / tall), transform=fig.transFigure)
    fig.text(0.012, 1 - 0.1 / tall, chart.title, fontsize=12, weight="bold", va="top", color=INK)
    fig.text(0.012, 0.08 / tall, "\n".join(words), fontsize=8, color=FAINT, va="bottom")
    fig.get_layout_engine().set(rect=(0, foot / tall, 1, 1 - (foot + head) / tall), w_pad=0.08, h_pad=0.08)
    fig.draw_without_rendering()
    fig.set_layout_engine("none")
    for ax, ((cost, error), panel) in zip(every, drawn, strict=False):
        _labels(fig, ax, cost, error, [p for p in points if p.panel == panel], looks, tolerance)
    return fig


def _looks(methods: Sequence[str]) -> dict[str, tuple[str, str]]:
    # "layout, interpolation": a colour for what comes first, a mark for what comes last; else both go with the method.
    parts = {m: m.rpartition(", ") for m in methods}
    families = list(dict.fromkeys(first or m for m, (first, _, _) in parts.items()))
    variants = list(dict.fromkeys(last for first, _, last in parts.values() if first))
    looks = {}
    for m, (first, _, last) in parts.items():
        family = families.index(first or m)
        mark = variants.index(last) if first else family
        looks[m] = PALETTE[family % len(PALETTE)], MARKS[mark % len(MARKS)]
    return looks


def _handles(looks, tolerance, bounds: bool) -> list[Line2D]:
    handles = [Line2D([], [], ls="", marker=mark, color=c, ms=MARK + 1, label=m) for m, (c, mark) in looks.items()]
    handles.append(Line2D([], [], color=INK, lw=1.0, ls=(0, (4, 2)), label="Pareto front"))
    if bounds:
        handles.append(Line2D([], [], color=FAINT, lw=0.8, marker="_", ms=6, label="claimed bound"))
    if tolerance is not None:
        ring = {"marker": "o", "ms": RING, "mfc": "none", "color": INK, "ls": ""}
        handles.append(Line2D([], [], **ring, label=f"cheapest within {sr_label(tolerance)}"))
    return handles


def _legend(fig: Figure, handles: list[Line2D]) -> float:
    """Puts a legend of as many columns as fit; its height in inches."""
    for columns in range(min(8, len(handles)), 0, -1):
        legend = fig.legend(
            handles=handles, loc="upper left", ncols=columns, handletextpad=0.4, columnspacing=1.2, fontsize=8.5
        )
        legend.set_in_layout(False)
        box = legend.get_window_extent(fig.canvas.get_renderer())
        if columns == 1 or box.width < 0.98 * fig.bbox.width:
            break
        legend.remove()
    return box.height / fig.dpi


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
