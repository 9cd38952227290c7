"""The free numbers of a fitted material with their covariance, and what it makes of quantities of the material."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gonio.data.material import Material
from gonio.fitting.moved_numbers import with_number
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError

LEAST_STEP = 1e-3
"""Relative: slopes are taken over one standard uncertainty of a number on either side, and no less than this."""
NO_SLOPE = 1e-9
"""Change of a quantity, over the whole size of a number, below which it does not depend on it."""
Values = Callable[[AbstractBRDF], np.ndarray]


@dataclasses.dataclass(frozen=True)
class FitNumbers:
    """P free numbers of a fitted material, as its file keeps them, and their covariance (P, P).

    A number on a bound has no variance; one that the readings leave open has none that is known: NaN.
    """

    material: Material
    numbers: list[dict[str, Any]]
    covariance: np.ndarray

    @classmethod
    def of(cls, material: Material) -> "FitNumbers | None":
        """Those of a fitted material; None of another one.

        Raises GonioError for a fit that keeps no covariance of its numbers.
        """
        stored = material.meta.get("fit")
        if not isinstance(stored, dict) or material.expression is None:
            return None
        try:
            free = [_checked(p) for p in stored.get("parameters", []) if p["status"] != "fixed"]
            return cls(material, free, _covariance(stored, len(free), material.name)) if free else None
        except (KeyError, TypeError, ValueError, IndexError):
            raise GonioError(f"{material.name} does not keep its numbers as 'gonio fit' writes them") from None

    @property
    def undetermined(self) -> list[str]:
        """Labels of the numbers whose variance is not known."""
        return [_label(p) for p, lost in zip(self.numbers, self._lost, strict=True) if lost]

    def slopes(self, values: Values) -> np.ndarray:
        """Slopes (J, C, P) of values (J, C) of the model by its numbers, of each channel by its own.

        By central differences within the domains; the numbers of one name are moved in all channels at once.
        """
        names, made = self.material.channels.names, []
        by_name: dict[str, list[int]] = {}
        for k, p in enumerate(self.numbers):
            by_name.setdefault(p["name"], []).append(k)
        for name, which in by_name.items():
            low, high = ({_channel(self.numbers[k]): self._moved(k, s) for k in which} for s in (-1, 1))
            ends = [np.asarray(values(self._model(name, end))) for end in (high, low)]
            difference = ends[0] - ends[1]
            for k in which:
                channel = _channel(self.numbers[k])
                width = high[channel] - low[channel]
                slope = difference / width if width > 0 else np.zeros_like(difference)
                if channel is not None:
                    slope = np.where(np.array(names) == channel, slope, 0.0)
                made.append((k, slope))
        return np.stack([slope for _, slope in sorted(made, key=lambda pair: pair[0])], axis=-1)

    def spread(self, slopes: np.ndarray) -> np.ndarray:
        """Standard uncertainty (...) of quantities with slopes (..., P); infinite where a number is not known."""
        known = np.nan_to_num(self.covariance)
        u = np.sqrt(np.maximum(np.einsum("...p,pq,...q->...", slopes, known, slopes), 0.0))
        sizes = np.array([max(abs(p["value"]), 1e-3) for p in self.numbers])
        depends = (np.abs(slopes) * sizes > NO_SLOPE) & self._lost
        return np.where(depends.any(axis=-1), np.inf, u)

    @functools.cached_property
    def _lost(self) -> np.ndarray:
        open_ended = ~np.isfinite(np.diagonal(self.covariance))
        return open_ended & np.array([not p["status"].startswith("at ") for p in self.numbers])

    def _moved(self, k: int, sign: int) -> float:
        p = self.numbers[k]
        u = p.get("standard_uncertainty")
        u = float(u) if isinstance(u, int | float) and math.isfinite(u) else 0.0
        size = LEAST_STEP * max(abs(p["value"]), LEAST_STEP)
        return float(min(max(p["value"] + sign * max(u, size), p["low"]), p["high"]))

    def _model(self, name: str, values: Mapping[str | None, float]) -> AbstractBRDF:
        assert self.material.expression is not None
        return with_number(self.material.expression, self.material.channels.names, name, values)


def _checked(number: Mapping[str, Any]) -> dict[str, Any]:
    """A number as its file keeps it, with the entries that are needed here."""
    sizes = {key: float(number[key]) for key in ("value", "low", "high")}
    return {**number, **sizes, "name": str(number["name"]), "status": str(number["status"])}


def _label(number: Mapping[str, Any]) -> str:
    channel = _channel(number)
    return number["name"] if channel is None else f"{number['name']}[{channel}]"


def _channel(number: Mapping[str, Any]) -> str | None:
    """The channel of a number; files leave it out of one that all channels share."""
    return number.get("channel") or None


def _covariance(stored: Mapping[str, Any], size: int, name: str) -> np.ndarray:
    """The covariance of all numbers; where a file keeps it by channel, that of two channels' numbers is 0."""
    if "covariance" in stored:
        matrix = np.asarray(stored["covariance"], float)
    else:
        matrix = np.zeros((size, size))
        for part in stored.get("covariance_by_channel", []):
            index = np.asarray(part["numbers"], int)
            matrix[np.ix_(index, index)] = np.asarray(part["covariance"], float)
    if matrix.shape != (size, size) or not ("covariance" in stored or "covariance_by_channel" in stored):
        raise GonioError(f"{name} keeps no covariance of its numbers")
    return matrix
