"""Axes of values over decades, and how their numbers are written."""

import math

from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(exponent: int) -> str:
    """10 to a power, as text: 10⁻³."""
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def sr_label(value: float) -> str:
    """A tick's value: a plain number between 0.01 and 9999, else with a power of ten."""
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


def log_axis(ax: Axes, low: float, high: float) -> None:
    """A logarithmic y axis over the values low..high, with a grid; 1-2-5 ticks where it spans few decades."""
    # Limits first: scales change by the limits of the data, which may be too close for that.
    ax.set_ylim(low / 1.12, high * 1.12)
    ax.set_yscale("log")
    ax.set_ylim(low / 1.12, high * 1.12)
    span = math.log10(high / low)
    if span < 1.6:
        exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        steps = (1, 1.5, 2, 3, 5, 7) if span < 0.7 else (1, 2, 5)
        ticks = [s * 10.0**e for e in exponents for s in steps if low / 1.12 <= s * 10.0**e <= high * 1.12]
        ax.yaxis.set_major_locator(FixedLocator(ticks))
        ax.yaxis.set_minor_locator(FixedLocator([]))
    else:
        ax.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: sr_label(v)))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.grid(axis="y", which="major")
