"""The options of a fit: as keywords, and complete and checked."""

import dataclasses
import math
import os
from collections.abc import Callable, Mapping
from typing import Any, TypedDict

from gonio.data.scene import Scene, load_scene
from gonio.fitting.problem.readings import LOSSES, WEIGHTS
from gonio.fitting.solver.robust_weights import KINDS as ROBUST_KINDS
from gonio.fitting.uncertainty.bootstrap import KINDS as BOOTSTRAP_KINDS
from gonio.models.deprecation import renamed, renamed_options
from gonio.models.errors import GonioError, nearest

MOST_REFITS = 100_000
OLD_NAMES = {"say": "log"}
OLD_KINDS = {"residuals": "wild", "pairs": "block_pairs"}
APERTURES = ("average", "ignore")


class FitOptions(TypedDict, total=False):
    """Keywords of `gonio.fit`; `help(gonio.fit)` describes each."""

    loss: str | None
    theta_max: float | None
    weight: str | None
    relative_noise: float | None
    robust: str | bool | None
    bootstrap: int
    bootstrap_kind: str
    per_channel: bool
    samples: int | None
    starts: int
    aperture: str
    scene: str | os.PathLike[str] | Scene | None
    seed: int
    log: Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class FitSettings:
    """The options of a fit, complete and checked; see `gonio.fit`."""

    loss: str | None = None
    theta_max: float | None = None
    weight: str | None = None
    relative_noise: float | None = None
    robust: str | None = None
    bootstrap: int = 0
    bootstrap_kind: str = "wild"
    per_channel: bool = False
    samples: int | None = None
    starts: int = 8
    aperture: str = "average"
    scene: Scene | None = None
    seed: int = 0
    log: Callable[[str], None] = lambda line: None

    def __post_init__(self) -> None:
        _require_known("loss", self.loss, LOSSES)
        _require_known("weight", self.weight, WEIGHTS)
        _require_known("robust weights", self.robust, tuple(ROBUST_KINDS))
        _require_known("aperture", self.aperture, APERTURES)
        _require_known("bootstrap", self.bootstrap_kind, BOOTSTRAP_KINDS)
        if self.theta_max is not None and not 0 < self.theta_max <= math.pi / 2 * (1 + 1e-12):
            raise GonioError(
                f"theta_max is {self.theta_max:g} radians; expected above 0 and up to π/2, such as math.radians(60)."
            )
        if self.relative_noise is not None and not 0 < self.relative_noise < 1:
            raise GonioError(
                f"A relative noise of {self.relative_noise:g} came; expected a share between 0 and 1, such as 0.05."
            )
        if self.relative_noise is not None and self.loss not in (None, "sigma"):
            raise GonioError(
                f"relative_noise weighs by the noise itself and excludes the loss '{self.loss}'; give one of them."
            )
        if self.bootstrap != 0 and not 2 <= self.bootstrap <= MOST_REFITS:
            raise GonioError(
                f"A bootstrap of {self.bootstrap} refits came; expected from 2 to {MOST_REFITS}, such as 200, or 0 for "
                "none."
            )
        if self.starts < 0 or (self.samples is not None and self.samples < 1):
            raise GonioError("starts takes 0 or more and samples 1 or more; give a larger number.")
        if self.scene is not None and self.weight is not None:
            raise GonioError(
                f"A scene weighs readings itself and excludes the weight '{self.weight}'; give one of them."
            )

    @classmethod
    def create(cls, options: Mapping[str, Any]) -> "FitSettings":
        """The settings of keywords, old names too; GonioError for what is out of range, TypeError for other names."""
        values = renamed_options(options, OLD_NAMES) if OLD_NAMES.keys() & options.keys() else dict(options)
        known = [f.name for f in dataclasses.fields(cls)]
        if unknown := [name for name in values if name not in known]:
            raise TypeError(f"fit has no option '{unknown[0]}'; {nearest(unknown[0], known)}")
        if (kind := values.get("bootstrap_kind")) in OLD_KINDS:
            renamed(f"bootstrap_kind='{kind}'", f"'{OLD_KINDS[kind]}'")
            values["bootstrap_kind"] = OLD_KINDS[kind]
        values["robust"] = "tukey" if values.get("robust") is True else values.get("robust") or None
        if values.get("scene") is not None:
            values["scene"] = load_scene(values["scene"])
        return cls(**values)


def _require_known(what: str, value: str | None, known: tuple[str, ...]) -> None:
    if value is not None and value not in known:
        raise GonioError(f"Unknown {what} '{value}'; {nearest(value, known)}")
