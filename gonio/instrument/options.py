"""The options of a measurement: the public keywords of `gonio.measure`, and the same checked."""

import dataclasses
import os
from collections.abc import Callable
from typing import TypedDict

import numpy as np
from numpy.typing import DTypeLike

from gonio.models.errors import GonioError

OLD_NAMES = {"say": "log"}


class MeasureOptions(TypedDict, total=False):
    """Keywords of `gonio.measure`; `help(gonio.measure)` describes each."""

    output: str | os.PathLike[str] | None
    seed: int
    progress: bool
    force: bool
    dtype: DTypeLike | None
    log: Callable[[str], None] | None
    command: str | None


@dataclasses.dataclass(frozen=True)
class MeasureSettings:
    """The options of a measurement, complete and checked; see `gonio.measure`."""

    output: str | os.PathLike[str] | None = None
    seed: int = 0
    progress: bool = False
    force: bool = False
    dtype: DTypeLike | None = None
    log: Callable[[str], None] | None = None
    command: str | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.seed, int | np.integer) and 0 <= self.seed < 1 << 64):
            raise GonioError(f"the seed is {self.seed!r}; give a whole number from 0 to 2^64 − 1")
        if self.dtype is not None and np.dtype(self.dtype) not in (np.float32, np.float64):
            raise GonioError(f"values of type {np.dtype(self.dtype)} cannot be stored; give float32 or float64")
