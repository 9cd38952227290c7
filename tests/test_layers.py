"""Imports go down only: gonio, fitting, data, models. No floor reaches up, and no module bears a verb's name."""

import ast
import pathlib
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
FLOORS = ("models", "data", "fitting", "gonio")  # from the ground up
PACKAGES = {"models": "gonio.models", "data": "gonio.data", "fitting": "gonio.fitting", "gonio": "gonio"}
VERBS = {"material", "measure", "open", "fit", "check", "report"}


def floor_of(module: str) -> str | None:
    """The floor that an absolute module name belongs to; None outside gonio."""
    head, *rest = module.split(".")
    if head != "gonio":
        return None
    return rest[0] if rest and rest[0] in FLOORS[:3] else "gonio"


def imported(tree: ast.AST, package: str) -> set[str]:
    """Every module that a file imports, anywhere in it, relative ones made absolute."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")
                base = ".".join([*parents[: len(parents) - node.level + 1], *([base] if base else [])])
            # In "from gonio import models" the floor is named by what is imported.
            found |= {f"{base}.{alias.name}" for alias in node.names} if base == "gonio" else {base}
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name in ("import_module", "__import__") and isinstance(node.args[0].value, str):
                found.add(node.args[0].value)
    return found


def sources(floor: str) -> list[pathlib.Path]:
    return sorted((ROOT / floor).rglob("*.py"))


def reached(path: pathlib.Path, floor: str) -> set[str]:
    inside = path.relative_to(ROOT / floor).parent.parts
    package = ".".join([PACKAGES[floor], *inside])
    names = imported(ast.parse(path.read_text(encoding="utf-8")), package)
    return {floor_of(name) for name in names} - {None}


@pytest.mark.parametrize("floor", FLOORS)
def test_no_floor_reaches_up(floor):
    files = sources(floor)
    assert files
    above = set(FLOORS[FLOORS.index(floor) + 1 :])
    guilty = {str(p.relative_to(ROOT)): sorted(reached(p, floor) & above) for p in files}
    assert {p: f for p, f in guilty.items() if f} == {}


def test_models_need_nothing_but_jax_equinox_and_numbers():
    allowed = {"jax", "jaxlib", "equinox", "jaxtyping", "numpy", "gonio"}
    for path in sources("models"):
        names = imported(ast.parse(path.read_text(encoding="utf-8")), "gonio.models")
        heads = {name.split(".")[0] for name in names if name} - set(sys.stdlib_module_names)
        assert heads <= allowed, path.name


def test_no_module_of_the_top_floor_bears_a_verbs_name():
    assert not VERBS & {path.stem for path in (ROOT / "gonio").iterdir()}


@pytest.mark.parametrize(
    ("text", "package", "floor"),
    [
        ("import gonio.fitting.solver", "gonio.models", "fitting"),
        ("from gonio import data", "gonio.models", "data"),
        ("from ..data import table", "gonio.models", "data"),
        ("from .. import fitting", "gonio.data", "fitting"),
        ("def f():\n    from gonio.certificate import x", "gonio.data", "gonio"),
        ("import importlib\nimportlib.import_module('gonio.measuring')", "gonio.data", "gonio"),
    ],
)
def test_the_test_sees_every_way_of_reaching_up(text, package, floor):
    assert floor in {floor_of(name) for name in imported(ast.parse(text), package)}


def test_going_down_is_seen_as_going_down():
    names = imported(ast.parse("from gonio import models\nfrom gonio.models import base"), "gonio.data")
    assert {floor_of(name) for name in names} == {"models"}
