"""The sources of gonio, each read and parsed once, and not before a test asks for them."""

import ast
import functools
import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[2]
FLOORS = ("models", "data", "fitting", "gonio")


@functools.cache
def files() -> dict[str, str]:
    """The text of every module by its path from the root."""
    paths = (p for floor in FLOORS for p in sorted((ROOT / floor).rglob("*.py")))
    return {p.relative_to(ROOT).as_posix(): p.read_text("utf-8") for p in paths}


@functools.cache
def trees() -> dict[str, ast.Module]:
    """Every module parsed; nobody may change them."""
    return {name: ast.parse(text) for name, text in files().items()}
