"""How public objects show themselves: a short repr, a repr with a picture for notebooks, and `plot`.

The pictures belong to an upper floor, which no lower floor imports: `gonio/__init__.py` names their module here in
`drawings`, and it is loaded by the first picture.
"""

import importlib
import math
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

drawings = ""
"""Name of the module with `plot(object, kind, **options)` and `thumbnail(object)`; empty: there are no pictures."""

LONGEST = 100  # characters of a line of a repr


class Displayed:
    """A public object that says in a few lines what it is (`facts`), and draws itself."""

    def facts(self) -> dict[str, str]:
        """What a person wants to know first, by name, in at most ten lines."""
        raise NotImplementedError

    def __repr__(self) -> str:
        facts = self.facts()
        width = max(map(len, facts), default=0)
        lines = [f"  {name.ljust(width)}  {value}" for name, value in facts.items() if value]
        return "\n".join([type(self).__name__, *(_shortened(line, LONGEST) for line in lines)])

    def _repr_html_(self) -> str:
        import html

        picture = _drawings().thumbnail(self) if drawings else ""
        return f'<div style="display:flex;gap:1em"><pre>{html.escape(repr(self))}</pre>{picture}</div>'

    def plot(self, kind: str | None = None, *, ax: "Axes | None" = None, **options: Any) -> "Axes":
        """Draws the object on matplotlib axes.

        Args:
            kind: lobe, slice, sphere, albedo, or residuals (of a fit); by default what suits the object.
            ax: where to draw; a new figure by default.
            options: those of the kind, see `gonio.figures.plots`: `channel`, `theta_i` (radians), `polar`, `log`.

        Returns:
            The axes.

        Raises:
            GonioError: for a kind that the object does not have.
        """
        return _drawings().plot(self, kind, ax=ax, **options)


def listed(names: Any, most: int = 6) -> str:
    """Names with commas; of more than `most` the first ones and the last."""
    names = [str(n) for n in names]
    return ", ".join(names if len(names) <= most else [*names[: most - 2], "…", names[-1]])


def percent(share: float, digits: int = 2) -> str:
    """A relative number in words, such as "0.52 %": without exponents, nor digits that nobody could use.

    Args:
        share: 1 is "100 %"; not finite is "not known".
        digits: significant ones.

    Returns:
        Between "below 0.0001 %" and "more than 1000 %" a plain number; the sign is kept.
    """
    size = abs(share)
    if not math.isfinite(share):
        return "not known"
    if size == 0:
        return "0 %"
    if size < 1e-6:
        return "below 0.0001 %"
    if size > 10:
        return "more than 1000 %"
    decimals = digits - 1 - math.floor(math.log10(float(f"{100 * size:.{digits - 1}e}")))
    text = f"{round(100 * share, decimals):.{max(0, decimals)}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def _drawings() -> ModuleType:
    return importlib.import_module(drawings)


def _shortened(line: str, longest: int) -> str:
    line = line.replace("\n", " ")
    return line if len(line) <= longest else f"{line[: longest - 1]}…"
