"""Values as files can hold them: Python's own containers, numbers and texts."""

import math
import re
from collections.abc import Callable
from typing import Any

from gonio.models.errors import GonioError, printable

NUMBER = (int, float)
"""The kind of a number, for `require_kind`."""


def require_kind(value: Any, kind: Any, where: str) -> None:
    """Raises GonioError where a value, or one inside it, is not of a kind.

    Args:
        value: what a file holds.
        kind: a type, or `NUMBER`; of a list [kind of the entries]; of a table {key: kind}, where the key "" stands for
            every other one, and others are not looked at.
        where: the beginning of the sentence.
    """
    if isinstance(kind, dict):
        _require_type(value, dict, where)
        for key, inner in value.items():
            if key in kind or "" in kind:
                require_kind(inner, kind[key if key in kind else ""], f"{where}.{key}")
    elif isinstance(kind, list):
        _require_type(value, list, where)
        for item in value:
            require_kind(item, kind[0], f"an entry of {where}")
    else:
        _require_type(value, kind, where)


def _require_type(value: Any, kind: Any, where: str) -> None:
    if not isinstance(value, kind) or (kind in (int, NUMBER) and isinstance(value, bool)):
        named = {str: "a text", bool: "true or false", int: "a whole number", dict: "a table", list: "a list"}
        raise GonioError(f"{where} is {type(value).__name__}; expected {named.get(kind, 'a number')}")


def unboxed(value: Any) -> Any:
    """`value` with arrays as lists and NumPy's scalars as numbers, NaN too; keys of dicts are texts."""
    return _walked(value, lambda leaf: leaf)


def plain(value: Any) -> Any:
    """`unboxed`, as JSON can hold it: numbers that are not finite become None."""
    return _walked(value, lambda leaf: None if isinstance(leaf, float) and not math.isfinite(leaf) else leaf)


def finite(content: dict[str, Any]) -> dict[str, Any]:
    """`plain`, with the reasons of what became None.

    They stand in the entry "null", by JSON pointers (of a list, one for all that is in it).
    """
    reasons: dict[str, str] = dict(content.get("null", {}))
    _note_reasons(unboxed(content), "", reasons)
    return plain(content) | ({"null": reasons} if reasons else {})


def _note_reasons(value: Any, pointer: str, reasons: dict[str, str]) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            _note_reasons(inner, f"{pointer}/{key.replace('~', '~0').replace('/', '~1')}", reasons)
    elif isinstance(value, list):
        numbers = [v for v in value if isinstance(v, float) and not math.isfinite(v)]
        if numbers:
            kinds = sorted({_not_finite(v) for v in numbers})
            reasons[pointer] = f"{len(numbers)} of {len(value)}: {', '.join(kinds)}"
        for k, inner in enumerate(value):
            if isinstance(inner, list | dict):
                _note_reasons(inner, f"{pointer}/{k}", reasons)
    elif isinstance(value, float) and not math.isfinite(value):
        reasons[pointer] = _not_finite(value)


def _not_finite(value: float) -> str:
    return "not known" if math.isnan(value) else "infinite" if value > 0 else "minus infinite"


def toml_values(value: Any) -> Any:
    """`unboxed`, as TOML can hold it: entries that are None are left out, other objects become texts."""
    return _walked(value, lambda leaf: leaf if isinstance(leaf, bool | int | float | str) else str(leaf), True)


def encodable(value: Any) -> Any:
    """`unboxed`, with texts that can be printed and encoded, see `printable`."""
    return _walked(value, lambda leaf: _encodable(leaf) if isinstance(leaf, str) else leaf)


def deepest(text: str) -> int:
    """How many brackets of a JSON or TOML text stand inside one another, at most, outside of its strings.

    To be asked before such a text is parsed: what walks through its values later calls itself for each.
    """
    depth = most = 0
    unescaped = text.replace("\\\\", "").replace('\\"', "")
    # By quotes, as a pattern of whole strings tries an open one anew from each of its escaped quotes.
    for bracket in re.sub(r"[^\[\]{}]+", "", "".join(unescaped.split('"')[::2])):
        depth += 1 if bracket in "[{" else -1
        most = max(most, depth)
    return most


def _encodable(text: str) -> str:
    return printable(text, kept="\n\t")


LEAVES = frozenset((float, int, bool, str, type(None)))


def _walked(value: Any, leaf: Callable[[Any], Any], without_none: bool = False) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        items = ((_encodable(str(k)), v) for k, v in value.items() if not (without_none and v is None))
        return {k: _walked(v, leaf, without_none) for k, v in items}
    if isinstance(value, list | tuple):
        # Long lists of numbers are most of what is walked
        return [
            leaf(v) if type(v) in LEAVES else _walked(v, leaf, without_none)
            for v in value
            if not (without_none and v is None)
        ]
    return leaf(value)
