"""The options of a conversion."""

import dataclasses
import os
from collections.abc import Callable
from typing import Any, TypedDict

from gonio.models.errors import GonioError


class ConvertOptions(TypedDict, total=False):
    """Keywords of `gonio.convert`; `help(gonio.convert)` describes each."""

    force: bool
    ascii: bool | None
    channel_bytes: int | None
    part: str | None
    channel: str | None
    step: float | None
    basis: str | None
    model: str | None
    measured: bool
    tolerance: float | None
    log: Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class ConvertSettings:
    """The options of a conversion, complete; see `gonio.convert`."""

    force: bool = False
    ascii: bool | None = None
    channel_bytes: int | None = None
    part: str | None = None
    channel: str | None = None
    step: float | None = None
    basis: str | None = None
    model: str | None = None
    measured: bool = False
    tolerance: float | None = None
    log: Callable[[str], None] = lambda line: None

    @property
    def of_samples(self) -> dict[str, Any]:
        """Those of a file of samples."""
        names = ("ascii", "channel_bytes", "part", "channel", "step", "basis")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    def refuse_for_tables(self, path: str | os.PathLike[str]) -> None:
        """Refuses what only renderers have."""
        for name in ("model", "measured", "tolerance"):
            if getattr(self, name) not in (None, False):
                raise GonioError(f"{path} is no file for a renderer, which {name!r} is for; leave it out, or say --to")
