"""Plain text for terminals and pipes alike: aligned columns, numbers at a readable length."""

import contextlib
import dataclasses
import math
import platform
import sys
from collections.abc import Generator, Sequence

from gonio.models.errors import printable

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def columns(rows: Sequence[Sequence[str]], header: Sequence[str] | None = None) -> str:
    """Rows as aligned columns, two spaces apart; the last column is left ragged. A cell is one line, `printable`."""
    every = [[printable(cell) for cell in row] for row in [*([header] if header else []), *rows]]
    if not every:
        return ""
    widths = [max(len(r[i]) for r in every if i < len(r)) for i in range(max(map(len, every)))]
    lines = ["  ".join(c.ljust(w) for c, w in zip(r, widths, strict=False)).rstrip() for r in every]
    if header:
        # The last column may hold whole sentences: its rule is as long as its heading.
        lines.insert(1, "  ".join("─" * w for w in [*widths[:-1], len(header[-1])]))
    return "\n".join(lines)


def number(value: float | None, digits: int = 6) -> str:
    """A number in at most so many significant digits; a dash where there is none."""
    return "–" if value is None or math.isnan(value) else f"{value:.{digits}g}"


def versions(*packages: str) -> dict[str, str]:
    """Versions of gonio, Python and these packages."""
    from importlib.metadata import version

    from gonio import __version__

    named = {name: version(name) for name in packages}
    return {"gonio": __version__, "python": platform.python_version(), **named}


def power_of_ten(exponent: int) -> str:
    """10 to a power, as text: 10⁻³."""
    return "10" + str(exponent).translate(_SUPERSCRIPTS)


def written(value: float, digits: int = 6) -> str:
    """A number at so many significant digits, with a power of ten where it is very small or large."""
    if value == 0:
        return "0"
    text = f"{value:.{digits - 1}e}"
    mantissa, exponent = text.split("e")
    power = int(exponent)
    if -5 < power < digits:
        return f"{float(text):.{digits - 1 - power}f}".replace("-", "−")
    if -5 < power < 6:
        return f"{value:.0f}".replace("-", "−")
    return f"{without_zeros(mantissa)}×{power_of_ten(power)}".replace("-", "−", 1)


def without_zeros(text: str) -> str:
    """A plain number without zeros at the end of its decimals."""
    return text.rstrip("0").rstrip(".") if "." in text and "×" not in text else text


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


@dataclasses.dataclass(frozen=True)
class Printing:
    """What a command prints: results on standard output, remarks on standard error, and details among the results."""

    results: bool = True
    remarks: bool = True
    details: bool = False


_printing = [Printing()]
"""The last one counts: the demonstration calls one verb from another."""


@contextlib.contextmanager
def printing(quiet: bool = False, verbose: bool = False, data: bool = False) -> Generator[None]:
    """What `show` and `log` print inside the block.

    Args:
        quiet: nothing (errors go to standard error by another way).
        verbose: details too.
        data: standard output is for data (JSON), so results are not shown there.
    """
    now = _printing[-1]
    changed = Printing(now.results and not (quiet or data), now.remarks and not quiet, now.details or verbose)
    _printing.append(changed)
    try:
        yield
    finally:
        _printing.pop()


def is_verbose() -> bool:
    """Whether details are shown too (-v)."""
    return _printing[-1].details


def shows_results() -> bool:
    """Whether `show` prints: not where a user asked for quiet, or standard output is for data."""
    return _printing[-1].results


def show(text: str = "") -> None:
    """Lines to standard output, `printable`, at once: a user of a long command sees them when they are true."""
    if _printing[-1].results:
        print(printable(text, kept="\n"), flush=True)


def log(text: str) -> None:
    """A line to standard error: progress and remarks, which no pipe should swallow."""
    if _printing[-1].remarks:
        print(printable(text, kept="\n"), file=sys.stderr, flush=True)
