"""Readings that figures show: near an incidence, in its plane, and beside a fitted model."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.fitting.residuals.pair_angles import PairAngles, pair_angles
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction

OFF_PLANE = 2.5
"""Degrees within which a scattered reading counts as in the plane."""
NEAR_INCIDENCE = 1.0
"""Degrees within which a reading on half/difference angles counts as at an incidence."""
MOST_POINTS = 400
RESIDUALS = 1 << 16


class Readings(NamedTuple):
    """Readings near one incidence: angles, degrees (n,), and f, 1/sr, (n, channels), NaN where it is not valid."""

    theta_o: np.ndarray
    delta_phi: np.ndarray
    f: np.ndarray
    u: np.ndarray
    """Standard uncertainties, 1/sr, of the shape of f; NaN where they are not known."""

    def of_channel(self, channel: int, most: int) -> "Readings":
        """The valid readings of one channel, f of shape (n,); at most so many, evenly chosen."""
        index = np.flatnonzero(np.isfinite(self.f[:, channel]))
        index = evenly_chosen(index, most)
        return Readings(self.theta_o[index], self.delta_phi[index], self.f[index, channel], self.u[index, channel])

    def by_side(self) -> "list[tuple[bool, Readings]]":
        """(whether on the other side than the light, those there, theta_o from the normal of their side), if any."""
        behind = self.theta_o > 90.0
        sides = [(False, self._where(~behind))]
        if behind.any():
            there = self._where(behind)
            sides.append((True, there._replace(theta_o=180.0 - there.theta_o)))
        return sides

    def _where(self, chosen: np.ndarray) -> "Readings":
        return Readings(self.theta_o[chosen], self.delta_phi[chosen], self.f[chosen], self.u[chosen])


class PlaneReadings(NamedTuple):
    """Readings in the plane of incidence: signed outgoing angles, degrees (n,), f and u, 1/sr, (n, channels)."""

    theta_o: np.ndarray
    f: np.ndarray
    u: np.ndarray


class Residuals(NamedTuple):
    """Residuals of all channels: relative to |reading|, over u(f) where that is known, and angles of the former."""

    relative: np.ndarray
    standardised: np.ndarray
    angles: PairAngles


def evenly_chosen(index: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the entries, at even steps from the first to the last."""
    return index[np.linspace(0, index.size - 1, min(index.size, most)).astype(int)] if index.size else index


def table_incidences(table: Table, wanted: Sequence[float], light: int = 1) -> list[float]:
    """The measured angles of incidence, degrees, nearest to those wanted; the wanted ones where all are measured.

    `light`: its side, 1 in front or −1 behind, from whose normal they are counted.
    """
    if "theta_i" not in table.layout.axes:
        return list(wanted)
    measured = np.unique(_from_normal(np.degrees(table.layout.axes["theta_i"]), light))
    measured = measured[measured < 89.0]
    if not measured.size or measured.size > 500:
        return list(wanted)
    return sorted({round(float(measured[np.argmin(np.abs(measured - w))]), 9) for w in wanted})


def readings_near(table: Table, incidences: Sequence[float], light: int = 1) -> list[Readings]:
    """For each incidence, degrees, the readings near it that are valid in any channel.

    `light`: its side, 1 in front or −1 behind; all polar angles are counted from the normal there.
    """
    pieces: list[list[Readings]] = [[] for _ in incidences]
    tolerance = 1e-3 if "theta_i" in table.layout.axes else NEAR_INCIDENCE
    for start, stop in table.blocks():
        theta_i, phi_i, theta_o, phi_o = (np.degrees(a) for a in table.layout.angles(start, stop))
        theta_i, theta_o = (_from_normal(theta, light) for theta in (theta_i, theta_o))
        block = table.read_values(start, stop)
        valid = (block["flag"] == Flag.VALID).any(axis=1)
        for near, wanted in zip(pieces, incidences, strict=True):
            index = np.flatnonzero(valid & (np.abs(theta_i - wanted) <= tolerance))
            f = np.where(block["flag"][index] == Flag.VALID, block["f"][index], np.nan)
            near.append(Readings(theta_o[index], (phi_o[index] - phi_i[index]) % 360.0, f, block["u_f"][index]))
    return [Readings(*map(np.concatenate, zip(*near, strict=True))) for near in pieces]


def _from_normal(theta: np.ndarray, light: int) -> np.ndarray:
    return theta if light > 0 else 180.0 - theta


def in_plane_readings(near: Readings) -> PlaneReadings:
    """The readings in the plane of incidence, or near it; at most `MOST_POINTS`."""
    phi = np.radians(near.delta_phi)
    off = np.degrees(np.arcsin(np.clip(np.sin(np.radians(near.theta_o)) * np.abs(np.sin(phi)), 0, 1)))
    index = np.flatnonzero(off <= 1e-3)
    if index.size < 8:
        index = np.flatnonzero(off <= OFF_PLANE)
    index = evenly_chosen(index, MOST_POINTS)
    signed = np.where(np.cos(phi[index]) <= 0, near.theta_o[index], -near.theta_o[index])
    order = np.argsort(signed, kind="stable")
    return PlaneReadings(signed[order], near.f[index][order], near.u[index][order])


def fit_residuals(table: Table, brdf: AbstractBRDF, theta_max: float | None) -> Residuals:
    """Residuals of a model at readings up to `theta_max`, radians; at most `RESIDUALS` cells."""
    block = table.samples(limit=RESIDUALS, theta_max=theta_max)
    n = block.f.shape[0]
    if not n:
        return Residuals(np.empty(0), np.empty(0), PairAngles(*[np.empty(0)] * len(PairAngles._fields)))
    index = np.resize(np.arange(n), RESIDUALS)  # repeated to one size, so that one compiled program serves
    wi, wo = (Direction(*(np.asarray(c)[index] for c in w)) for w in (block.wi, block.wo))
    model = np.asarray(evaluate(brdf, wi, wo)).reshape(RESIDUALS, -1)[:n]
    valid = (block.flag == Flag.VALID) & np.isfinite(block.f) & (block.f != 0)
    difference = np.broadcast_to(model, block.f.shape) - np.where(valid, block.f, 0.0)
    known = valid & np.isfinite(block.u_f) & (np.nan_to_num(block.u_f) > 0)
    return Residuals(
        (difference / np.where(valid, np.abs(block.f), 1.0))[valid],
        (difference / np.where(known, block.u_f, 1.0))[known],
        PairAngles(*(np.broadcast_to(a[:, None], block.f.shape)[valid] for a in pair_angles(block.wi, block.wo))),
    )
