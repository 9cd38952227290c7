"""Values as files can hold them: Python's own containers, numbers and texts."""

import math
from collections.abc import Callable
from typing import Any


def unboxed(value: Any) -> Any:
    """`value` with arrays as lists and NumPy's scalars as numbers, NaN too; keys of dicts are texts."""
    return _walked(value, lambda leaf: leaf)


def plain(value: Any) -> Any:
    """`unboxed`, as JSON can hold it: numbers that are not finite become None."""
    return _walked(value, lambda leaf: None if isinstance(leaf, float) and not math.isfinite(leaf) else leaf)


def toml_values(value: Any) -> Any:
    """`unboxed`, as TOML can hold it: entries that are None are left out, other objects become texts."""
    return _walked(value, lambda leaf: leaf if isinstance(leaf, bool | int | float | str) else str(leaf), True)


def _walked(value: Any, leaf: Callable[[Any], Any], without_none: bool = False) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        items = ((str(k), v) for k, v in value.items() if not (without_none and v is None))
        return {k: _walked(v, leaf, without_none) for k, v in items}
    if isinstance(value, list | tuple):
        return [_walked(v, leaf, without_none) for v in value if not (without_none and v is None)]
    return leaf(value)
