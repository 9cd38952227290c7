"""Directional albedos of tables of both sides of a sample: what comes back, and what goes through, by the light."""

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gonio.checks.albedos import Albedos
from gonio.checks.hidden_lobes import ALPHAS
from gonio.data.table import Table

if TYPE_CHECKING:
    from gonio.models.brdf import AbstractBRDF

SAME_LIGHT = np.radians(0.05)
"""Incidences nearer than that are one."""
ROWS = ("theta_i", "phi_i", "value", "above", "below", "noise", "unseen", "step_needed", "partial", "hidden")
REFLECTED, TRANSMITTED = "reflectance", "transmittance"


class Part(NamedTuple):
    """Readings of one pair of sides, mirrored into the front, as `Table.parts` gives them."""

    table: Table
    light: int = 1
    """Side of the light, 1 in front and −1 behind."""
    detector: int = 1
    bend: float = 1.0
    """Where a lobe hides: at sin θo = bend · sin θi."""

    def folded(self, brdf: "AbstractBRDF") -> "AbstractBRDF":
        """A model of the whole table as these readings see it."""
        from gonio.models.folded import seen_from

        return seen_from(brdf, self.light, self.detector)


def two_sided_albedos(table: Table, of_part: Callable[[Part], Albedos | str]) -> Albedos | str:
    """R + T at every incidence of light in front of the sample and behind it; of what was read, where only one was.

    Args:
        table: a table with readings behind the sample, or light from there.
        of_part: albedos of a part, or why there are none.

    Returns:
        The albedos with their `shares`, or why there are none of any part.
    """
    return summed(albedos_of_parts(table, of_part))


def summed(by_side: dict[tuple[int, int], Albedos | str]) -> Albedos | str:
    """R + T at every incidence, of what `albedos_of_parts` gives."""
    shares: dict[int, dict[str, Albedos]] = {1: {}, -1: {}}
    reasons = []
    for (light, detector), albedos in by_side.items():
        if isinstance(albedos, str):
            reasons.append(albedos)
        else:
            shares[light][REFLECTED if light == detector else TRANSMITTED] = albedos
    lit = [_of_light(of_side, light) for light, of_side in shares.items() if of_side]
    return _concatenated(lit) if lit else reasons[0]


def albedos_of_parts(table: Table, of_part: Callable[[Part], Albedos | str]) -> dict[tuple[int, int], Albedos | str]:
    """Those of each part, or why there are none, by the sides of light and detector; angles from the light's normal.

    `of_part` as of `two_sided_albedos`.
    """
    return {
        (light, detector): of_part(Part(part, light, detector, bend_of(table, light, detector)))
        if part.valid_cells().size
        else "it holds no reading"
        for (light, detector), part in table.parts().items()
    }


def bend_of(table: Table, light: int, detector: int) -> float:
    """sin θo / sin θi of light that is refracted between these sides, by the table's media; 1 of what is reflected."""
    front, behind = (float(np.mean(n)) for n in table.media)
    return 1.0 if light == detector else front / behind if light > 0 else behind / front


def _of_light(shares: dict[str, Albedos], light: int) -> Albedos:
    """The sum over both hemispheres for light from one side, in the order of its polar angles."""
    every = np.concatenate([np.stack([a.theta_i, a.phi_i], -1) for a in shares.values()])
    _, first, numbers = np.unique(np.round(every / SAME_LIGHT), axis=0, return_index=True, return_inverse=True)
    rows = np.split(numbers.reshape(-1), np.cumsum([len(a.value) for a in shares.values()])[:-1])
    shape = first.size, next(iter(shares.values())).value.shape[1]
    total: dict[str, Any] = {name: np.zeros(shape) for name in ("value", "above", "below", "noise")}
    total |= {name: np.zeros(first.size, bool) for name in ("unseen", "partial")}
    total |= {"step_needed": np.full(first.size, np.nan), "shares": {}}
    total["hidden"] = np.zeros((first.size, ALPHAS.size, shape[1]))
    for (name, albedos), k in zip(shares.items(), rows, strict=True):
        for field in ("value", "above", "below", "hidden"):
            total[field][k] += getattr(albedos, field)
        for field in ("unseen", "partial"):
            total[field][k] |= getattr(albedos, field)
        total["noise"][k] = np.hypot(total["noise"][k], albedos.noise)
        total["step_needed"][k] = np.fmin(total["step_needed"][k], albedos.step_needed)
        total["shares"][name] = np.full(shape, np.nan)
        total["shares"][name][k] = albedos.value
    theta, phi = every[first].T
    method = " ".join(dict.fromkeys(a.method for a in shares.values()))
    return _rows(Albedos(theta if light > 0 else np.pi - theta, phi, method=method, **total))


def _rows(albedos: Albedos) -> Albedos:
    """The same in the order of the light's polar angle and azimuth."""
    order = np.lexsort((albedos.phi_i, albedos.theta_i))
    rows: dict[str, Any] = {name: getattr(albedos, name)[order] for name in ROWS}
    return dataclasses.replace(albedos, **rows, shares={name: v[order] for name, v in albedos.shares.items()})


def _concatenated(lit: list[Albedos]) -> Albedos:
    """Those of light from the front, then from behind."""
    rows: dict[str, Any] = {name: np.concatenate([getattr(a, name) for a in lit]) for name in ROWS}
    names = dict.fromkeys(name for a in lit for name in a.shares)
    unread = [np.full(a.value.shape, np.nan) for a in lit]
    shares = {n: np.concatenate([a.shares.get(n, u) for a, u in zip(lit, unread, strict=True)]) for n in names}
    return dataclasses.replace(lit[0], **rows, shares=shares)
