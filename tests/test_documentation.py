"""The README and the notebook of the first day do what they show."""

import ast
import json
import pathlib
import re
import shlex
import tomllib

import matplotlib.pyplot as plt
import numpy as np
import pytest
from sybil import Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser

from gonio.cli.program import main, parsed
from gonio.models.catalog import MODELS

ROOT = pathlib.Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "tests" / "support" / "first_day.ipynb"
COARSE = {"measure": ["--step", "15"]}  # so that the examples take seconds


def commands(text: str) -> list[list[str]]:
    """The words of each command of a block, without its comment."""
    lines = [shlex.split(line, comments=True) for line in text.splitlines() if line.strip()]
    assert all(words[0] == "gonio" for words in lines), text
    return [words[1:] for words in lines]


def run_commands(example: Example) -> None:
    for words in commands(example.parsed):
        assert main(words + COARSE.get(words[0], [])) == 0, words


def parse_commands(example: Example) -> None:
    for words in commands(example.parsed):
        parsed(words)


def parse_toml(example: Example) -> None:
    tomllib.loads(example.parsed)


@pytest.mark.filterwarnings("ignore:.*FigureCanvasAgg is non-interactive")
def test_every_block_of_the_readme_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    parsers = [
        PythonCodeBlockParser(),
        CodeBlockParser("sh", run_commands),
        CodeBlockParser("console", parse_commands),
        CodeBlockParser("toml", parse_toml),
    ]
    document = Sybil(parsers=parsers).parse(ROOT / "README.md")
    examples = list(document.examples())
    for example in examples:
        example.evaluate()
    plt.close("all")
    fences = re.findall(r"^```(\w+)$", (ROOT / "README.md").read_text(encoding="utf-8"), re.M)
    assert len(examples) == len(fences) >= 8
    assert {"plastic.h5", "plastic.html", "report.html", "mine.h5"} <= {p.name for p in tmp_path.iterdir()}


def test_the_readme_names_every_model():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [name for name in MODELS if not re.search(rf"\b{name}\b", text)] == []


def test_every_benchmark_is_listed_once_in_its_folders_table():
    folder = ROOT / "tests" / "benchmarks"
    _, *sections = re.split(r"^## .*`(\w+)/`$", (folder / "README.md").read_text(encoding="utf-8"), flags=re.M)
    listed = [
        f"{name}/{script}"
        for name, text in zip(sections[::2], sections[1::2], strict=True)
        for script in re.findall(r"^\| `(\w+\.py)", text, re.M)
    ]
    scripts = [p.relative_to(folder).as_posix() for p in folder.rglob("*.py")]
    assert sorted(listed) == sorted(set(scripts) - {"reports/written_scenes.py"})


def test_the_notebook_of_the_first_day_runs_with_public_names_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    names: dict[str, object] = {}
    for source in sources:
        *body, last = ast.parse(source).body
        exec(compile(ast.Module(body, []), NOTEBOOK.name, "exec"), names)
        if isinstance(last, ast.Expr):  # as a notebook shows it
            shown = eval(compile(ast.Expression(last.value), NOTEBOOK.name, "eval"), names)
            assert shown is None or shown._repr_html_()
        else:
            exec(compile(ast.Module([last], []), NOTEBOOK.name, "exec"), names)
    plt.close("all")
    imported = {alias.name for node in ast.walk(ast.parse("\n".join(sources))) for alias in getattr(node, "names", [])}
    assert imported == {"numpy", "gonio"}
    assert names["fitted"].converged and {"plastic.h5", "plastic.fit.toml"} <= {p.name for p in tmp_path.iterdir()}
    estimate = np.mean(names["weight"] * np.cos(np.radians(names["theta_s"])))
    deviation = np.std(names["weight"]) / np.sqrt(1000)
    assert abs(estimate - names["albedo"].value[0]) < 5 * deviation
