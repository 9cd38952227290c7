"""The atlas as one HTML page: a picture for each method, and the cells that are not right, with their recipes."""

import datetime
import importlib.resources
import re

from gonio import __version__
from gonio.stability.figure import atlas_figure
from gonio.stability.outcome import METHODS, SAYS_SO, Cell
from gonio.stability.result import Atlas

ABOUT = {
    "value": "f against the textbook form at forty digits: right within 32 roundings and what the rounding of the "
    "inputs makes of it.",
    "gradient": "∂f by every parameter against differences at forty digits, and all derivatives by the directions "
    "finite.",
    "sampler": "χ² of what the importance map draws against the density it claims, at the 1 % level over all tests "
    "together [Šidák 1967], and the density against ∫ = 1.",
    "integral": "The directional albedo against rings about the lobe: right where the claimed bound holds and is below "
    "1e-6; it says so where the bound holds and is larger.",
    "fit": "Fits of the model to readings of itself: right within five standard uncertainties and nothing to say; it "
    "says so where a number is called undetermined or on its bound, or the fit not converged.",
}
MOST = 400
"""Cells of a method that the page lists; the CSV has all."""


def pictures(atlas: Atlas) -> dict[str, str]:
    """The SVG of each method that has cells."""
    figures = {}
    for method in METHODS:
        grid = atlas.verdict_grid(method)
        if grid.verdicts:
            size = f"{len(grid.verdicts)} models down, {len(grid.columns)} regimes across"
            figures[method] = atlas_figure(grid, f"Verdicts of the {method} method: {size}", atlas.counts(method))
    return figures


def page(atlas: Atlas, svg: dict[str, str]) -> str:
    """The self-contained HTML of an atlas with its pictures, one of each method."""
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    folder = importlib.resources.files("gonio.stability") / "templates"
    template = environment.from_string((folder / "stress.html.j2").read_text(encoding="utf-8"))
    sections = []
    for method, picture in svg.items():
        says_so = [c for c in atlas.of_method(method) if c.verdict == SAYS_SO]
        view_box = re.search(r'viewBox="0 0 ([\d.]+)', picture)
        sections.append(
            {
                "method": method,
                "about": ABOUT[method],
                "picture": picture,
                "width": view_box[1] if view_box else "",  # points: letters of one size in all pictures
                "counts": atlas.counts(method),
                "says_so": [_row(c, atlas.quick) for c in says_so[:MOST]],
                "more": max(0, len(says_so) - MOST),
            }
        )
    made = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    return template.render(
        sections=sections, silent=[_row(c, atlas.quick) for c in atlas.silent], last=atlas.last_line(), made=made,
        version=__version__, quick=atlas.quick, seconds=round(atlas.seconds), counts=atlas.counts(),
    )  # fmt: skip


def _row(c: Cell, quick: bool) -> dict[str, str]:
    where = f"{c.column}, {c.precision}"
    return {"setting": c.row, "where": where, "detail": c.detail, "recipe": c.recipe(quick)}
