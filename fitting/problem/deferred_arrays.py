"""Arrays of a large table that are computed where they are asked for: each would take as much memory as f."""

import abc
from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.models.geometry.directions import Direction


class _Deferred(np.lib.mixins.NDArrayOperatorsMixin, abc.ABC):
    """What stands for an array (n, C): it is one to NumPy's functions, which compute it whole."""

    __array_priority__ = 1.0

    @abc.abstractmethod
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray: ...

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return getattr(ufunc, method)(*(np.asarray(a) if a is self else a for a in inputs), **options)


class DeferredValues(_Deferred):
    """f (n, C) of a model at directions (n,): rows that are taken out of it are computed then, and nothing is kept."""

    def __init__(
        self, values: Callable[[Direction, Direction], np.ndarray], wi: Direction, wo: Direction, channels: int
    ):
        """Of a function that gives f (m, C) at m directions."""
        self._values, self._wi, self._wo = values, wi, wo
        self.shape = (np.size(wi.z), channels)

    @property
    def size(self) -> int:
        """Number of values."""
        return self.shape[0] * self.shape[1]

    @property
    def strides(self) -> tuple[int, int]:
        """Of the array that it stands for."""
        return 8 * self.shape[1], 8

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self._values(self._wi, self._wo), dtype)

    def __getitem__(self, key: Any) -> Any:
        both: tuple[Any, Any] = key if isinstance(key, tuple) and len(key) == 2 else (key, slice(None))
        rows, channels = both
        if isinstance(rows, np.ndarray) and rows.ndim == 2 and rows.shape[1] == 1:  # by `np.ix_`
            return self._of(rows[:, 0])[:, np.ravel(channels)]
        if isinstance(rows, slice) or (isinstance(rows, np.ndarray) and rows.ndim == 1):
            return self._of(rows)[:, channels]
        return np.asarray(self)[key]

    def take(self, cells: np.ndarray, axis: int) -> np.ndarray:
        """Some of the rows (axis 0), as of an array."""
        assert axis == 0
        return self._of(cells)

    def _of(self, rows: slice | np.ndarray) -> np.ndarray:
        return self._values(*(Direction(*(np.asarray(c)[rows] for c in w)) for w in (self._wi, self._wo)))

    def __reduce__(self) -> Any:
        return np.array, (np.asarray(self),)


class InverseWeights(_Deferred):
    """The uncertainties u (n, C) of weights 1/u, none of which is 0: one array for both."""

    def __init__(self, weight: np.ndarray) -> None:
        """Of weights (n, C), which are not copied."""
        self.weight = weight

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the weights."""
        return self.weight.shape

    @property
    def strides(self) -> tuple[int, ...]:
        """Of the weights."""
        return self.weight.strides

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(1.0 / self.weight, dtype)

    def __getitem__(self, key: Any) -> Any:
        return 1.0 / self.weight[key]

    def take(self, cells: np.ndarray, axis: int) -> np.ndarray:
        """Some of the uncertainties, as of an array."""
        return 1.0 / self.weight.take(cells, axis=axis)
