"""Arrays of a large table that are computed where they are asked for: each would take as much memory as f."""

import abc
import math
from collections.abc import Callable
from typing import Any

import numpy as np


class _Deferred(np.lib.mixins.NDArrayOperatorsMixin, abc.ABC):
    """What stands for an array (n, C): it is one to NumPy's functions, which compute it whole."""

    __array_priority__ = 1.0

    @abc.abstractmethod
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray: ...

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return getattr(ufunc, method)(*(np.asarray(a) if a is self else a for a in inputs), **options)


class DeferredValues(_Deferred):
    """Values of n rows, (n,) or (n, C): rows that are taken out of it are computed then, and nothing is kept."""

    def __init__(self, rows: Callable[[slice | np.ndarray], np.ndarray], shape: tuple[int, ...], kind: Any = float):
        """Of a function that gives some of the rows: a range, those of these numbers, or where booleans are true."""
        self._rows, self.shape, self.dtype = rows, shape, np.dtype(kind)

    @property
    def size(self) -> int:
        """Number of values."""
        return math.prod(self.shape)

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def strides(self) -> tuple[int, ...]:
        """Of the array that it stands for."""
        return tuple(self.dtype.itemsize * math.prod(self.shape[k + 1 :]) for k in range(self.ndim))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self._rows(slice(None)), dtype)

    def __getitem__(self, key: Any) -> Any:
        rows, *rest = key if isinstance(key, tuple) else (key,)
        if rest and isinstance(rows, np.ndarray) and rows.ndim == 2 and rows.shape[1] == 1:  # by `np.ix_`
            return self._rows(rows[:, 0])[:, np.ravel(rest[0])]
        if isinstance(rows, slice) or (isinstance(rows, np.ndarray) and rows.ndim == 1):
            return self._rows(rows)[(slice(None), *rest)]
        return np.asarray(self)[key]

    def take(self, cells: np.ndarray, axis: int) -> np.ndarray:
        """Some of the rows (axis 0), as of an array."""
        assert axis == 0
        return self._rows(cells)

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
