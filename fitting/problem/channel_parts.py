"""Many channels as parts of a few: one compiled program serves all of them, however many a table has."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gonio.fitting.problem.parameterisation import Domains, FreeParameter, Parameterisation

MOST_CHANNELS = 12
"""Channels of one program. LLVM takes with the square of a loop's length: 60 channels in one would take 20 s."""


class ChannelParts(NamedTuple):
    """A model of C channels as M parts of K channels each; the last two may share channels.

    Attributes:
        parameterisation: of the model with K channels.
        channels: (M, K) the channels of each part.
        numbers: (M, P of a part) where the free numbers of each part stand among all.
    """

    parameterisation: Parameterisation
    channels: np.ndarray
    numbers: np.ndarray

    @property
    def count(self) -> int:
        """Of all channels."""
        return int(self.channels[-1, -1]) + 1

    def leaves(self, leaves: Sequence[np.ndarray], part: int) -> list[np.ndarray]:
        """The fixed numbers of a part, from those of all channels."""
        return [a[self.channels[part]] if a.shape == (self.count,) else a for a in leaves]

    def addresses(self, leaf: np.ndarray) -> np.ndarray:
        """Where the fixed numbers of each part lie in memory, (M, numbers)."""
        every = np.broadcast_to(np.arange(leaf.size), (len(self.channels), leaf.size))
        return leaf.ctypes.data + 8 * (self.channels if leaf.shape == (self.count,) else every)

    def joined_squares(self, squares: Float[np.ndarray, "s m two k g g"]) -> Float[np.ndarray, "s two c g g"]:
        """The sums of all channels, from those of each part."""
        if len(self.channels) == 1:
            return squares[:, 0]
        joined = np.empty((len(squares), 2, self.count, *squares.shape[-2:]))
        joined[:, :, self.channels] = squares.swapaxes(1, 2)
        return joined

    def joined_values(self, f: Float[np.ndarray, "m n k"]) -> Float[np.ndarray, "n c"]:
        """f in all channels, from f in those of each part."""
        if len(f) == 1:
            return f[0]
        joined = np.empty((f.shape[1], self.count))
        for channels, values in zip(self.channels, f, strict=True):
            joined[:, channels] = values
        return joined


def channel_parts(s: Parameterisation) -> ChannelParts:
    """The fewest parts of at most `MOST_CHANNELS` channels, all of one size."""
    parts = max(1, -(-s.channels // MOST_CHANNELS))
    if parts == 1:
        return ChannelParts(s, np.arange(s.channels)[None], np.arange(s.size)[None])
    count = -(-s.channels // parts)
    first = np.minimum(np.arange(parts) * count, s.channels - count)
    channels = first[:, None] + np.arange(count)
    free: list[FreeParameter] = []
    size, numbers = 0, [np.zeros((parts, 0), int)]
    for g in s.free:
        free.append(dataclasses.replace(g, first=size))
        numbers.append(g.first + channels if g.per_channel else np.full((parts, 1), g.first))
        size += numbers[-1].shape[1]
    places = np.concatenate(numbers, axis=1)
    of_first = places[0]
    part = dataclasses.replace(
        s,
        free=tuple(free),
        channels=count,
        size=size,
        labels=[s.labels[k] for k in of_first],
        linear=s.linear[of_first],
        domains=Domains(*(a[of_first] for a in s.domains)),
        columns=np.array([[g.first + (c if g.per_channel else 0) for g in free] for c in range(count)], int),
    )
    return ChannelParts(part, channels, places)
