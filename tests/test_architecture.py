"""Imports go down only, from room to room; no room reaches up, and no module bears a public function's name."""

import ast
import functools
import graphlib
import sys
import tomllib
from pathlib import Path

import pytest

from support.sources import ROOT, trees

FLOORS = {"models": "gonio.models", "data": "gonio.data", "fitting": "gonio.fitting", "gonio": "gonio"}  # upwards
ROOMS = (
    "instrument",
    "planning",
    "checks",
    "metrology",
    "figures",
    "exports",
    "stability",
    "charts",
    "reports",
    "campaigns",
    "cli",
)  # of the top floor, upwards
VERBS = {
    "adapt",
    "campaign",
    "material",
    "measure",
    "open",
    "plan",
    "quantities",
    "fit",
    "fit_many",
    "check",
    "chart",
    "stress",
    "reduce",
    "repair",
    "report",
}


def module_names() -> dict[str, Path]:
    """Every module of gonio by its absolute name."""
    modules = {}
    for folder, package in FLOORS.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            modules[".".join([package, *(p for p in parts if p != "__init__")])] = path
    return modules


MODULES = module_names()


def imported(tree: ast.AST, package: str) -> set[str]:
    """Every module that a file imports, anywhere in it, relative ones made absolute."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")
                base = ".".join([*parents[: len(parents) - node.level + 1], *([base] if base else [])])
            inside = {f"{base}.{alias.name}" for alias in node.names} & MODULES.keys()
            names |= inside | ({base} if len(inside) < len(node.names) else set())
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name in ("import_module", "__import__") and isinstance(node.args[0].value, str):
                names.add(node.args[0].value)
    return names


def without_type_checking(tree: ast.Module) -> ast.Module:
    """A module without the imports that only type checkers see, at its top."""
    guarded = [n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    return ast.Module([n for n in tree.body if n not in guarded], [])


def package_of(module: str) -> str:
    return module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]


def rank(module: str) -> tuple[int, int] | None:
    """(floor, room of the top floor) of a module of gonio; None outside gonio. Who imports has no smaller rank."""
    head, *rest = module.split(".")
    if head != "gonio":
        return None
    floors = list(FLOORS)
    if rest and rest[0] in floors[:3]:
        return floors.index(rest[0]), 0
    if not rest or rest[0] in ("text", "__main__"):
        return 3, (len(ROOMS) - 1 if rest == ["__main__"] else -1)
    return 3, (ROOMS.index(rest[0]) if rest[0] in ROOMS else -1)


@functools.cache
def room(module: str) -> str:
    """The folder of a module; a file that stands beside folders is a room of its own."""
    package = package_of(module)
    inner = any(package_of(m) == m and m.startswith(package + ".") for m in MODULES)
    return module if inner else package


@functools.cache
def imports() -> dict[str, set[str]]:
    return {m: imported(trees()[p.relative_to(ROOT).as_posix()], package_of(m)) for m, p in MODULES.items()}


def test_every_folder_of_the_top_floor_is_a_room():
    folders = {p.name for p in (ROOT / "gonio").iterdir() if (p / "__init__.py").exists()}
    assert folders == set(ROOMS)


def test_every_folder_is_installed():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    assert set(listed) == {module for module in MODULES if package_of(module) == module}


def test_no_import_goes_up():
    lazy = {"gonio"}  # its verbs are loaded when they are first used
    guilty = [
        (module, name)
        for module, names in imports().items()
        if module not in lazy
        for name in names
        if rank(name) is not None and name != "gonio" and rank(name) > rank(module)
    ]
    assert guilty == []


def test_rooms_form_no_circle():
    arrows = {}
    for module, names in imports().items():
        arrows.setdefault(room(module), set()).update(room(n) for n in names if n in MODULES and n != "gonio")
    arrows.pop("gonio", None)
    try:
        tuple(graphlib.TopologicalSorter({r: to - {r} for r, to in arrows.items()}).static_order())
    except graphlib.CycleError as error:
        pytest.fail(f"rooms that import each other in a circle: {error.args[1]}")


def test_models_need_nothing_but_jax_equinox_llvm_and_numbers():
    allowed = {"jax", "jaxlib", "equinox", "jaxtyping", "numpy", "gonio", "lazy_loader", "llvmlite"}
    for module, path in MODULES.items():
        if module.startswith("gonio.models"):
            tree = trees()[path.relative_to(ROOT).as_posix()]
            names = imported(without_type_checking(tree), package_of(module))
            heads = {name.split(".")[0] for name in names if name} - set(sys.stdlib_module_names)
            assert heads <= allowed, module


def test_no_module_bears_the_name_of_a_verb():
    assert not {m for m in MODULES if m.rpartition(".")[0] == "gonio" and m.rpartition(".")[2] in VERBS}


@pytest.mark.parametrize(
    ("text", "package", "reached"),
    [
        ("import gonio.fitting.result", "gonio.models", "gonio.fitting.result"),
        ("from gonio.data import table", "gonio.models", "gonio.data.table"),
        ("from ..data import table", "gonio.models", "gonio.data.table"),
        ("def f():\n    from gonio.checks.certificate import x", "gonio.data", "gonio.checks.certificate"),
        ("import importlib\nimportlib.import_module('gonio.charts.fits')", "gonio.data", "gonio.charts.fits"),
    ],
)
def test_the_test_sees_every_way_of_reaching_up(text, package, reached):
    assert reached in imported(ast.parse(text), package) and rank(reached) > rank(package)
