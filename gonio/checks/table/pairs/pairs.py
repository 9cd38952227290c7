"""Pairs of readings that should be equal, channel by channel."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

FEWEST = 12
"""Pairs below which a region is not judged alone, nor a table at all."""
NO_CELLS = np.zeros(0, np.int64)
ROUNDING = 1e-12
"""Of the largest reading: what is smaller is nothing, as where no light is refracted to."""


class Column(NamedTuple):
    """Readings a and b of one channel, (n,), NaN where not valid, that should be equal, and their uncertainties."""

    a: np.ndarray
    b: np.ndarray
    u_a: np.ndarray
    u_b: np.ndarray
    error: np.ndarray | float = 0.0
    """Relative error of the values b that interpolation makes, (n,) or one for all."""

    def rows(self, some: np.ndarray | slice) -> "Column":
        """Some of the pairs."""
        error = self.error[some] if isinstance(self.error, np.ndarray) else self.error
        return Column(self.a[some], self.b[some], self.u_a[some], self.u_b[some], error)


@dataclasses.dataclass(frozen=True)
class Pairs:
    """Readings a and b that should be equal, their uncertainties and places; those of each channel when asked for."""

    channels: int
    angles: np.ndarray
    """(n, 4): theta_i, phi_i, theta_o, phi_o of a, radians."""
    eligible: int
    """Cells that should have a partner, with one or without."""
    column: Callable[[int], Column]
    """The readings of a channel."""
    how: str = "measured"
    """How the partners came about, in words."""
    errors: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    """Relative errors of all values b that interpolation makes; the others have none."""
    around: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    """(m, channels): of the last pairs, whose values b are interpolated, by how much the readings around b differ,
    relative to both; NaN where one is missing."""
    merged: np.ndarray | None = None
    """(m, 4), radians: all readings once their repeats are merged, where there may be repeats."""
    cells: np.ndarray = dataclasses.field(default_factory=lambda: NO_CELLS)
    """(n,) C-order numbers of the cells of a, of a grid; empty elsewhere."""
    exchanged: bool = True
    """Whether b is of the exchanged directions, so that its light comes from where a has the detector."""

    @property
    def theta_i(self) -> tuple[np.ndarray, np.ndarray]:
        """Polar angles of incidence of a and of b, (n,) radians each."""
        return self.angles[:, 0], self.angles[:, 2 if self.exchanged else 0]

    @property
    def theta_o(self) -> tuple[np.ndarray, np.ndarray]:
        """Polar angles of the detector of a and of b, (n,) radians each."""
        return self.angles[:, 2], self.angles[:, 0 if self.exchanged else 2]

    @classmethod
    def of_arrays(
        cls,
        readings: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
        angles: np.ndarray,
        eligible: int,
        how: str = "measured",
        error: np.ndarray | None = None,
        **fields: Any,
    ) -> "Pairs":
        """Pairs of `readings` a, b and their uncertainties, and of relative errors of b, (n, channels) each.

        `fields`: further ones of `Pairs`.
        """

        def column(channel: int) -> Column:
            of_channel = (np.asarray(v[:, channel], float) for v in readings)
            return Column(*of_channel, error=0.0 if error is None else np.asarray(error[:, channel], float))

        errors = np.zeros(0) if error is None else np.ravel(error)
        return cls(readings[0].shape[1], angles, eligible, column, how, errors, **fields)

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self.angles)

    def columns(self) -> Iterator[Column]:
        """The readings of one channel after the other."""
        return map(self.column, range(self.channels))

    @property
    def median_error(self) -> float:
        """Median of the relative errors that interpolation makes, of all values b."""
        exact = len(self) * self.channels - self.errors.size
        if not exact:
            return float(np.median(self.errors))
        middle, ordered = (len(self) * self.channels - 1) / 2 - exact, np.sort(self.errors)
        return float(np.mean([ordered[k] if k >= 0 else 0.0 for k in (int(np.floor(middle)), int(np.ceil(middle)))]))

    def where(self, some: np.ndarray) -> "Pairs":
        """Those of the pairs, (n,) truth values."""
        number, column = np.flatnonzero(some), self.column
        if number.size == len(self):
            return self
        last = np.flatnonzero(some[len(self) - len(self.around) :])
        with_error = self.errors.size // self.channels
        errors = self.errors.reshape(with_error, self.channels)[some[len(self) - with_error :]]
        return dataclasses.replace(
            self,
            angles=self.angles[number],
            column=lambda channel: column(channel).rows(number),
            errors=errors.ravel(),
            around=self.around[last],
            cells=self.cells[number] if self.cells.size else self.cells,
        )

    def within_readings(self) -> "Pairs":
        """The same pairs, interpolated values known to lie between the readings around them, and no better.

        Where such a reading is missing nothing is compared.
        """
        first = len(self) - len(self.around)

        def change(channel: int, column: Column) -> Column:
            error = np.broadcast_to(np.asarray(column.error, float), column.a.shape).copy()
            error[first:] = np.fmax(error[first:], self.around[:, channel])
            known = np.concatenate([np.ones(first, bool), np.isfinite(self.around[:, channel])])
            return column._replace(b=np.where(known, column.b, np.nan), error=error)

        return self.changed(change) if len(self.around) else self

    def changed(self, change: Callable[[int, Column], Column]) -> "Pairs":
        """The same pairs with other readings, by the channel."""
        column = self.column
        return dataclasses.replace(self, column=lambda channel: change(channel, column(channel)))


def joined(first: Pairs, second: Pairs) -> Pairs:
    """Both kinds of pairs of one table."""
    if not len(first) or not len(second):
        return second if len(second) else first

    def column(channel: int) -> Column:
        both = first.column(channel), second.column(channel)
        error = [np.broadcast_to(np.asarray(c.error, float), c.a.shape) for c in both]
        a, b, u_a, u_b = (np.concatenate(pair) for pair in zip(both[0][:4], both[1][:4], strict=True))
        return Column(a, b, u_a, u_b, np.concatenate(error))

    return Pairs(
        first.channels,
        np.concatenate([first.angles, second.angles]),
        max(first.eligible, second.eligible),
        column,
        f"{first.how} and {len(second):,} {second.how}",
        np.concatenate([first.errors, second.errors]),
        second.around,
        cells=np.concatenate([first.cells, second.cells]) if first.cells.size and second.cells.size else NO_CELLS,
    )


def without_radiance_factor(pairs: Pairs, media: tuple[np.ndarray, np.ndarray]) -> Pairs:
    """Exchanged pairs, those through the sample divided by the squared index of the detector's medium.

    f_t(i → o)/n_o² = f_t(o → i)/n_i² [Walter 2007]; `media` are the indices (C,) in front of the sample and behind it.
    """
    behind = [np.cos(pairs.angles[:, k]) < 0 for k in (0, 2)]
    through = behind[0] != behind[1]

    def change(channel: int, column: Column) -> Column:
        by_light, by_detector = (
            np.where(through, np.where(b, media[1][channel], media[0][channel]) ** 2, 1.0) for b in behind
        )
        a, b = column.a / by_detector, column.b / by_light
        size = np.fmax(np.abs(a), np.abs(b))
        nothing = size <= ROUNDING * np.nanmax(size, initial=0.0)
        a, b = (np.where(nothing, 0.0, v) for v in (a, b))
        return column._replace(a=a, b=b, u_a=column.u_a / by_detector, u_b=column.u_b / by_light)

    return pairs.changed(change)
