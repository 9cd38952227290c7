"""Keys of tasks: digests of all that determines a result, so that what is there already is known by its name."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from gonio import __version__
from gonio.data.files import input_size
from gonio.data.serialise import unboxed

FORMAT = 1
"""Of results and their keys: another one where the same recipe gives other files."""
LENGTH = 32
"""Hexadecimal digits of a key: 128 bits."""


def canonical(content: Any) -> str:
    """JSON of one form: sorted keys, no spaces, numbers by their shortest digits; infinite numbers as texts."""
    return json.dumps(_texts(unboxed(content)), sort_keys=True, separators=(",", ":"), allow_nan=False)


def key_of(kind: str, spec: dict[str, Any]) -> str:
    """The key of a task of a kind (measure, fit, ...) with everything that determines its result."""
    head = {"gonio_campaign_task": FORMAT, "gonio": __version__, "kind": kind}
    return hashlib.sha256(canonical(head | {"spec": spec}).encode()).hexdigest()[:LENGTH]


def digest_of(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's content. Raises GonioError where it cannot be read."""
    input_size(path)
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _texts(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _texts(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_texts(inner) for inner in value]
    if isinstance(value, float):
        return repr(value) if value != value or value in (float("inf"), float("-inf")) else value + 0.0
    return value
