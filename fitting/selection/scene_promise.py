"""What is promised of a fitted model in a scene: a bound on the error of its radiance against the surface itself.

Measured against the material that the table's provenance names. Else from the readings: the error where they are, and
what may lie between them, which leaving out nodes tells of the residuals as it does of a table.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.interpolation.multilinear import as_material
from gonio.data.reduction.table_resolution import bound_of_sides, known_truth, measured_error, of_surface
from gonio.data.reduction.thin_grid import SceneValues
from gonio.data.scene import Scene
from gonio.data.table import Table, index_of
from gonio.data.tabulate import grid_values
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks

PAIRS = 30_000


class ScenePromise(NamedTuple):
    """A bound on the error of a model's radiance in a scene over its rms, beside the tolerance; None: no bound."""

    bound: float | None
    tolerance: float
    reason: str

    @property
    def keeps(self) -> bool:
        """Whether the model is within the tolerance of the surface."""
        return self.bound is not None and self.bound <= self.tolerance

    def sentence(self) -> str:
        """What is promised, and why no more."""
        kept = f"the tolerance of {percent(self.tolerance, 3)}"
        if self.bound is None:
            return f"{kept} is not promised: the readings do not resolve the scene; {self.reason}"
        if self.keeps:
            return f"at most {percent(self.bound)} off the surface itself, within {kept}: {self.reason}"
        return f"{kept} is not promised: the model may be {percent(self.bound)} off the surface; {self.reason}"

    def to_dict(self) -> dict[str, Any]:
        """For the files of a fit."""
        return {**self._asdict(), "keeps": self.keeps}


def promise(table: Table, brdf: AbstractBRDF, scene: Scene, determined: bool) -> ScenePromise:
    """Judges a model that was fitted to a table.

    Args:
        table: the readings.
        brdf: the fitted model.
        scene: what its radiance is wanted for.
        determined: whether the readings determine all of its numbers; where not, it may be anything between them, and
            the bound is that of the table itself.
    """
    pairs = scene.pairs(PAIRS, index_of(table))
    model = np.broadcast_to(evaluate_in_blocks(brdf, pairs.wi, pairs.wo), (pairs.view.size, len(table.channels)))
    truth = known_truth(table, pairs)
    if truth is not None:
        name = table.provenance["material"].get("name") or "the material"
        reason = f"measured against {name}, which the provenance names"
        return ScenePromise(measured_error(pairs, model, truth), scene.tolerance, reason)
    try:
        compared = _residuals(table, brdf) if determined and table.interpolant is None else table
        f = evaluate_in_blocks(as_material(compared), pairs.wi, pairs.wo)
    except GonioError as error:
        return ScenePromise(None, scene.tolerance, str(error))
    off, of = (f - model, "") if compared is table else (f, "of what the model leaves, ")
    bounded = _bound(compared, SceneValues(pairs, f), off, model, scene.tolerance)
    return bounded._replace(reason=of + bounded.reason)


def _bound(compared: Table, values: SceneValues, off: np.ndarray, model: np.ndarray, tolerance: float) -> ScenePromise:
    pairs = values.pairs
    rms = pairs.rms(model)
    if not (np.isfinite(off).all() and rms > 0):
        return ScenePromise(None, tolerance, "the readings lie in one plane")
    between, reason = bound_of_sides(compared, values, rms)
    bound = of_surface(pairs.rms(off) / rms + between)
    return ScenePromise(bound if math.isfinite(bound) else None, tolerance, reason)


def _residuals(table: Table, brdf: AbstractBRDF) -> Table:
    """The table of model less reading: what is resolved of it may be finer than of the readings themselves."""
    f = np.asarray(table.f[...], float)
    model = grid_values(brdf, table.layout).reshape(*table.layout.shape, -1)
    off = np.where(np.asarray(table.flag[...]) == Flag.VALID, np.broadcast_to(model, f.shape) - f, np.nan)
    return dataclasses.replace(table, f=off)
