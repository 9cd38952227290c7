"""TOML files that users write: materials and scenes."""

import os
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from gonio.data.files import input_size
from gonio.models.errors import GonioError, nearest

FORMAT = 1


def read_toml(path: str | os.PathLike[str], kind: str, largest: int, keys: Sequence[str]) -> dict[str, Any]:
    """Content of a TOML file that begins with ``gonio_<kind> = 1``.

    Args:
        path: the file.
        kind: what it holds, such as "scene".
        largest: bytes, at most.
        keys: those that it may have, the first of them ``gonio_<kind>``.

    Raises:
        GonioError: in one sentence that names the file, for anything else.
    """
    size = input_size(path)
    if size > largest:
        raise GonioError(f"{path} has {size} bytes; a {kind} file has at most {largest}")
    try:
        data = tomllib.loads(Path(path).read_bytes().decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise GonioError(f"{path} is not a TOML file ({reason}); expected a {kind}") from None
    version = data.get(keys[0])
    if type(version) is not int:
        raise GonioError(f"{path}: it has no integer {keys[0]}; a {kind} file begins with '{keys[0]} = {FORMAT}'")
    if version != FORMAT:
        raise GonioError(
            f"{path}: {kind} format {version} is not known; this gonio reads format {FORMAT}, so update gonio"
        )
    require_keys(data, keys, f"{path}: ")
    return data


def require_keys(given: Iterable[str], known: Sequence[str], where: str) -> None:
    """Raises GonioError, beginning with `where` and naming the nearest, for a key that is not known."""
    for key in given:
        if key not in known:
            raise GonioError(f"{where}unknown key '{key}'; {nearest(key, known)}")
