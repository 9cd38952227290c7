"""A campaign as one HTML page: fits by material and model, against noise; numbers, checks, and what failed."""

import datetime
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from gonio import __version__
from gonio.campaigns.store import PAGE, Store
from gonio.campaigns.summary import (
    ModelFits,
    NoiseCurve,
    NumberScatter,
    Row,
    counts_of,
    failing,
    fits_by_model,
    noise_curves,
    number_scatter,
)
from gonio.campaigns.tasks import CHECK, KINDS, REDUCE
from gonio.data.files import new_file
from gonio.figures.style import PALETTE, Picture, colour_of, legend_above, log_axis, picture, plain_powers, size_for
from gonio.models.errors import printable
from gonio.text import written

MOST_PANELS, MOST_ROWS, MOST_NUMBERS = 24, 200, 7
"""Panels of a kind, rows of a table, numbers in a panel: the catalogue has all."""
NAMES = {"measure": "tables", "fit": "fits", "check": "checks", "reduce": "reductions", "report": "pages"}
LOOKS = {"good": "pass", "pass": "pass", "kept": "pass", "fair": "undecided", "undecided": "undecided"}
"""Class of the style sheet for a verdict; all others fail."""


def write_page(store: Store, rows: list[Row]) -> Path:
    """Writes the page of a campaign's folder from the rows of its catalogue."""
    text = page(store.plan()[0], rows, store.not_done())
    with new_file(store.folder / PAGE, force=True) as path:
        path.write_bytes(printable(text, kept="\n").encode(errors="backslashreplace"))
    return store.folder / PAGE


def page(name: str, rows: list[Row], not_done: int = 0) -> str:
    """The self-contained HTML of a campaign, of whose tasks so many are not done."""
    import jinja2

    from gonio.reports.page import rules, themed

    folders = [jinja2.PackageLoader(f"gonio.{room}") for room in ("campaigns", "reports")]
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader(folders), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    scatter, used = number_scatter(rows), set(PALETTE)
    panels: dict[str, list[tuple[str, str]]] = {}
    for title, pictures in (("rms", noise_panels(rows)), ("numbers", number_panels(scatter, fits_by_model(rows)))):
        themes = [themed(p.svg(), set(PALETTE)) for p in pictures[:MOST_PANELS]]
        panels[title] = [(text, p.label) for (text, _), p in zip(themes, pictures, strict=False)]
        used |= set().union(*(needed for _, needed in themes))
    current = [r for r in rows if r["current"]]
    bad = failing(rows)
    return environment.get_template("campaign.html.j2").render(
        name=name or "Campaign", version=__version__, dark=rules(used), panels=panels, look=_look, number=_number,
        made=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        counts=_counts(current), not_done=not_done, other=len(rows) - len(current),
        hours=sum(r["cpu_seconds"] for r in current) / 3600,
        fits=fits_by_model(rows), scatter=scatter[:MOST_ROWS], more_scatter=max(0, len(scatter) - MOST_ROWS),
        checks=counts_of(rows, CHECK), reductions=counts_of(rows, REDUCE), bad=bad[:MOST_ROWS],
        more_bad=max(0, len(bad) - MOST_ROWS),
    )  # fmt: skip


def noise_panels(rows: list[Row]) -> list[Picture]:
    """Of each subject, the relative rms of its fits against photons, a line for each model."""
    return [
        picture(f"{subject}: relative rms of each model's fits", _draw_noise, curves,
                size=size_for([c.model for c in curves]))
        for subject, curves in noise_curves(rows).items()
    ]  # fmt: skip


def number_panels(scatter: list[NumberScatter], fits: list[ModelFits]) -> list[Picture]:
    """Of each subject's best model, how its numbers scatter over seeds against photons, beside what is stated."""
    panels = []
    for subject in dict.fromkeys(s.subject for s in scatter):
        best = _best_model(subject, scatter, fits)
        setting = next(s.setting for s in scatter if s.subject == subject)
        shown = [s for s in scatter if (s.subject, s.model, s.setting) == (subject, best, setting) and s.photons]
        names = list(dict.fromkeys(s.number for s in shown if s.median and s.scatter > 0))[:MOST_NUMBERS]
        if names and len({s.photons for s in shown}) > 1:
            label = f"{subject}: numbers of {best}"
            panels.append(picture(label, _draw_numbers, [s for s in shown if s.number in names],
                                  size=size_for(names)))  # fmt: skip
    return panels


def _best_model(subject: str, scatter: list[NumberScatter], fits: list[ModelFits]) -> str:
    """The model of the fewest numbers among those whose residuals are within 5 % of the smallest."""
    rms = {f.model: f.relative_rms[1] for f in fits if f.subject == subject}
    numbers = {m: len({s.number for s in scatter if (s.subject, s.model) == (subject, m)}) for m in rms}
    least = min(rms[m] for m in rms if numbers[m])
    return min((m for m in rms if numbers[m] and rms[m] <= 1.05 * least), key=lambda m: numbers[m])


def _draw_noise(ax: Axes, curves: list[NoiseCurve]) -> None:
    values = np.concatenate([c.rms[np.isfinite(c.rms) & (c.rms > 0)] for c in curves])
    for k, curve in enumerate(curves):
        style = colour_of(k)
        ax.fill_between(curve.photons, curve.rms[0], curve.rms[2], color=style.colour, alpha=0.18, lw=0)
        ax.plot(
            curve.photons, curve.rms[1], color=style.colour, ls=style.dash, marker="o", ms=4, label=_cut(curve.model)
        )
    ax.set_xscale("log")
    log_axis(ax, float(values.min(initial=1.0)) if values.size else 0.1, float(values.max()) if values.size else 1.0)
    plain_powers(ax.xaxis)
    ax.set(xlabel="photons of the white diffuser in a reading", ylabel="relative rms of residuals")
    legend_above(ax)


def _draw_numbers(ax: Axes, scatter: list[NumberScatter]) -> None:
    values = []
    for k, name in enumerate(dict.fromkeys(s.number for s in scatter)):
        of_name = sorted((s for s in scatter if s.number == name), key=lambda s: s.photons or 0.0)
        photons = np.array([s.photons for s in of_name], float)
        size = np.abs([s.median for s in of_name])
        scattered, stated = (
            np.array([getattr(s, what) for s in of_name]) / size for what in ("scatter", "uncertainty")
        )
        ax.plot(photons, scattered, color=PALETTE[k % len(PALETTE)], marker="o", ms=4, label=_cut(name))
        ax.plot(photons, stated, color=PALETTE[k % len(PALETTE)], ls=(0, (2, 1.5)), lw=1.1)
        values += [*scattered, *stated]
    finite = np.array([v for v in values if np.isfinite(v) and v > 0])
    ax.set_xscale("log")
    log_axis(ax, float(finite.min()) if finite.size else 0.1, float(finite.max()) if finite.size else 1.0)
    plain_powers(ax.xaxis)
    ax.set(xlabel="photons of the white diffuser in a reading", ylabel="scatter over seeds, relative")
    legend_above(ax)


def _counts(rows: list[Row]) -> list[tuple[str, int, dict[str, int]]]:
    """(kind, how many, verdicts or statuses) of the rows."""
    kinds = [(kind, [r for r in rows if r["kind"] == kind]) for kind in KINDS]
    return [(NAMES[k], len(r), dict(Counter(x["verdict"] or x["status"] for x in r))) for k, r in kinds if r]


def _look(verdict: str) -> str:
    return "not-applicable" if verdict == "done" else LOOKS.get(verdict, "fail")


def _number(value: Any, digits: int = 3) -> str:
    return "–" if value is None or not np.isfinite(value) else written(float(value), digits)


def _cut(text: str, most: int = 40) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"
