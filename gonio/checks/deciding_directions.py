"""Where to read beside a table: at mirror directions that it left out, and on lobes that it does not resolve."""

from typing import NamedTuple

import numpy as np

from gonio.checks.albedos import Albedos
from gonio.checks.hidden_lobes import SAME_LIGHT
from gonio.checks.table.albedos.two_sided import bend_of
from gonio.checks.table.albedos.untested_lobes import VISIBLE, values_at
from gonio.data.table import Table
from gonio.instrument.instrument import Instrument
from gonio.models.brdf import AbstractBRDF
from gonio.planning.candidates import readable

LEVELS = (0.5, 1.3, 2.2, 3.2)
"""E-folds below its peak at which a lobe of the model is read, which tests its shape."""
NEAR_LEVEL = 0.45
"""How far from that level a reading may be."""
BETWEEN = (1 / 2, 1 / 8, 1 / 32)
"""Of the step, from the mirror direction: where a lobe is read of whose width the model may know nothing."""
STEP = np.radians(1.0)
"""Of lists, which have none."""
WIDE = 1.5
"""Steps of the table to the first level: lobes so wide need no other readings."""
WELL_KNOWN = 1e-3
"""Bound of an albedo that needs no further reading."""
AROUND = np.radians(0.5) * np.arange(1, 41)
"""How far a reading may be from the mirror direction where the detector's shadow is on it."""
FAN = np.concatenate([[0.0], *(sign * np.geomspace(1e-4, 1.4, 160) for sign in (-1, 1))])
"""Polar angles from the mirror direction, radians, among which the levels of lobes are looked for."""


class Ways(NamedTuple):
    """A table's readings with light and detector on these sides, 1 in front and −1 behind."""

    table: Table
    light: int
    detector: int

    @property
    def step(self) -> float:
        """Of the detector's polar angles, radians."""
        layout = self.table.layout
        axis = layout.axes.get("theta_o", np.zeros(0)) if layout.gridded else np.zeros(0)
        return float(np.median(np.diff(axis))) if axis.size > 1 else STEP

    def lobe_angle(self, theta_i: float) -> float:
        """Polar angle to which a lobe goes."""
        bend = bend_of(*self)
        return theta_i if bend == 1.0 else float(np.arcsin(min(bend * np.sin(theta_i), 1.0)))

    def readable(self, angles: np.ndarray, instrument: Instrument) -> np.ndarray:
        """Those of directions (4, n), from the normals of these sides, that the instrument reads, from the front's."""
        angles = angles.copy()
        for row, side in ((0, self.light), (2, self.detector)):
            angles[row] = angles[row] if side > 0 else np.pi - angles[row]
        return readable(angles, instrument, not self.table.layout.has_azimuth_of_light)


def deciding_directions(
    ways: Ways, brdf: AbstractBRDF, albedos: Albedos, open_theta: np.ndarray, instrument: Instrument
) -> np.ndarray:
    """Readable directions (4, n) at or beside where the lobes of some incidences go, where these are seen too little.

    Args:
        ways: the table and the sides that it is looked at from.
        brdf: the fitted model, as seen so.
        albedos: those of these sides, with angles of incidence from the light's normal.
        open_theta: incidences to look at, from the front's normal.
        instrument: its ranges and shadow.
    """
    from_front = albedos.theta_i if ways.light > 0 else np.pi - albedos.theta_i
    which = np.flatnonzero(np.any(np.abs(from_front[:, None] - open_theta) < SAME_LIGHT, axis=1) & ~albedos.partial)
    # What is integrated well enough on this side leaves nothing open.
    enough = np.all(albedos.above <= WELL_KNOWN, axis=1)
    chosen = []
    for k in which[~enough[which]]:
        incidence = float(albedos.theta_i[k]), float(albedos.phi_i[k])
        wanted = [np.zeros(1)] if albedos.unseen[k] else [np.array([b * ways.step]) for b in BETWEEN]
        wanted += _at_levels(ways, brdf, incidence)
        for offsets in wanted:
            # The nearest to it that the detector's shadow and the axes leave free.
            near = np.concatenate([offsets, offsets[0] + AROUND, offsets[0] - AROUND]) if offsets.size == 1 else offsets
            near = near if offsets.size > 1 else near[np.argsort(np.abs(near - offsets[0]), kind="stable")]
            chosen.append(ways.readable(_in_plane(incidence, ways.lobe_angle(incidence[0]) + near), instrument)[:, :1])
    return np.unique(np.concatenate(chosen, axis=1), axis=1) if chosen else np.zeros((4, 0))


def _in_plane(incidence: tuple[float, float], polar: np.ndarray) -> np.ndarray:
    """Directions (4, n) in the plane of incidence, those above the horizon, at polar angles away from the light."""
    polar = polar[np.abs(polar) < np.pi / 2]
    light = np.full_like(polar, incidence[0]), np.full_like(polar, incidence[1])
    return np.stack([*light, np.abs(polar), (incidence[1] + np.where(polar < 0, 0.0, np.pi)) % (2 * np.pi)])


def _at_levels(ways: Ways, brdf: AbstractBRDF, incidence: tuple[float, float]) -> list[np.ndarray]:
    """Of each narrow lobe and each level the offsets from the mirror direction that are about there, nearest first."""
    lobe = ways.lobe_angle(incidence[0])
    fan = FAN[np.abs(lobe + FAN) < np.pi / 2 - 1e-3]
    angles = _in_plane(incidence, lobe + fan).T
    values = [values_at(term, angles).mean(axis=1) for term in brdf.terms()]
    wanted = []
    for value in values:
        below = np.log(max(value.max(), 1e-300)) - np.log(np.maximum(value, 1e-300))
        if np.min(np.abs(fan[below > 1.0]), initial=np.inf) > WIDE * ways.step:
            continue
        visible = value > VISIBLE * sum(values)
        for level in LEVELS:
            off = np.where(visible, np.abs(below - level), np.inf)
            order = np.argsort(off, kind="stable")
            order = order[off[order] < NEAR_LEVEL]
            if order.size > 1:
                wanted.append(fan[order])
    return wanted
