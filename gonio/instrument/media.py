"""The media in front of the sample and behind it: the material's, the instrument's, or both where they agree."""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from gonio.data.table import MEDIA, Table, media_of
from gonio.instrument.instrument import Instrument
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import FRONT, Sides

if TYPE_CHECKING:
    from gonio.models.brdf import AbstractBRDF

SAME_INDEX = 1e-6
"""Relative difference of ratios of indices that are one."""


def media_of_measurement(instrument: Instrument, brdf: "AbstractBRDF", sides: Sides) -> list[Any] | None:
    """Refractive indices in front and behind for the provenance of a table; None where they say nothing.

    Args:
        instrument: its `media`, where it states them.
        brdf: its index behind relative to that in front.
        sides: those of light and detector; of reflection from the front alone the media say nothing.

    Raises:
        GonioError: the instrument's media are not in the material's ratio.
    """
    if sides == FRONT:
        return None
    ratio = np.asarray(brdf.index_behind, float)
    if instrument.media is None:
        return [1.0, ratio.tolist()] if (ratio != 1).any() else None
    front, behind = instrument.media
    if (np.abs(ratio * front / behind - 1) > SAME_INDEX).any():
        shown = ", ".join(f"{n:.6g}" for n in np.atleast_1d(ratio))
        raise GonioError(
            f"the instrument's media are {front:g} in front of the sample and {behind:g} behind it, a ratio of "
            f"{behind / front:.6g}, but the index behind the material is {shown} times that in front; give media of "
            "that ratio, or none"
        )
    return [front, behind]


def with_media(table: Table, instrument: Instrument) -> Table:
    """The table with the instrument's media, where it does not state its own.

    Raises:
        GonioError: the table states other media.
    """
    if instrument.media is None:
        return table
    stated = media_of(table.provenance.get(MEDIA), len(table.channels))
    if stated is None:
        return dataclasses.replace(table, provenance=table.provenance | {MEDIA: list(instrument.media)})
    ours = media_of(instrument.media, len(table.channels))
    assert ours is not None
    if any((np.abs(a / b - 1) > SAME_INDEX).any() for a, b in zip(stated, ours, strict=True)):
        indices = ", ".join(f"{n[0]:g}" for n in stated)
        given = ", ".join(f"{n:g}" for n in instrument.media)
        raise GonioError(
            f"{table.name or 'the table'} states media of index {indices} (in front, behind), the instrument {given}; "
            "leave the instrument out, or correct one of them"
        )
    return table
