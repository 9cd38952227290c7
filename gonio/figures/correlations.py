"""Correlation matrix of the free parameters of a fit, as a square of colours."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from gonio.figures.style import MARK_BLACK, MARK_WHITE, colour_bar

SIZE = (4.9, 4.1)
NAMED = 30
"""Names of more parameters than these have no room."""
WRITTEN = 12
"""Rows of which the values themselves are written."""


def draw_correlations(ax: Axes, names: Sequence[str], correlation: np.ndarray) -> None:
    """Correlations (n, n), NaN where a parameter is undetermined; blue −1, red +1."""
    n = len(names)
    image = ax.imshow(
        np.ma.masked_invalid(correlation), cmap="RdBu_r", norm=Normalize(-1, 1), interpolation="none"
    )  # fmt: skip
    if n <= NAMED:
        ax.set_xticks(range(n), names, rotation=90, fontsize=min(8.5, 160 / n))
        ax.set_yticks(range(n), names, fontsize=min(8.5, 160 / n))
    else:
        ax.set(xlabel=f"{n} numbers", ylabel=f"{n} numbers")
    for (row, column), value in np.ndenumerate(correlation if n <= WRITTEN else np.empty((0, 0))):
        if np.isfinite(value):
            text = f"{value:.2f}".replace("-", "−").replace("0.", ".")
            colour = MARK_WHITE if abs(value) > 0.65 else MARK_BLACK
            ax.text(column, row, text, ha="center", va="center", fontsize=7, color=colour)
    colour_bar(ax, image, "correlation")
