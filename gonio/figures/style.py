"""How every panel looks: colours that colour-blind readers tell apart, one size of text, axes; clean SVG."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import html
import io
import math
import re
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gonio.figures.drawing_process import DRAWING
from gonio.figures.legible import make_legible
from gonio.models.deferred import deferred
from gonio.text import sr_label

if TYPE_CHECKING:
    import matplotlib
    from matplotlib import ticker
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.cm import ScalarMappable
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure
else:  # loaded where something is drawn, which may be another process
    matplotlib, ticker = deferred("matplotlib"), deferred("matplotlib.ticker")

# Okabe & Ito 2008, without its yellow (too pale for a line on white); the order keeps neighbours far apart.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#4D4D4D")
DASHES = ((), (5.0, 1.6), (1.2, 1.4), (6.0, 1.5, 1.2, 1.5), (9.0, 2.0))
Dash = str | tuple[int, tuple[float, ...]]
MARKERS = ("o", "s", "^", "D", "v")
INK, FAINT, RULE = "#222222", "#6b6b6b", "#dcdcdc"
MARK_WHITE, MARK_BLACK = "#fefefe", "#010101"
"""Colours of marks on coloured maps, which look the same on a dark page."""
AXIS_GREY = "#8a8a8a"

WIDTH, HEIGHT = 4.9, 3.55  # inches of 72 units each: 353 by 256

# fmt: off
_RC: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "gonio",
    "text.parse_math": False,  # names come from strangers' files: a dollar sign is a dollar sign
    "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "font.size": 9.5,
    "axes.titlesize": 10, "axes.labelsize": 9.5, "text.color": INK, "axes.edgecolor": AXIS_GREY,
    "axes.labelcolor": INK, "axes.linewidth": 0.7, "axes.spines.top": False, "axes.spines.right": False,
    "axes.axisbelow": True, "axes.unicode_minus": True, "axes.formatter.use_mathtext": False,
    "xtick.color": "#555555", "ytick.color": "#555555", "xtick.labelcolor": INK, "ytick.labelcolor": INK,
    "xtick.labelsize": 9, "ytick.labelsize": 9, "grid.color": RULE, "grid.linewidth": 0.6,
    "legend.fontsize": 9, "legend.frameon": False, "lines.linewidth": 1.5, "lines.solid_capstyle": "round",
    "path.simplify": True, "path.simplify_threshold": 0.15, "figure.dpi": 72, "savefig.dpi": 144,
}
# fmt: on
_LOCK = threading.RLock()  # matplotlib's settings belong to the whole process


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Matplotlib's settings for gonio's panels while the block lasts; one thread at a time."""
    with _LOCK, matplotlib.rc_context(_RC):
        yield


def mix(colour: str, other: str, share: float) -> str:
    """Linear mixture of two colours, #rrggbb, as such a text; `share` is that of `other`."""
    return hex_of((1 - share) * rgb_of(colour) + share * rgb_of(other))


def rgb_of(colour: str) -> np.ndarray:
    """Red, green and blue from 0 to 1 of a colour #rrggbb, as Matplotlib takes it, which need not be loaded for it."""
    return np.array([*bytes.fromhex(colour[1:])]) / 255


def hex_of(rgb: np.ndarray) -> str:
    """The colour #rrggbb of red, green and blue from 0 to 1."""
    return f"#{bytes(round(float(v) * 255) for v in rgb).hex()}"


def shades(colour: str, count: int) -> list[str]:
    """`count` shades of one colour, from light to dark."""
    steps = np.linspace(0.45, -0.45, count) if count > 1 else [0.0]
    return [mix(colour, "#ffffff" if s > 0 else "#000000", abs(s)) for s in steps]


class LineStyle(NamedTuple):
    """Colour and lengths of dashes and gaps, none for a solid line."""

    colour: str
    lengths: tuple[float, ...]

    @property
    def dash(self) -> Dash:
        """As matplotlib takes it."""
        return (0, self.lengths) if self.lengths else "-"


def colour_of(number: int) -> LineStyle:
    """The line of the subject or model of this number: no two of the first 35 are alike."""
    return LineStyle(PALETTE[number % len(PALETTE)], DASHES[number // len(PALETTE) % len(DASHES)])


def legend_columns(labels: Sequence[str]) -> int:
    """How many columns of a legend fit a panel."""
    longest = max(map(len, labels), default=1)
    return max(1, min(len(labels), 4, 62 // (longest + 6)))


def size_for(labels: Sequence[str]) -> tuple[float, float]:
    """(width, height) in inches of a panel with a legend of these labels above it."""
    shown = [label for label in labels if not label.startswith("_")]
    rows = -(-len(shown) // legend_columns(shown)) if shown else 0
    return WIDTH, HEIGHT + 0.19 * max(0, rows - 2)


def legend_above(ax: Axes) -> None:
    """A legend in rows above the axes, where it cannot hide a curve."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        ax.legend(
            handles, labels, loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=legend_columns(labels),
            handlelength=1.9, handletextpad=0.5, columnspacing=1.3, borderaxespad=0.2,
        )  # fmt: skip


FEW_DOTS = 30
"""Dots that are drawn larger."""


def draw_dots(ax: Axes, x: np.ndarray, y: np.ndarray, colour: str) -> None:
    """Dots at finite points (n,)."""
    # As one path of strokes without length and with round ends: an element for each mark is most of a page's weight.
    shown = np.isfinite(x) & np.isfinite(y)
    points = np.repeat(np.stack([x[shown], y[shown]], axis=-1), 2, axis=0)
    low, high = ax.get_xlim()  # nothing at all is drawn of no length in a raster
    if ax.get_xscale() == "log":
        points[1::2, 0] *= (high / low) ** 2e-4
    else:
        points[1::2, 0] += 2e-4 * (high - low)
    # Snapped to pixels, most strokes would have no length at all, and a raster would not show them.
    size = 2.9 if shown.sum() > FEW_DOTS else 4.4
    _strokes(ax, points, ec=colour, lw=size, capstyle="round", snap=False)


def draw_bars(ax: Axes, x: np.ndarray, y: np.ndarray, u: np.ndarray | None, colour: str) -> None:
    """Bars from y − u to y + u at points (n,), no lower than the axis; none where u is not known."""
    if u is None or not (shown := np.isfinite(y) & np.isfinite(u) & (u > 0)).any():
        return
    ends = np.stack([np.maximum((y - u)[shown], ax.get_ylim()[0]), (y + u)[shown]], axis=-1)
    _strokes(ax, np.stack([np.repeat(x[shown], 2), ends.ravel()], axis=-1), ec=colour, lw=0.9, capstyle="butt")


def _strokes(ax: Axes, points: np.ndarray, **look: Any) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    path = Path(points, np.tile([Path.MOVETO, Path.LINETO], len(points) // 2))
    path.should_simplify = False
    ax.add_patch(PathPatch(path, fc="none", **look))


def colour_bar(ax: Axes, mapped: ScalarMappable, label: str, extend: str = "neither") -> Colorbar:
    """A colour bar on the right of the axes."""
    bar = ax.figure.colorbar(mapped, ax=ax, pad=0.02, aspect=28, extend=extend)
    if bar.solids is not None:
        bar.solids.set_rasterized(True)
    bar.outline.set_visible(False)
    bar.set_label(label)
    return bar


@dataclasses.dataclass(frozen=True)
class Picture:
    """A figure that is drawn when it is asked for, with its alternative text, to be put on a page or into files."""

    make: Callable[[], Figure]
    label: str
    remote: Future[str | None] | None = None
    """The SVG element, where another process draws it."""

    @functools.cached_property
    def figure(self) -> Figure:
        """The figure itself."""
        with styled():
            return self.make()

    def svg(self) -> str:
        """An inline SVG element."""
        if self.remote is not None and (text := self.remote.result()) is not None:
            return text
        figure = self.figure
        with styled():
            return svg(figure, self.label)

    def svg_file(self) -> bytes:
        """An SVG file of its own."""
        return self.svg().replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1).encode()

    def png(self, dpi: int = 200) -> bytes:
        """A PNG file, on white."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        data, figure = io.BytesIO(), self.figure
        with styled():
            FigureCanvasAgg(figure).print_figure(data, format="png", dpi=dpi, facecolor="white")
        return data.getvalue()


def picture(
    label: str, draw: Callable[..., None], *args: Any, size: tuple[float, float] = (WIDTH, HEIGHT), **options: Any
) -> Picture:
    """`draw(axes, *args, **options)` on a panel of its own; `label` is the alternative text, `size` in inches."""
    made = Picture(functools.partial(_panel, draw, size, args, options), label)
    process = DRAWING.get()
    return made if process is None else dataclasses.replace(made, remote=process.draw(made))


def _panel(
    draw: Callable[..., None], size: tuple[float, float], args: Sequence[Any], options: dict[str, Any]
) -> Figure:
    from matplotlib.figure import Figure

    from gonio.figures.panel_layout import PanelLayout

    fig = Figure(figsize=size, layout=PanelLayout(w_pad=0.03, h_pad=0.03), facecolor="none")
    draw(fig.add_subplot(facecolor="none"), *args, **options)
    return make_legible(fig)


def svg(fig: Figure, label: str) -> str:
    """The figure as an inline SVG element with `label` as its alternative text.

    Text stays text; ids that nothing refers to are dropped, the others are made unique on a page.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    FigureCanvasSVG(fig).print_svg(buffer, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.S)
    return _tidy(text, label)


def _tidy(text: str, label: str) -> str:
    # Only inside of tags: what stands between them is labels, some from strangers' files.
    prefix = f"g{zlib.crc32((label + text).encode()):x}_"
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', text))
    names = {name: f"{prefix}{k}" for k, name in enumerate(sorted(used))}

    def tag(match: re.Match) -> str:
        t = match[0]
        t = re.sub(r'\sid="([^"]*)"', lambda m: f' id="{names[m[1]]}"' if m[1] in names else "", t)
        t = re.sub(r'(url\(#|href="#)([^)"]+)', lambda m: m[1] + names.get(m[2], m[2]), t)
        t = t.replace("xlink:href=", "href=")
        if "base64," not in t:
            t = re.sub(r"(\d+\.\d\d)\d+", r"\1", t)
        return re.sub(r"\s+", " ", t)

    text = re.sub(r"<[^>]*>", tag, text)
    text = re.sub(r">\s+<", "><", text)
    viewbox = "".join(re.findall(r'viewBox="[^"]*"', text)[:1])
    opening = f'<svg {viewbox} role="img" aria-label="{html.escape(label, quote=True)}" class="panel">'
    return re.sub(r"<svg[^>]*>", lambda m: opening, text, count=1)


DECADES = 6
"""A logarithmic picture shows this many decades below its largest value."""
ROOT_DEGREES = (0, 1, 5, 15, 30, 50, 75)
"""Ticks of an axis whose scale is the square root of the angle."""


def decades_between(low: float, high: float) -> list[float]:
    """The powers of ten from at or below `low` to at or above `high`; not more than seven of them."""
    first, last = math.floor(math.log10(low) + 1e-9), math.ceil(math.log10(high) - 1e-9)
    step = max(1, math.ceil((last - first) / 6))
    return [10.0**e for e in range(last - (last - first) // step * step, last + 1, step)]


def positive_range(values: np.ndarray, least: float, widen: float, decades: float = DECADES) -> tuple[float, float]:
    """Ends of a logarithmic scale, some decades apart at most; widened where the positive values are within `least`."""
    positive = values[np.isfinite(values) & (values > 0)]
    if not positive.size:
        return 0.1, 1.0
    high = float(positive.max())
    low = max(float(positive.min()), high * 10.0**-decades)
    return (low, high) if high / low >= least else (low / widen, high * widen)


def fixed_ticks(axis: Axis, ticks: Sequence[float]) -> None:
    """Ticks at these values, in 1/sr, and no minor ones."""
    axis.set_major_locator(ticker.FixedLocator(ticks))
    axis.set_minor_locator(ticker.FixedLocator([]))
    axis.set_major_formatter(ticker.FuncFormatter(lambda v, _: sr_label(v)))
    axis.set_minor_formatter(ticker.NullFormatter())


def mantissa_ticks(low: float, high: float, mantissas: Sequence[float]) -> list[float]:
    """Every mantissa × 10ⁿ from `low` to `high`."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return [m * 10.0**e for e in exponents for m in mantissas if low <= m * 10.0**e <= high]


def degree_axis(axis: Axis, ticks: Iterable[float] = range(0, 91, 15)) -> None:
    """An axis of angles in degrees."""
    axis.set_major_locator(ticker.FixedLocator(list(ticks)))
    axis.set_major_formatter(ticker.FuncFormatter(lambda v, _: f"{v:.0f}°".replace("-", "−")))


def root_degree_axis(axis: Axis) -> None:
    """An axis of angles whose coordinate is the square root of the degrees: highlights are narrow."""
    axis.set_major_locator(ticker.FixedLocator(np.sqrt(ROOT_DEGREES).tolist()))
    axis.set_major_formatter(ticker.FuncFormatter(lambda v, _: f"{v * v:.0f}°"))


def plain_powers(*axes: Axis) -> None:
    """Powers of ten in plain text at the decades of logarithmic axes, and no minor labels."""
    for axis in axes:
        axis.set_major_formatter(ticker.FuncFormatter(lambda v, _: sr_label(v)))
        axis.set_minor_formatter(ticker.NullFormatter())


def log_axis(ax: Axes, low: float, high: float) -> None:
    """A logarithmic y axis over the values low..high, with a grid; 1-2-5 ticks where it spans few decades."""
    # Limits first: scales change by the limits of the data, which may be too close for that.
    ax.set_ylim(low / 1.12, high * 1.12)
    ax.set_yscale("log")
    ax.set_ylim(low / 1.12, high * 1.12)
    span = math.log10(high / low)
    if span < 1.6:
        fixed_ticks(
            ax.yaxis, mantissa_ticks(low / 1.12, high * 1.12, (1, 1.5, 2, 3, 5, 7) if span < 0.7 else (1, 2, 5))
        )
    else:
        ax.yaxis.set_minor_locator(ticker.LogLocator(subs=(2, 5)))
        ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda v, _: sr_label(v)))
        ax.yaxis.set_minor_formatter(ticker.NullFormatter())
    ax.grid(axis="y", which="major")
