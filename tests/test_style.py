"""The shape of the code and its words: what a reader may rely on in every function of the four floors."""

import ast
import functools
import io
import textwrap
import tokenize

import pytest

from support.sources import FLOORS, files, trees

MOST_PARAMETERS = 7
MOST_LINES = 45
RIDDLES = {
    "found", "at", "said", "seen", "told", "say", "talk", "asked", "drawn", "tried", "held", "left", "own", "mine",
    "aside", "worth", "lift", "raised", "surprise", "spelling", "summands",
}  # fmt: skip
Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions(tree: ast.Module) -> list[tuple[Function, bool]]:
    """Every function of a module, and whether it is a method whose first parameter is the object or class."""
    static = {"staticmethod"}
    result = []
    for node in ast.walk(tree):
        methods = isinstance(node, ast.ClassDef)
        for child in ast.iter_child_nodes(node):
            if isinstance(child, Function):
                bound = methods and not static & {ast.unparse(d) for d in child.decorator_list}
                result.append((child, bound))
    return result


@functools.cache
def every_function() -> dict[str, list[tuple[Function, bool]]]:
    return {name: functions(tree) for name, tree in trees().items()}


def parameters(function: Function, bound: bool) -> list[ast.arg]:
    """The parameters of a function without `self` or `cls`; starred ones too."""
    a = function.args
    every = [*a.posonlyargs, *a.args, *a.kwonlyargs, *(x for x in (a.vararg, a.kwarg) if x is not None)]
    return every[1:] if bound else every


def last_line(function: Function) -> int:
    return function.end_lineno or function.lineno


def code_lines(text: str, function: Function) -> int:
    """Number of a function's lines that hold code: no blanks, comments or docstrings."""
    skipped = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
    first, last = function.lineno, last_line(function)
    body = textwrap.dedent("".join(text.splitlines(keepends=True)[first - 1 : last]))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(body).readline):
        if token.type not in skipped:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(function):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            lines -= set(range(node.lineno - first + 1, (node.end_lineno or node.lineno) - first + 2))
    return len(lines)


def identifiers(tree: ast.Module) -> set[str]:
    """Names that a module defines: functions, classes, parameters, variables and attributes; not old public ones."""
    names: set[str] = set()
    old = {
        id(n.targets[0])
        for n in ast.walk(tree)
        if isinstance(n, ast.Assign) and isinstance(n.value, ast.Call) and "renamed_attribute(" in ast.unparse(n)
    }
    for node in (n for n in ast.walk(tree) if id(n) not in old):
        if isinstance(node, Function | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            names.add(node.id if isinstance(node, ast.Name) else node.attr)
        elif isinstance(node, ast.alias) and node.asname:
            names.add(node.asname)
    return names


def test_no_function_takes_more_than_seven_parameters():
    counts = {f"{name}:{f[0].name}": len(parameters(*f)) for name, those in every_function().items() for f in those}
    assert {f: n for f, n in counts.items() if n > MOST_PARAMETERS} == {}


def test_every_parameter_and_result_is_typed():
    untyped = []
    for name, those in every_function().items():
        for f, bound in those:
            untyped += [f"{name}:{f.name}({p.arg})" for p in parameters(f, bound) if p.annotation is None]
            untyped += [f"{name}:{f.name} ->"] if f.returns is None and f.name != "__init__" else []
    assert untyped == []


def test_no_function_is_longer_than_a_screen():
    lengths = {
        f"{name}:{f.name}": code_lines(files()[name], f)
        for name, those in every_function().items()
        for f, _ in those
        if last_line(f) - f.lineno >= MOST_LINES
    }
    assert lengths and {f: n for f, n in lengths.items() if n > MOST_LINES} == {}


@pytest.mark.parametrize("floor", FLOORS)
def test_identifiers_are_the_fields_terms(floor):
    riddles = {n: identifiers(t) & RIDDLES for n, t in trees().items() if n.startswith(f"{floor}/")}
    assert {name: words for name, words in riddles.items() if words} == {}


def test_the_counts_see_what_they_count():
    tree = ast.parse(
        "class A:\n  def f(self, a, b: int = 0, *c, d, **e): ...\ndef g(x) -> int:\n  '''Doc.'''\n  found = 1\n"
    )
    (f, bound), (g, _) = sorted(functions(tree), key=lambda pair: pair[0].name)
    assert [p.arg for p in parameters(f, bound)] == ["a", "b", "d", "c", "e"] and bound
    assert identifiers(tree) & RIDDLES == {"found"} and g.returns is not None
