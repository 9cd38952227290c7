"""Values as JSON can hold them."""

import math
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """`value` made of what JSON can hold: arrays become lists, numbers that are not finite None."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def unboxed(value: Any) -> Any:
    """NumPy out of nested containers: lists, dicts, numbers (NaN too, which TOML knows) and strings only."""
    if isinstance(value, dict):
        return {str(k): unboxed(v) for k, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [unboxed(v) for v in (value.tolist() if isinstance(value, np.ndarray) else value)]
    return value.item() if isinstance(value, np.generic) else value


def without_none(value: Any) -> Any:
    """Nested containers less their empty entries, which TOML cannot hold."""
    if isinstance(value, dict):
        return {k: without_none(v) for k, v in value.items() if v is not None}
    return [without_none(v) for v in value] if isinstance(value, list) else value
