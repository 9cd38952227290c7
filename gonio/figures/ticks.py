"""Axes of angles and of values over decades, and the numbers of their ticks."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from gonio.text import power_of_ten

ROOT_DEGREES = (0, 1, 5, 15, 30, 50, 75)
"""Ticks of an axis whose scale is the square root of the angle."""


def sr_label(value: float) -> str:
    """Text of a tick's value: a plain number between 0.01 and 9999, else with a power of ten."""
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)) + 1e-9)
    if -3 < exponent < 4:
        return f"{value:.4g}".replace("-", "−")
    mantissa = value / 10.0**exponent
    head = "" if abs(mantissa - 1) < 1e-6 else f"{mantissa:.3g}·".replace("-", "−")
    return head + power_of_ten(exponent)


def decades_between(low: float, high: float) -> list[float]:
    """The powers of ten from at or below `low` to at or above `high`; not more than seven of them."""
    first, last = math.floor(math.log10(low) + 1e-9), math.ceil(math.log10(high) - 1e-9)
    step = max(1, math.ceil((last - first) / 6))
    return [10.0**e for e in range(last - (last - first) // step * step, last + 1, step)]


def fixed_ticks(axis: Axis, ticks: Sequence[float]) -> None:
    """Ticks at these values, in 1/sr, and no minor ones."""
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_minor_locator(FixedLocator([]))
    axis.set_major_formatter(FuncFormatter(lambda v, _: sr_label(v)))
    axis.set_minor_formatter(NullFormatter())


def mantissa_ticks(low: float, high: float, mantissas: Sequence[float]) -> list[float]:
    """Every mantissa × 10ⁿ from `low` to `high`."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return [m * 10.0**e for e in exponents for m in mantissas if low <= m * 10.0**e <= high]


def degree_axis(axis: Axis, ticks: Iterable[float] = range(0, 91, 15)) -> None:
    """An axis of angles in degrees."""
    axis.set_major_locator(FixedLocator(list(ticks)))
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}°".replace("-", "−")))


def root_degree_axis(axis: Axis) -> None:
    """An axis of angles whose coordinate is the square root of the degrees: highlights are narrow."""
    axis.set_major_locator(FixedLocator(np.sqrt(ROOT_DEGREES).tolist()))
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v * v:.0f}°"))


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
        ax.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: sr_label(v)))
        ax.yaxis.set_minor_formatter(NullFormatter())
    ax.grid(axis="y", which="major")
