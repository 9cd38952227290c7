"""Names from files in figures: every character has a picture, and no text is longer than its place."""

import warnings

import numpy as np
import pytest

from gonio.figures.style import picture

NAMES = ("😀 smile", "赤い光", "a very " + "long " * 40 + "name", "two\nlines", "$x_{bad$ & <b>")


@pytest.mark.parametrize("name", NAMES)
def test_no_name_makes_a_warning_or_a_legend_wider_than_its_panel(name: str) -> None:
    def draw(ax):
        ax.plot(np.arange(3), label=name)
        ax.legend()
        ax.set_title(name)

    made = picture("a name", draw)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made.svg()
    fig = made.figure
    legend = fig.axes[0].get_legend()
    assert legend.get_window_extent().width < fig.bbox.width and "\n" not in legend.get_texts()[0].get_text()


def test_a_name_that_can_be_drawn_stays() -> None:
    fig = picture("a name", lambda ax: ax.set_title("λ 550 nm, θᵢ ≤ 60° – grün")).figure
    assert fig.axes[0].get_title() == "λ 550 nm, θᵢ ≤ 60° – grün"
