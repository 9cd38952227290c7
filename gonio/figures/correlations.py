"""How the numbers of a fit hang together: their correlations as a square of colours."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import Normalize

from gonio.figures.style import MARK_BLACK, MARK_WHITE, Picture, panel, styled

NAMED = 30
"""Names of more numbers than these find no room."""

WRITTEN = 12
"""So many rows leave room for the values themselves."""


def correlation_figure(names: Sequence[str], correlation: np.ndarray, label: str) -> Picture:
    """Correlations (n, n), NaN where a number is not determined; blue −1, red +1."""
    n = len(names)
    norm = Normalize(-1, 1)
    with styled():
        fig, ax = panel(4.9, 4.1)
        shown = np.ma.masked_invalid(correlation)
        image = ax.imshow(shown, cmap="RdBu_r", norm=norm, interpolation="none")
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
        bar = fig.colorbar(image, ax=ax, pad=0.02, aspect=28)
        bar.solids.set_rasterized(True)
        bar.outline.set_visible(False)
        bar.set_label("correlation")
        return Picture(fig, label)
