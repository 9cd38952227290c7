"""The atlas as one page: a picture for each method, then every cell that is not right, with its recipe."""

import datetime
import importlib.resources
import re

from gonio import __version__
from gonio.stability.figure import atlas_figure
from gonio.stability.known_failures import reason_of
from gonio.stability.outcome import METHODS, SAYS_SO
from gonio.stability.survey import Atlas, grid_of, recipe

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


def pictures(done: Atlas) -> dict[str, str]:
    """The SVG of each method that has cells."""
    found = {}
    for method in METHODS:
        grid, columns = grid_of(done, method)
        if grid:
            label = f"Verdicts of the {method} method: {len(grid)} models down, {len(columns)} regimes across"
            found[method] = atlas_figure(grid, columns, label, done.counts(method))
    return found


def page(done: Atlas, drawn: dict[str, str]) -> str:
    """The HTML of an atlas, whole in itself."""
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    folder = importlib.resources.files("gonio.stability") / "templates"
    template = environment.from_string((folder / "stress.html.j2").read_text(encoding="utf-8"))
    sections = []
    for method, picture in drawn.items():
        spoken = [c for c in done.cells if c.method == method and c.verdict == SAYS_SO]
        sections.append(
            {
                "method": method,
                "about": ABOUT[method],
                "picture": picture,
                "width": re.search(r'viewBox="0 0 ([\d.]+)', picture)[1],  # points: letters of one size in all pictures
                "counts": done.counts(method),
                "says_so": [_row(c, done.quick) for c in spoken[:MOST]],
                "more": max(0, len(spoken) - MOST),
            }
        )
    made = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    return template.render(
        sections=sections, silent=[_row(c, done.quick) for c in done.silent], last=done.last_line(), made=made,
        version=__version__, quick=done.quick, seconds=round(done.seconds), counts=done.counts(),
    )  # fmt: skip


def _row(c, quick: bool) -> dict[str, str]:
    where = f"{c.column}, {c.precision}"
    return {"setting": c.row, "where": where, "detail": c.detail, "recipe": recipe(c, quick), "reason": reason_of(c)}
