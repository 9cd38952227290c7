"""The face in Python: what `import gonio` gives, and that it gives it quickly."""

import ast
import builtins
import importlib
import inspect
import pathlib
import subprocess
import sys

import pytest

import gonio
import gonio.data
import gonio.fitting
import gonio.models

VERBS = [
    "adapt",
    "campaign",
    "chapter",
    "chart",
    "check",
    "convert",
    "fit",
    "fit_many",
    "fit_profile",
    "material",
    "measure",
    "measure_profile",
    "open",
    "open_profile",
    "plan",
    "plan_energy",
    "quantities",
    "reduce",
    "repair",
    "report",
    "scan",
    "standard_uncertainty",
    "stress",
]
CLASSES = [
    "Certificate",
    "FitResult",
    "GonioError",
    "Instrument",
    "Material",
    "Profile",
    "ProfileFit",
    "Scene",
    "Table",
]


def test_completion_shows_verbs_and_classes():
    assert {*VERBS, *CLASSES} <= set(dir(gonio))
    assert all(callable(getattr(gonio, name)) for name in VERBS)
    assert all(inspect.isclass(getattr(gonio, name)) for name in CLASSES)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        gonio.fitt  # noqa: B018


def test_a_star_import_leaves_pythons_own_open():
    names = {}
    exec("from gonio import *", names)
    assert names.get("open", builtins.open) is builtins.open and names["fit"] is gonio.fit


def test_type_checkers_see_what_is_loaded():
    stub = ast.parse(pathlib.Path(gonio.__file__).with_suffix(".pyi").read_text("utf-8"))
    seen = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    seen["open"] = seen.pop("_read")
    loaded = {name: getattr(importlib.import_module(module), attribute) for name, (module, attribute) in seen.items()}
    assert loaded == {name: getattr(gonio, name) for name in (*VERBS, *CLASSES)}


@pytest.mark.parametrize("package", [gonio.models, gonio.data, gonio.fitting])
def test_packages_give_their_public_names(package):
    assert dir(package) and all(getattr(package, name) is not None for name in dir(package))
    assert pathlib.Path(package.__file__).with_suffix(".pyi").exists()


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import gonio; gonio.GonioError; dir(gonio)", ("jax", "numpy")),
        ("from gonio.models.errors import GonioError", ("jax", "numpy")),
        ("import gonio.fitting, gonio.data, gonio.models", ("jax", "numpy")),
        ("import gonio; gonio.open", ("jax",)),
        ("import gonio.metrology.quantities, gonio.reports.build", ("optimistix", "lineax", "matplotlib")),
    ],
)
def test_imports_load_no_more_than_they_need(statement, absent):
    code = f"import sys; {statement}; sys.exit(any(name in sys.modules for name in {absent}))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


def test_what_reads_tables_needs_no_jax(tmp_path):
    rows = [f"{i},0,{o},0,0.3" for i in (0, 30, 60) for o in (0, 30, 60)]
    (tmp_path / "t.csv").write_text("theta_i,phi_i,theta_o,phi_o,f\n" + "\n".join(rows) + "\n")
    code = (
        "import sys; from gonio.cli.program import main; "
        "words = (['info', 't.csv'], ['check', 't.csv'], ['convert', 't.csv', 't.h5']); "
        "statuses = [main(list(w)) for w in words]; "
        "sys.exit(2 in statuses or any(n in sys.modules for n in ('jax', 'equinox', 'jaxtyping', 'scipy.optimize')))"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
