"""A progress bar with rate and time left: on standard error, or in a notebook's cell."""

import importlib.util
import time
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

PATIENCE = 0.5
"""Seconds of work before a bar is shown."""


class CellCount:
    """A context that counts measured cells; with `bar` it shows a progress bar of a long job."""

    def __init__(self, cells: int, already: int, bar: bool) -> None:
        self.cells, self.already, self.fresh = cells, already, 0
        self.started = time.perf_counter()
        console = Console(stderr=True)
        notebook = console.is_jupyter and importlib.util.find_spec("ipywidgets") is not None
        self._shown = bar and (console.is_terminal or notebook)
        self._bar = Progress(
            TextColumn("measuring"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[rate]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        self._task = self._bar.add_task("measuring", total=cells, completed=already, rate="")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar.live.is_started:
            self._bar.stop()

    @property
    def seconds(self) -> float:
        """Seconds since the beginning."""
        return time.perf_counter() - self.started

    def add(self, cells: int) -> None:
        """Counts cells that have just been measured."""
        self.fresh += cells
        completed = self.already + self.fresh
        if self._shown and not self._bar.live.is_started and completed < self.cells and self.seconds > PATIENCE:
            self._bar.start()
        self._bar.update(self._task, completed=completed, rate=f"{self._rate()} cells/s")

    def summary(self, channels: int) -> str:
        """Cells, seconds and rate, as text."""
        times = f" × {channels} channels" if channels > 1 else ""
        return f"{self.fresh} cells{times} in {self.seconds:.2f} s, {self._rate()} cells/s"

    def _rate(self) -> str:
        rate = self.fresh / max(self.seconds, 1e-9)
        for unit, size in (("M", 1e6), ("k", 1e3)):
            if rate >= size:
                return f"{rate / size:.3g} {unit}"
        return f"{rate:.3g}"
