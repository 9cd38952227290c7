"""Texts of figures that hold names from files: of characters that the font has, and no longer than their place."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.ft2font import FT2Font

IN_LEGEND, IN_LINE = 36, 110
"""Characters of a legend's label, and of a line of any other text."""


def make_legible(fig: Figure) -> Figure:
    """The figure, its legends, titles, notes and labels rewritten where a character or the length would not fit."""
    legends = [*fig.legends, *(legend for ax in fig.axes if (legend := ax.get_legend()) is not None)]
    for text in (t for legend in legends for t in legend.get_texts()):
        if (name := text.get_text()) != (short := legible(" ".join(name.split()), IN_LEGEND)):
            text.set_text(short)
    others = [*fig.texts, *(t for ax in fig.axes for t in (*ax.texts, ax.title, ax.xaxis.label, ax.yaxis.label))]
    for text in others:
        lines = text.get_text().split("\n")
        if lines != (short_lines := [legible(line, IN_LINE) for line in lines]):
            text.set_text("\n".join(short_lines))
    return fig


def legible(text: str, longest: int) -> str:
    """A line in which characters without a picture are named U+1F600, its middle left out where it is too long."""
    known = text if text.isascii() and text.isprintable() else "".join(map(_known, text))
    return known if len(known) <= longest else known[: longest - 13] + "…" + known[-12:]


@functools.lru_cache(maxsize=1024)
def _known(character: str) -> str:
    """The character, or its number where the font has no picture of it."""
    pictured = character.isprintable() and _font().get_char_index(ord(character)) != 0
    return character if pictured else f"U+{ord(character):04X} "


@functools.lru_cache(maxsize=1)
def _font() -> FT2Font:
    from matplotlib import font_manager

    return font_manager.get_font(font_manager.findfont(font_manager.FontProperties()))
