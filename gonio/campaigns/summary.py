"""What a campaign shows: fits by material and model, against noise; scatter of numbers beside their uncertainties."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np

from gonio.campaigns.store import DONE
from gonio.campaigns.tasks import CHECK, FIT

Row = dict[str, Any]
T = TypeVar("T", bound=Hashable)
FEW = 3
"""Fits of one setting, at least, whose scatter is told."""


@dataclasses.dataclass(frozen=True)
class ModelFits:
    """The fits of a model to the tables of a subject: verdicts, medians, quartiles of reduced χ² and relative rms."""

    subject: str
    model: str
    verdicts: dict[str, int]
    reduced_chi2: tuple[float, float, float]
    relative_rms: tuple[float, float, float]
    cpu_seconds: float


@dataclasses.dataclass(frozen=True)
class NoiseCurve:
    """Medians with 16th and 84th percentiles of the relative rms of a model's fits (3, n) by photons (n,)."""

    model: str
    photons: np.ndarray
    rms: np.ndarray


@dataclasses.dataclass(frozen=True)
class NumberScatter:
    """A free number in repeated fits of one setting: its scatter beside the median of its standard uncertainties."""

    subject: str
    setting: str
    photons: float | None
    model: str
    number: str
    count: int
    median: float
    scatter: float
    uncertainty: float

    @property
    def ratio(self) -> float:
        """Scatter over stated uncertainty: about 1 where that is honest, and the number is not on a bound."""
        return self.scatter / self.uncertainty if self.uncertainty > 0 else float("nan")


def of_kind(rows: Iterable[Row], kind: str) -> list[Row]:
    """The rows of a kind that belong to the last recipe."""
    return [r for r in rows if r["current"] and r["kind"] == kind]


def grouped(rows: Iterable[Row], key: Callable[[Row], T]) -> dict[T, list[Row]]:
    """Rows by a key, in the order of their first."""
    groups: dict[T, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def verdicts(rows: Iterable[Row]) -> dict[str, int]:
    """How many rows have each verdict; what was not done has its status."""
    return dict(Counter(r["verdict"] or r["status"] for r in rows))


def fits_by_model(rows: Sequence[Row]) -> list[ModelFits]:
    """The fits of each model to each subject."""
    result = []
    for (subject, model), fits in grouped(of_kind(rows, FIT), lambda r: (r["subject"], r["model"])).items():
        chi2, rms = (quartiles(fits, name) for name in ("reduced_chi2", "relative_rms"))
        seconds = [r["cpu_seconds"] for r in fits if r["status"] == DONE]
        result.append(ModelFits(subject, model, verdicts(fits), chi2, rms, float(np.median(seconds or [np.nan]))))
    return result


def quartiles(rows: Iterable[Row], name: str, shares: Sequence[float] = (25, 50, 75)) -> tuple[float, float, float]:
    """Percentiles of a column over what is known of it; NaN where nothing is."""
    values = [float(r[name]) for r in rows if r.get(name) is not None and np.isfinite(r[name])]
    low, middle, high = np.percentile(values, shares) if values else (np.nan,) * 3
    return float(low), float(middle), float(high)


def noise_curves(rows: Sequence[Row]) -> dict[str, list[NoiseCurve]]:
    """By subject, the relative rms of each model against photons, where there are two levels at least."""
    curves: dict[str, list[NoiseCurve]] = {}
    fits = [r for r in of_kind(rows, FIT) if r["photons"] and r["status"] == DONE]
    for (subject, model), group in grouped(fits, lambda r: (r["subject"], r["model"])).items():
        levels = sorted(grouped(group, lambda r: r["photons"]).items())
        if len(levels) > 1:
            rms = np.array([quartiles(level, "relative_rms", (16, 50, 84)) for _, level in levels]).T
            curves.setdefault(subject, []).append(NoiseCurve(model, np.array([photons for photons, _ in levels]), rms))
    return curves


def number_scatter(rows: Sequence[Row]) -> list[NumberScatter]:
    """Every free number of every setting with `FEW` fits at least, which differ by the seed alone."""
    fits = [r for r in of_kind(rows, FIT) if r["status"] == DONE and r["seed"] is not None]
    names = [n for n in dict.fromkeys(n for r in fits for n in r) if f"u({n})" in {*(k for r in fits for k in r)}]
    key = ("subject", "instrument", "scan", "photons", "model")
    result = []
    for (subject, instrument, scan, photons, model), group in grouped(fits, lambda r: tuple(r[k] for k in key)).items():
        for name in names if len(group) >= FEW else []:
            values = np.array([r.get(name, np.nan) for r in group], float)
            stated = np.array([r.get(f"u({name})", np.nan) for r in group], float)
            if np.isfinite(values).sum() >= FEW:
                setting = ", ".join(s for s in (instrument, scan) if s not in ("ideal", "default"))
                numbers = (float(np.nanmedian(values)), float(np.nanstd(values, ddof=1)))
                u = float(np.nanmedian(stated)) if np.isfinite(stated).any() else float("nan")
                result.append(NumberScatter(subject, setting, photons, model, name, len(group), *numbers, u))
    return result


def counts_of(rows: Sequence[Row], kind: str = CHECK) -> dict[str, dict[str, int]]:
    """Verdicts of a kind of task by subject; of checks of fits by subject and model."""
    named = grouped(of_kind(rows, kind), lambda r: f"{r['subject']}" + f": {r['model']}" * bool(r["model"]))
    return {name: verdicts(group) for name, group in named.items()}


def failing(rows: Iterable[Row]) -> list[Row]:
    """What a user must look after: refusals first, then failed fits, checks and reductions."""
    bad = [r for r in rows if r["current"] and not r["good"]]
    return sorted(bad, key=lambda r: r["status"] == DONE)
