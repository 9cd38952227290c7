"""Pages without their pictures, for tests of what pages say: to draw them takes most of the time of a page."""

import contextlib
from collections.abc import Iterator

import pytest

from gonio.figures.style import Picture


@contextlib.contextmanager
def undrawn() -> Iterator[None]:
    """Meanwhile every picture is an empty one. That pictures are drawn is what tests/reports/test_build.py shows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Picture, "svg", lambda picture: '<svg viewBox="0 0 1 1" class="panel"></svg>')
        yield
