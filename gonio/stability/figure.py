"""One picture for each method of the stability atlas: models down, regimes across, red only for silent failures."""

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from gonio.figures.style import INK, styled, svg
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT
from gonio.stability.result import VerdictGrid

COLOURS = {RIGHT: "#dfe9f2", SAYS_SO: "#E69F00", SILENT: "#c4161c"}
NO_CELL = "#ffffff"
ROW, COLUMN, LEFT = 0.21, 0.24, 1.65  # inches: a model's row, a regime's column, the room for names
LETTER, SLANT, LEGEND = 0.075, 55, 0.7  # inches of a letter, degrees of the regimes' names, inches of the legend


def atlas_figure(grid: VerdictGrid, label: str, counts: dict[str, int]) -> str:
    """An SVG of the verdicts by model and regime, with the counts of all cells in the legend."""
    models, columns = list(grid.verdicts), grid.columns
    up, along = (f(math.radians(SLANT)) * LETTER for f in (math.sin, math.cos))
    top = max(LEGEND, up * max(map(len, columns))) + 0.25
    across = max((k + 1) * COLUMN + along * len(c) for k, c in enumerate(columns))
    width, height = LEFT + across + 0.1, top + ROW * len(models) + 0.1
    with styled():
        fig = Figure(figsize=(width, height))
        ax = fig.add_axes((LEFT / width, 0.1 / height, COLUMN * len(columns) / width, ROW * len(models) / height))
        for y, row in enumerate(grid.verdicts.values()):
            for x, verdict in enumerate(row.get(column, "") for column in columns):
                ax.add_patch(Rectangle((x, y), 1, 1, fc=COLOURS.get(verdict, NO_CELL), ec="white", lw=1.2))
                if verdict == SILENT:  # visible in print without colours as well
                    ax.text(x + 0.5, y + 0.52, "×", color="white", ha="center", va="center", weight="bold")
        _label_axes(ax, models, columns)
        handles = [Patch(fc=colour, label=f"{v}: {counts.get(v, 0):,}") for v, colour in COLOURS.items()]
        fig.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.0), handlelength=1.0, handleheight=1.0)
        return svg(fig, label)


def _label_axes(ax: Axes, models: list[str], columns: list[str]) -> None:
    ax.set(xlim=(0, len(columns)), ylim=(len(models), 0))
    ax.set_yticks([y + 0.5 for y in range(len(models))], models)
    ax.xaxis.tick_top()
    ax.set_xticks([x + 0.5 for x in range(len(columns))], columns, rotation=SLANT, ha="left", rotation_mode="anchor")
    ax.tick_params(length=0, colors=INK, labelsize=8.5)
    for spine in ax.spines.values():
        spine.set_visible(False)
