"""The layout of a panel: Matplotlib's constrained layout, which measures the labels once instead of at every step."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.transforms import Bbox


class PanelLayout(ConstrainedLayoutEngine):
    """The constrained layout of axes whose ticks do not change with their size.

    Labels, ticks and legends of an axes then reach as far beyond it wherever it stands. To measure them takes most of
    the time of a layout, and the constrained layout does so two or three times for each axes.
    """

    def execute(self, fig: Figure) -> dict[Any, Any] | None:
        for axes in fig.axes:
            axes.get_tightbbox = _MeasuredOnce(axes)  # type: ignore[method-assign]
        try:
            return super().execute(fig)
        finally:
            for axes in fig.axes:
                del axes.get_tightbbox


class _MeasuredOnce:
    """The tight bounding box of an axes with all that belongs to it, in pixels; None where nothing is visible."""

    def __init__(self, axes: Axes) -> None:
        self.axes, self.measure = axes, axes.get_tightbbox
        self.beyond: list[float] | None = None
        """Pixels from the axes' own corners (left, bottom, right, top) to those of the box."""

    def __call__(self, *args: Any, **options: Any) -> Bbox | None:
        if self.beyond is None:
            box = self.measure(*args, **options)
            if box is not None:
                self.beyond = [b - a for a, b in zip(self.axes.bbox.extents, box.extents, strict=True)]
            return box
        self.axes.apply_aspect()
        return Bbox.from_extents(*(a + d for a, d in zip(self.axes.bbox.extents, self.beyond, strict=True)))
