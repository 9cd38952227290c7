"""Which sources of error a table knows, stored with it, stated beside it or shown by its repeats; and which not.

The errors that a simulated instrument actually had are in its table's provenance, and are never used: who measures does
not know them.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gonio.checks.direction_search import directions
from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.places import angles_of
from gonio.checks.table.pairs.scattered_pairs import merged, with_azimuths
from gonio.data.flags import Flag
from gonio.data.plausibility.copies import noise_of_copies
from gonio.data.plausibility.correlated_uncertainty import correlated_uncertainty, with_scatter
from gonio.data.polarisation import is_polarised
from gonio.data.stated import StatedUncertainty, stated_uncertainties
from gonio.data.table import Table
from gonio.instrument.description import instrument_of
from gonio.instrument.instrument import SYSTEMATIC_TERMS, Instrument
from gonio.metrology.effects import noise_parts

STORED, STATED, ESTIMATED = "stored", "stated", "estimated"
REPEATABILITY, GAIN = "repeatability", "gain"


class Source(NamedTuple):
    """The uncertainty of a systematic term, and where it comes from."""

    stated: StatedUncertainty
    origin: str


class Noise(NamedTuple):
    """One part of the readings' own noise: what it is, u (the table's shape), degrees of freedom, where from."""

    name: str
    meaning: str
    u_f: np.ndarray
    dof: float
    origin: str


MEANINGS = {
    "readings": "scatter of single readings",
    "counting": "counting of photons",
    "background": "counting of dark and ambient light",
    "readout": "reading-out of the detector",
    "source": "the source, from reading to reading",
}


@dataclasses.dataclass(frozen=True)
class Sources:
    """Systematic terms, parts of the noise, and by name why others are not known."""

    systematic: dict[str, Source]
    noise: list[Noise]
    missing: dict[str, str]

    @property
    def acting(self) -> dict[str, Source]:
        """The systematic terms that are not exactly known."""
        return {name: source for name, source in self.systematic.items() if source.stated.standard > 0}

    def of_copies(self, times: np.ndarray) -> "Sources":
        """The same with the noise of cells of which each stands so many `times` (n,)."""
        return dataclasses.replace(self, noise=[n._replace(u_f=noise_of_copies(n.u_f, times)) for n in self.noise])


def sources_of(table: Table, instrument: Instrument | None, stated: Mapping[str, object]) -> Sources:
    """The sources of error of a table.

    Where its readings scatter far less than the uncertainties that they store, the rest of these is taken as a gain.

    Args:
        table: with what it stores: `u_f`, and in its provenance the instrument, if it was simulated.
        instrument: the description of the real one; it goes before what is stored.
        stated: uncertainties of single terms as `stated_uncertainties` takes them; they go before both.

    Raises:
        GonioError: an unknown term, or one that cannot be read.
    """
    simulated, given = instrument_of(table.provenance), stated_uncertainties(stated)
    known: dict[str, Source] = {}
    if simulated is not None:
        known |= {name: Source(StatedUncertainty(name, 0.0), STORED) for name in SYSTEMATIC_TERMS}
        known |= {name: Source(u, STORED) for name, u in simulated.uncertainties.items()}
    described = {} if instrument is None else instrument.uncertainties
    known |= {name: Source(u, STATED) for name, u in (described | given).items()}
    if GAIN not in known and (shared := correlated_uncertainty(table).relative) > 0:
        known[GAIN] = Source(StatedUncertainty(GAIN, shared), ESTIMATED)
    missing = {name: "neither stored nor stated" for name in SYSTEMATIC_TERMS if name not in known}
    repeatability = known.pop(REPEATABILITY, None)
    noise, why = _noise(table, simulated or instrument, repeatability, simulated is not None)
    return Sources(known, noise, missing | why)


def _noise(
    table: Table, instrument: Instrument | None, stated: Source | None, simulated: bool
) -> tuple[list[Noise], dict[str, str]]:
    parts, missing = [], {}
    valid = np.asarray(table.flag[...]) == Flag.VALID
    u_f = None if table.u_f is None else np.asarray(table.u_f[...], float)
    if u_f is not None and (u_f[valid] > 0).any():
        alone = with_scatter(table, correlated_uncertainty(table))
        parts = [Noise(n, MEANINGS[n], u, math.inf, STORED) for n, u in noise_parts(alone, instrument).items()]
        unknown = int(np.count_nonzero(np.isnan(u_f[valid])))
        if unknown:
            missing["readings"] = f"{unknown:,} of {np.count_nonzero(valid):,} readings store no uncertainty"
    if stated is not None:
        size = np.abs(np.where(valid, np.nan_to_num(np.asarray(table.f[...], float)), 0.0))
        meaning, dof = "scatter of repeated readings", stated.stated.dof
        parts.append(Noise(REPEATABILITY, meaning, stated.stated.standard * size, dof, stated.origin))
    if not parts and (repeats := _repeats(table)) is not None:
        parts.append(repeats)
    if not parts and not simulated and not (u_f is not None and (u_f[valid] == 0).all()):
        missing[REPEATABILITY] = "no uncertainties are stored or stated, and too little was read several times"
    return parts, missing


def _repeats(table: Table) -> Noise | None:
    """The scatter of readings of the same directions; None of grids, and where there are too few."""
    if table.layout.gridded or not table.layout.size:
        return None
    cells = np.arange(table.layout.size)
    # s and p at the normal are of the azimuth that is written there: other azimuths are no repeats.
    polarised = is_polarised(table.channels.names)
    angles = with_azimuths(table) if polarised else angles_of(table.layout, cells)
    f, u = readings_of(table, cells)
    use = np.isfinite(f).all(axis=1)
    points = np.stack([*directions(*angles[use, :2].T), *directions(*angles[use, 2:].T)], -1)
    readings = merged(angles[use], f[use], u[use], points)
    if readings.law is None:
        return None
    size = np.abs(np.nan_to_num(f)).reshape(table.shape)
    dof = float(readings.repeated * f.shape[1])
    return Noise(REPEATABILITY, "scatter of repeated readings", readings.noise(size), dof, ESTIMATED)
