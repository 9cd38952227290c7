"""One picture for each method of the stability atlas: models down, regimes across, red only for silent failures."""

import math

from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle

from gonio.figures.style import INK, styled, svg

COLOURS = {"right": "#dfe9f2", "says so": "#E69F00", "silently wrong": "#c4161c", "": "#ffffff"}
ROW, COLUMN, LEFT = 0.21, 0.24, 1.65  # inches: a model's row, a regime's column, the room for names
LETTER, SLANT, LEGEND = 0.075, 55, 0.7  # inches of a letter, degrees of the regimes' names, inches of the legend


def atlas_figure(grid: dict[str, dict[str, str]], columns: list[str], label: str, counts: dict[str, int]) -> str:
    """An SVG of verdicts: `grid[model][column]`, the worst of the model's settings in each regime."""
    from matplotlib.figure import Figure

    models = list(grid)
    up, along = (f(math.radians(SLANT)) * LETTER for f in (math.sin, math.cos))
    top = max(LEGEND, up * max(map(len, columns))) + 0.25
    across = max((k + 1) * COLUMN + along * len(c) for k, c in enumerate(columns))
    width, height = LEFT + across + 0.1, top + ROW * len(models) + 0.1
    with styled():
        fig = Figure(figsize=(width, height))
        ax = fig.add_axes((LEFT / width, 0.1 / height, COLUMN * len(columns) / width, ROW * len(models) / height))
        for y, model in enumerate(models):
            for x, column in enumerate(columns):
                colour = COLOURS[grid[model].get(column, "")]
                ax.add_patch(Rectangle((x, y), 1, 1, fc=colour, ec="white", lw=1.2))
                if grid[model].get(column) == "silently wrong":  # seen in print without colours as well
                    ax.text(x + 0.5, y + 0.52, "×", color="white", ha="center", va="center", weight="bold")
        _furniture(ax, models, columns)
        handles = [Patch(fc=COLOURS[v], label=f"{v}: {counts.get(v, 0):,}") for v in COLOURS if v]
        fig.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.0), handlelength=1.0, handleheight=1.0)
        return svg(fig, label)


def _furniture(ax: Axes, models: list[str], columns: list[str]) -> None:
    ax.set(xlim=(0, len(columns)), ylim=(len(models), 0))
    ax.set_yticks([y + 0.5 for y in range(len(models))], models)
    ax.xaxis.tick_top()
    ax.set_xticks([x + 0.5 for x in range(len(columns))], columns, rotation=SLANT, ha="left", rotation_mode="anchor")
    ax.tick_params(length=0, colors=INK, labelsize=8.5)
    for spine in ax.spines.values():
        spine.set_visible(False)
