"""Standard uncertainties as the weights 1/u of a fit: one array for both, where a table is large."""

from typing import Any

import numpy as np


class InverseWeights(np.lib.mixins.NDArrayOperatorsMixin):
    """The uncertainties u (n, C) of weights 1/u, none of which is 0: what is taken out of it is computed then."""

    __array_priority__ = 1.0

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

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return getattr(ufunc, method)(*(np.asarray(a) if a is self else a for a in inputs), **options)

    def __getitem__(self, key: Any) -> Any:
        return 1.0 / self.weight[key]

    def take(self, cells: np.ndarray, axis: int) -> np.ndarray:
        """Some of the uncertainties, as of an array."""
        return 1.0 / self.weight.take(cells, axis=axis)
