"""The shape of the code: sizes of files and functions, parameters, and what has no type, beside other packages.

python tests/benchmarks/structure/code_shape.py [FOLDER ...]     gonio's four folders, then each FOLDER by itself

Lines are code lines: no blank ones, no comments, no docstrings. Parameters are counted without self and cls.
"""

import ast
import io
import pathlib
import statistics
import sys
import tokenize

FLOORS = ("gonio", "fitting", "data", "models")
SILENT = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER,
}  # fmt: skip
Function = ast.FunctionDef | ast.AsyncFunctionDef


def code_lines(text: str, tree: ast.AST) -> set[int]:
    """Numbers of the lines that hold code."""
    lines = set()
    for t in tokenize.generate_tokens(io.StringIO(text).readline):
        if t.type not in SILENT:
            lines.update(range(t.start[0], t.end[0] + 1))
    for node in ast.walk(tree):
        for s in getattr(node, "body", []) if isinstance(getattr(node, "body", None), list) else []:
            if isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant) and isinstance(s.value.value, str):
                lines -= set(range(s.lineno, (s.end_lineno or s.lineno) + 1))
    return lines


def parameters(function: Function) -> list[ast.arg]:
    a = function.args
    every = [*a.posonlyargs, *a.args, *a.kwonlyargs, *(x for x in (a.vararg, a.kwarg) if x)]
    return [p for p in every if p.arg not in ("self", "cls", "_")]


def shape_of(folders: list[pathlib.Path]) -> dict[str, object]:
    """Counts and medians over every function of every file below the folders."""
    files, functions, many, untyped, count = [], [], [], 0, 0
    for path in sorted(p for folder in folders for p in folder.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        lines = code_lines(text, tree)
        if lines:
            files.append(len(lines))
        for node in ast.walk(tree):
            if isinstance(node, Function):
                first = node.lineno
                size = len(lines & set(range(first, (node.end_lineno or first) + 1)))
                functions.append((size, f"{path}:{first} {node.name}"))
                these = parameters(node)
                count += len(these)
                untyped += sum(p.annotation is None for p in these)
                if len(these) > 7:
                    many.append(f"{path}:{first} {node.name} ({len(these)})")
    longest = max(functions)
    return {
        "files": len(files),
        "code lines": sum(files),
        "median file": statistics.median(files),
        "functions": len(functions),
        "median function": statistics.median(size for size, _ in functions),
        "longest function": f"{longest[0]} ({longest[1]})",
        "functions of more than 45 lines": sum(size > 45 for size, _ in functions),
        "functions of more than 7 parameters": len(many),
        "untyped parameters": f"{untyped} of {count}",
    }


def main() -> None:
    root = pathlib.Path(__file__).resolve().parents[3]
    subjects = {"gonio": [root / floor for floor in FLOORS], "tests": [root / "tests"]}
    subjects |= {name: [pathlib.Path(name)] for name in sys.argv[1:]}
    for name, folders in subjects.items():
        print(name)
        for what, value in shape_of(folders).items():
            print(f"  {what:38}{value}")


if __name__ == "__main__":
    main()
