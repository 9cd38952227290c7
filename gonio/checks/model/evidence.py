"""What the checks of a model are given: the model, the pairs of directions to evaluate it at, a reference."""

import dataclasses
import functools

import numpy as np

from gonio.checks.direction_search import pair_angles
from gonio.checks.table.evidence import LEVEL
from gonio.data.channels import Channels
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF


@dataclasses.dataclass(frozen=True)
class ModelEvidence:
    """A model, the names of its channels, and the truth where one is stated."""

    brdf: AbstractBRDF
    channels: tuple[str, ...] = ()
    reference: AbstractBRDF | None = None
    readings: Table | None = None
    """Those of the same surface, beside which the model is judged in place of a truth."""
    level: float = LEVEL
    """Of the tests against the uncertainties of these."""
    own_channels: Channels | None = None
    """The channels with their wavelengths, where it is judged beside readings."""

    @functools.cached_property
    def angles(self) -> np.ndarray:
        """Pairs of directions that all checks of f look at: see `pair_angles`."""
        return pair_angles(self.brdf)

    def channel(self, number: int, count: int) -> int | str | None:
        """What a place calls one of so many channels: its name if known, its number; None for a single channel."""
        if count == 1:
            return None
        return self.channels[number] if self.channels else number
