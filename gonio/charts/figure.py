"""Speed against accuracy on logarithmic axes: methods as marks, their bounds as bars, the Pareto front as a line."""

import dataclasses
import math
import textwrap
from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from gonio.charts.point import Axis, Chart, Point, cheapest, front, shown
from gonio.figures import style
from gonio.figures.style import FAINT, INK
from gonio.text import sr_label

ANGLES = np.radians([20, -20, 160, -160, 60, -60, 120, -120, 0, 180, 90, -90])
DISTANCES = (3, 7, 13, 21, 34, 46, 60, 78, 100, 130, 165, 205, 250, 300)
SLACK = np.array([-1.0, -1.0, 1.0, 1.0])
"""Free space around a label, in the units of the coordinates."""

Box = tuple[float, float, float, float]
"""Left, lower, right and upper edge."""


def places(
    points: np.ndarray, sizes: np.ndarray, inside: Box, radii: np.ndarray, others: Sequence[Box] = ()
) -> list[tuple[float, float] | None]:
    """The lower left corner of each label, placed in the order they come in; None for one without room.

    Args:
        points: positions (n, 2), in one unit such as pixels.
        sizes: width and height (n, 2) of the labels.
        inside: where labels may stand.
        radii: of the points' marks, (n,).
        others: boxes that no label may cover either.
    """
    points, sizes = np.asarray(points, float), np.asarray(sizes, float)
    marks = np.concatenate([points - radii[:, None], points + radii[:, None]], axis=1)
    taken = np.concatenate([marks, np.asarray(others, float).reshape(-1, 4)])
    corners: list[tuple[float, float] | None] = []
    for point, size, radius in zip(points, sizes, radii, strict=True):
        boxes = _candidates(point, size, radius)
        free = (boxes[:, :2] >= inside[:2]).all(1) & (boxes[:, 2:] <= inside[2:]).all(1)
        low, high = boxes[:, None, :2], boxes[:, None, 2:]
        free &= ~((low < taken[:, 2:]) & (taken[:, :2] < high)).all(axis=-1).any(axis=-1)
        if not free.any():
            corners.append(None)
            continue
        best = boxes[np.argmax(free)]
        corners.append((float(best[0]), float(best[1])))
        taken = np.concatenate([taken, [best + SLACK]])
    return corners


def _candidates(point: np.ndarray, size: np.ndarray, radius: float) -> np.ndarray:
    # Boxes (k, 4), the nearest first. The side of the label that faces the mark is `distance` from it.
    along = np.stack([np.cos(ANGLES), np.sin(ANGLES)], -1)
    away = (radius + np.array(DISTANCES))[:, None, None] + size / 2
    corners = (point + along * away - size / 2).reshape(-1, 2)
    return np.concatenate([corners, corners + size], axis=1)


def nearest_of(corner: Sequence[float], size: Sequence[float], point: Sequence[float]) -> list[float]:
    """The position on a label's box that is nearest to its point: where the line between them ends."""
    return [min(max(p, c), c + s) for p, c, s in zip(point, corner, size, strict=True)]


WIDTH, HEIGHT = 5.4, 4.5  # inches of a frame
LARGE = (7.6, 6.4)  # of one with very many points
MANY = 45
COLUMNS = 3
MARK, RING = 5.0, 11.0  # points across
MARKS = (*style.MARKERS, "P", "X")
CEILING = 10.0
"""Errors beyond stand on the upper edge: they are as wrong as can be."""
LETTERS = 8.0
DASHES = (0, (4, 2))

Looks = Mapping[str, tuple[str, str]]
"""Colour and mark of each method."""


def chart_figure(chart: Chart, points: Sequence[Point], caption: str, tolerance: float | None = None) -> Figure:
    """A frame for each panel and pair of axes; `caption` says where and how the points were measured.

    Labels that find no room are counted in their frame. The cheapest method within `tolerance` is ringed. Call it, and
    write its figure, inside of `gonio.figures.style.styled`.
    """
    panels = list(dict.fromkeys(p.panel for p in points))
    looks = _looks(list(dict.fromkeys(p.method for p in points)))
    # Several frames of one panel stand side by side, panels below each other.
    pairs = [(panel, axes) for panel in panels for axes in chart.frames]
    most = max(sum(p.panel == panel for p in points) for panel in panels)
    width, height = LARGE if most > MANY else (WIDTH, HEIGHT)
    columns = len(chart.frames) if len(chart.frames) > 1 else 2 if len(panels) == 4 else min(COLUMNS, len(panels))
    rows = math.ceil(len(pairs) / columns)
    lines = textwrap.wrap(f"{chart.about} {caption}", round(columns * width * 15.5))
    foot = 0.16 * len(lines) + 0.15
    engine = ConstrainedLayoutEngine()
    fig = Figure(figsize=(columns * width, rows * height + foot), layout=engine)
    renderer = FigureCanvasAgg(fig).get_renderer
    every = np.ravel(fig.subplots(rows, columns, squeeze=False))
    for ax in every[len(pairs) :]:
        ax.set_visible(False)
    frames = [
        _Frame(ax, *axes, [p for p in points if p.panel == panel], looks, tolerance)
        for ax, (panel, axes) in zip(every, pairs, strict=False)
    ]
    for frame, (panel, _) in zip(frames, pairs, strict=True):
        frame.draw(panel)
    head = _legend(fig, renderer(), _handles(looks, tolerance, any("bound" in p.values for p in points))) + 0.35
    tall = rows * height + foot + head
    fig.set_size_inches(columns * width, tall)
    fig.legends[0].set_bbox_to_anchor((0.006, 1 - 0.3 / tall), transform=fig.transFigure)
    fig.text(0.012, 1 - 0.1 / tall, chart.title, fontsize=12, weight="bold", va="top", color=INK)
    fig.text(0.012, 0.08 / tall, "\n".join(lines), fontsize=8, color=FAINT, va="bottom")
    engine.set(rect=(0, foot / tall, 1, 1 - (foot + head) / tall), w_pad=0.08, h_pad=0.08)
    fig.draw_without_rendering()
    fig.set_layout_engine("none")
    for frame in frames:
        frame.label(renderer())
    return fig


def _looks(methods: Sequence[str]) -> Looks:
    # "layout, interpolation": a colour for what comes first, a mark for what comes last; else both go with the method.
    parts = {m: m.rpartition(", ") for m in methods}
    families = list(dict.fromkeys(first or m for m, (first, _, _) in parts.items()))
    variants = list(dict.fromkeys(last for first, _, last in parts.values() if first))
    looks = {}
    for m, (first, _, last) in parts.items():
        family = families.index(first or m)
        mark = variants.index(last) if first else family
        looks[m] = style.PALETTE[family % len(style.PALETTE)], MARKS[mark % len(MARKS)]
    return looks


def _handles(looks: Looks, tolerance: float | None, bounds: bool) -> list[Line2D]:
    handles = [Line2D([], [], ls="", marker=mark, color=c, ms=MARK + 1, label=m) for m, (c, mark) in looks.items()]
    handles.append(Line2D([], [], color=INK, lw=1.0, ls=DASHES, label="Pareto front"))
    if bounds:
        handles.append(Line2D([], [], color=FAINT, lw=0.8, marker="_", ms=6, label="claimed bound"))
    if tolerance is not None:
        label = f"cheapest within {sr_label(tolerance)}"
        handles.append(Line2D([], [], marker="o", ms=RING, mfc="none", color=INK, ls="", label=label))
    return handles


def _legend(fig: Figure, renderer: RendererAgg, handles: list[Line2D]) -> float:
    """Adds a legend of as many columns as fit; its height in inches."""
    for columns in range(min(8, len(handles)), 0, -1):
        legend = fig.legend(
            handles=handles, loc="upper left", ncols=columns, handletextpad=0.4, columnspacing=1.2, fontsize=8.5
        )
        legend.set_in_layout(False)
        box = legend.get_window_extent(renderer)
        if columns == 1 or box.width < 0.98 * fig.bbox.width:
            break
        legend.remove()
    return box.height / fig.dpi


@dataclasses.dataclass
class _Frame:
    """The points of one panel by one cost and one error."""

    ax: Axes
    cost: Axis
    error: Axis
    points: list[Point]
    looks: Looks
    tolerance: float | None

    def __post_init__(self) -> None:
        # Nothing stands as exact: an error of 0 stands at the least one there is, or at the rounding of a double.
        self.floor = min((v for p in self.points if (v := shown(p, self.error.key)) > 1e-17), default=1e-16)
        self.front = front(self.points, self.cost.key, self.error.key)
        self.best = None
        if self.tolerance is not None:
            self.best = cheapest(self.points, self.cost.key, self.error.key, self.tolerance)

    def place(self, p: Point) -> tuple[float, float]:
        """(cost, error) of a point, the error between the floor and the ceiling."""
        value = shown(p, self.error.key)
        return p.value(self.cost.key), min(max(value, self.floor), CEILING) if math.isfinite(value) else CEILING

    def bound(self, p: Point) -> float | None:
        """The claimed bound of a point in a frame of the error that it bounds, at most the ceiling."""
        bound = p.value("bound")
        return None if self.error.key != "error" or math.isnan(bound) else min(bound, CEILING)

    def draw(self, title: str) -> None:
        self.ax.set(xscale="log", yscale="log")
        line = np.reshape([self.place(p) for p in self.front], (-1, 2))
        self.ax.plot(*line.T, color=INK, lw=1.0, ls=DASHES, zorder=1.5)
        for p in self.points:
            self._mark(p)
        if self.tolerance is not None:
            self.ax.axhline(self.tolerance, color=FAINT, lw=0.8, zorder=1)
        if self.best:
            self.ax.plot(*self.place(self.best), marker="o", ms=RING, mfc="none", mec=INK, zorder=4)
        self._scale()
        self.ax.set_title(title, loc="left", color=INK)

    def _mark(self, p: Point) -> None:
        x, y = self.place(p)
        colour, mark = self.looks[p.method]
        bound = self.bound(p)
        if bound is not None:
            top = max(bound, y)
            self.ax.plot([x, x], [y, top], color=colour, lw=0.7, alpha=0.55, zorder=1.6)
            end = "_" if p.value("bound") <= CEILING else "^"
            self.ax.plot([x], [top], marker=end, ms=6, color=colour, alpha=0.7, zorder=1.6)
        edge, width = ("#c4161c", 1.6) if p.holds is False else ("white", 0.5)
        self.ax.plot([x], [y], ls="", marker=mark, ms=MARK, color=colour, mec=edge, mew=width, zorder=3)

    def _scale(self) -> None:
        costs, heights = (list(values) for values in zip(*map(self.place, self.points), strict=True))
        heights += [b for p in self.points if (b := self.bound(p)) is not None]
        xlim, ylim = (min(costs) / 1.7, max(costs) * 1.7), (min(heights) / 2.2, max(heights) * 2.2)
        self.ax.set(xlim=xlim, ylim=ylim, xlabel=self.cost.title, ylabel=self.error.title)
        style.fixed_ticks(self.ax.xaxis, _ticks(*xlim))
        style.fixed_ticks(self.ax.yaxis, _ticks(*ylim))
        self.ax.grid(color=style.RULE)

    def label(self, renderer: RendererAgg) -> None:
        """Writes the settings beside their points, the front first: it is what a reader looks for."""
        unit, to_pixels = renderer.dpi / 72, self.ax.transData.transform
        order = sorted(self.points, key=lambda p: (p not in self.front, p.value(self.cost.key)))
        texts = [
            self.ax.text(
                0, 0, p.setting, fontsize=LETTERS, color=style.mix(self.looks[p.method][0], "#000000", 0.25), zorder=5
            )
            for p in order
        ]
        extents = [t.get_window_extent(renderer) for t in texts]
        sizes = np.array([(b.width, b.height) for b in extents])
        marks = to_pixels([self.place(p) for p in order])
        radii = np.array([RING / 2 + 1 if p is self.best else 0.6 * MARK for p in order]) * unit
        edge = self.ax.bbox
        inside = (edge.x0 + 1, edge.y0 + 1, edge.x1 - 1, edge.y1 - 1)
        corners = places(marks, sizes, inside, radii, self._bound_ends(3 * unit))
        to_axes = self.ax.transAxes.inverted().transform
        for text, corner, mark, size in zip(texts, corners, marks, sizes, strict=True):
            if corner is None:
                text.remove()
                continue
            text.set(verticalalignment="bottom", transform=self.ax.transAxes, position=to_axes(corner))
            end = nearest_of(corner, size, mark)
            if math.dist(end, mark) > 8 * unit:
                line = to_axes([mark, end])
                self.ax.plot(
                    *line.T,
                    transform=self.ax.transAxes,
                    color=FAINT,
                    lw=0.4,
                    zorder=2,
                    scalex=False,
                    scaley=False,
                )
        missing = corners.count(None)
        if missing:
            note = f"{missing} labels found no room; the CSV has them"
            self.ax.text(
                0.99, 1.01, note, transform=self.ax.transAxes, ha="right", va="bottom", fontsize=7.5, color=FAINT
            )

    def _bound_ends(self, half: float) -> list[Box]:
        # Boxes around the bars and arrows where the claimed bounds end.
        ends = [(p.value(self.cost.key), b) for p in self.points if (b := self.bound(p)) is not None]
        pixels = self.ax.transData.transform(ends) if ends else []
        return [(x - half, y - half, x + half, y + half) for x, y in pixels]


def _ticks(low: float, high: float) -> list[float]:
    decades = [t for t in style.decades_between(low, high) if low <= t <= high]
    return decades if len(decades) >= 3 else style.mantissa_ticks(low, high, (1, 2, 5))


def picture_files(
    chart: Chart, points: Sequence[Point], caption: str, tolerance: float | None = None
) -> dict[str, bytes]:
    """The picture as files: ``{"svg": ..., "png": ...}``."""
    with style.styled(), matplotlib.rc_context({"font.size": 9}):
        label = f"{chart.title}: {', '.join(dict.fromkeys(p.method for p in points))}"
        figure = chart_figure(chart, points, caption, tolerance)
    picture = style.Picture(lambda: figure, label)
    return {"svg": picture.svg_file(), "png": picture.png(dpi=144)}
