"""A progress bar for people: rate and time left, on standard error."""

import sys
import time

PATIENCE = 0.5
"""Seconds of work before a bar is worth its while."""


class Progress:
    """A context that counts cells; it shows a bar if asked to, or if a person may be watching a long job."""

    def __init__(self, cells: int, asked: bool):
        self.cells, self.counted, self.fresh = cells, 0, 0
        self.shown = asked
        self.started = time.perf_counter()
        self.bar = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.bar is not None:
            self.bar.stop()

    def begin(self, cells: int) -> None:
        """Says that so many cells were there before."""
        self.counted = cells

    def done(self, cells: int) -> None:
        """Counts cells that have just been measured."""
        self.counted += cells
        self.fresh += cells
        if not self.shown:
            return
        if self.bar is None and self.counted < self.cells and time.perf_counter() - self.started > PATIENCE:
            self._open()
        if self.bar is not None:
            rate = self.fresh / max(time.perf_counter() - self.started, 1e-9)
            self.bar.update(self.task, completed=self.counted, rate=f"{_count(rate)} cells/s")

    def sentence(self, channels: int) -> str:
        """Cells, seconds and rate, in words."""
        seconds = time.perf_counter() - self.started
        rate = self.fresh / max(seconds, 1e-9)
        many = f" × {channels} channels" if channels > 1 else ""
        return f"{self.fresh} cells{many} in {seconds:.2f} s, {_count(rate)} cells/s"

    def _open(self):
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        self.bar = Bar(
            TextColumn("measuring"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[rate]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=Console(file=sys.stderr),
            transient=True,
        )
        self.task = self.bar.add_task("measuring", total=self.cells, completed=self.counted, rate="")
        self.bar.start()


def _count(rate: float) -> str:
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if rate >= size:
            return f"{rate / size:.3g} {unit}"
    return f"{rate:.3g}"
