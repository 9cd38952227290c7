"""What several verbs share: their arguments, what they refuse before any work, and how they write a text."""

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.data.table import Table

MATERIAL = "a reference material, a readable file or an expression"


def add_force(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--force", action="store_true", help="replace existing outputs")


def add_merl_nodes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--merl-nodes", choices=("lower", "centre"), help="where a MERL file's nodes lie in their bins")


def read_table(path: str, merl_nodes: str | None) -> "Table":
    """The table of a file, named after the file where it has no name of its own."""
    from pathlib import Path

    from gonio.data.formats.registry import read

    table = read(path, **({"nodes": merl_nodes} if merl_nodes else {}))
    table.name = table.name or Path(path).stem
    return table


def refuse_outputs(outputs: Sequence[str | None], inputs: Sequence[str | None], force: bool) -> None:
    """Refuses outputs that exist (unless `force`) or are inputs, before any work; None and "-" are no files."""
    from gonio.data.files import refuse_existing, refuse_input

    for path in outputs:
        if path is not None and path != "-":
            refuse_existing(path, force)
            refuse_input(path, *(i for i in inputs if i is not None))


def require_range(option: str, value: float | None, low: float, high: float) -> None:
    """Refuses degrees outside of [low, high]; None is no value."""
    if value is not None and not low <= value <= high:
        raise GonioError(f"{option} is {value:g}; give degrees from {low:g} to {high:g}")


def write_text(path: str, text: str, force: bool) -> None:
    """Writes a text whole or not at all; "-" is standard output."""
    if path == "-":
        sys.stdout.write(text)
        return
    from gonio.data.files import new_file

    with new_file(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")
