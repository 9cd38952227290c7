"""Pictures drawn beside the computing, and the layout of panels that measures its labels once."""

import json
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from gonio.figures.maps import MAP_SIZE, SCALE_SIZE, draw_scale
from gonio.figures.panel_layout import PanelLayout
from gonio.figures.style import HEIGHT, WIDTH, picture, styled

PICTURES = """
import json, sys
import gonio.figures.drawing_process as beside
with beside.drawing_beside():
    process = beside.DRAWING.get()
    from gonio.figures.maps import SCALE_SIZE, draw_scale
    from gonio.figures.style import picture
    made = [picture(f"Scale to {high}", draw_scale, (0.1, high), size=SCALE_SIZE) for high in (10.0, 1e3)]
    nameless = picture("A line", lambda ax: ax.plot([0, 1]))
    if process is not None:
        assert all(p.remote is not None for p in made) and nameless.remote is None
        first = made[0].svg()
        process.process.kill()  # what it has not drawn is drawn here
        process.answers.join()
        made.append(picture("After its end", draw_scale, (0.1, 10.0), size=SCALE_SIZE))
    print(json.dumps([p.svg() for p in made]))
"""


def test_a_second_process_draws_the_same_pictures_and_its_end_loses_none():
    done = subprocess.run([sys.executable, "-c", PICTURES], capture_output=True, text=True, check=True)
    drawn = json.loads(done.stdout)
    labels = ("Scale to 10.0", "Scale to 1000.0", "After its end")
    for label, high, text in zip(labels, (10.0, 1e3, 10.0), drawn, strict=True):
        assert text == picture(label, draw_scale, (0.1, high), size=SCALE_SIZE).svg()


@pytest.mark.parametrize("size", [(WIDTH, HEIGHT), MAP_SIZE])
def test_labels_measured_once_fit_as_in_the_constrained_layout(size):
    def plain(engine):
        with styled():
            fig = Figure(figsize=size, layout=engine(w_pad=0.03, h_pad=0.03))
            ax = fig.add_subplot()
            ax.plot([0, 1], label="a line")
            ax.set(xlabel="x", ylabel="y", xticks=[0, 1], yticks=[0, 1])
            ax.legend(loc="lower left", bbox_to_anchor=(0, 1))
            fig.colorbar(ax.imshow(np.eye(2), aspect="auto"), ax=ax, label="colour", ticks=[0, 1])
            fig.draw_without_rendering()
        return [a.get_position().extents for a in fig.axes]

    np.testing.assert_allclose(plain(PanelLayout), plain(ConstrainedLayoutEngine), atol=0.004)
