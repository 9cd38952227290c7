"""JSON of strangers: its size, depth and number of containers bounded before it is parsed; lists of numbers in it."""

import json
import os
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from gonio.data.files import input_size
from gonio.data.serialise import deepest
from gonio.models.errors import GonioError, printable

MOST_BYTES = 1 << 26
MOST_CONTAINERS = 1 << 21
DEEPEST = 32


def read_json(path: str | os.PathLike[str], kind: str) -> dict[str, Any]:
    """The object of a JSON file; whole numbers become floats, NaN and Infinity too.

    Args:
        path: the file.
        kind: what it is, for messages.

    Raises:
        GonioError: in one sentence, for anything else.
    """
    size = input_size(path)
    try:
        if size > MOST_BYTES:
            raise ValueError(f"{size >> 20} MiB, and it has at most {MOST_BYTES >> 20}")
        text = Path(path).read_bytes().decode("utf-8-sig")
        if text.count("[") + text.count("{") > MOST_CONTAINERS:
            raise ValueError(f"more than {MOST_CONTAINERS:,} lists and objects")
        if deepest(text) > DEEPEST:
            raise ValueError(f"more than {DEEPEST} brackets stand inside one another")
        data = json.loads(text, parse_int=float)
    except (ValueError, RecursionError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise GonioError(f"{path} is damaged JSON ({printable(reason)}); expected {kind}") from None
    if not isinstance(data, dict):
        raise GonioError(f"{path} holds a JSON {type(data).__name__}; expected {kind}")
    return data


class JsonPart:
    """A JSON object, asked for its entries by name; whatever is not there or of another kind is refused by its name."""

    def __init__(self, path: str | os.PathLike[str], data: Any, name: str = "") -> None:
        self.path = path
        self.name = name
        if not isinstance(data, dict):
            raise GonioError(f"{path}: {name} is no JSON object; export the file again")
        self.data: dict[str, Any] = data

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def part(self, key: str) -> "JsonPart":
        """The object of a key."""
        return JsonPart(self.path, self._value(key), f"{self.name}.{key}".lstrip("."))

    def text(self, key: str) -> str:
        """The text of a key; nothing where there is none."""
        value = self.data.get(key, "")
        return value if isinstance(value, str) else ""

    def entries(self, key: str) -> list[Any]:
        """The list of a key."""
        value = self._value(key)
        if not isinstance(value, list):
            self._refuse(key, "a list")
        return value

    def numbers(self, key: str, dimensions: int = 1, count: int | None = None) -> np.ndarray:
        """The list of numbers of a key, NaN where it has null; of lists of one length with two dimensions."""
        entries = self.entries(key)
        try:
            array = np.array(entries, np.float64)
        except (TypeError, ValueError, OverflowError):
            self._refuse(key, "a list of numbers" if dimensions == 1 else "rows of as many numbers each")
        if array.ndim != dimensions:
            self._refuse(key, "a list of numbers" if dimensions == 1 else "rows of as many numbers each")
        if count is not None and array.shape[0] != count:
            where = f"{self.name}.{key}".lstrip(".")
            raise GonioError(f"{self.path}: {where} has {array.shape[0]} entries, expected {count}; complete the list")
        return array

    def _value(self, key: str) -> Any:
        if key not in self.data:
            raise GonioError(f"{self.path}: it has no {f'{self.name}.{key}'.lstrip('.')}; export the file again")
        return self.data[key]

    def _refuse(self, key: str, expected: str) -> NoReturn:
        raise GonioError(f"{self.path}: {f'{self.name}.{key}'.lstrip('.')} is not {expected}; export the file again")
