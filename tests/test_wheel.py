"""The package as a user installs it: a wheel, in a fresh environment, far from the checkout."""

import os
import pathlib
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
FOLDERS = {"gonio": "gonio", "models": "gonio/models", "data": "gonio/data", "fitting": "gonio/fitting"}
SUFFIXES = {".py", ".pyi", ".typed", ".toml", ".npz", ".j2", ".css", ".js"}


def built_wheel(folder: pathlib.Path) -> pathlib.Path:
    """The wheel of a copy of the sources, made without a network by the setuptools of the test environment."""
    for name in FOLDERS:
        shutil.copytree(ROOT / name, folder / "src" / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "src")
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--disable-pip-version-check"]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, "-w", folder, folder / "src"], check=True)
    (wheel,) = folder.glob("gonio-*.whl")
    return wheel


def fresh_environment(folder: pathlib.Path, wheel: pathlib.Path) -> pathlib.Path:
    """The programs' folder of a new environment that has gonio from the wheel, and the rest from the tests' own."""
    venv.create(folder, with_pip=False)
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    options = ["--no-deps", "--no-index", "--no-compile", "--quiet", "--disable-pip-version-check"]
    subprocess.run([sys.executable, "-m", "pip", "--python", python, "install", *options, wheel], check=True)
    (site,) = folder.glob("**/site-packages")
    paths = {p for p in sys.path if p.endswith("site-packages")} | {sysconfig.get_path("purelib")}
    # Of a folder that is added here Python reads no .pth file: the editable gonio of the tests is not seen.
    (site / "tests.pth").write_text("".join(f"{p}\n" for p in sorted(paths)))
    return python.parent


def test_the_wheel_holds_everything_and_does_the_main_job_from_another_folder(tmp_path):
    wheel = built_wheel(tmp_path)
    held = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        f"{place}/{path.relative_to(ROOT / name).as_posix()}"
        for name, place in FOLDERS.items()
        for path in (ROOT / name).rglob("*")
        if path.suffix in SUFFIXES
    }
    assert expected - held == set() and "gonio/py.typed" in held
    programs = fresh_environment(tmp_path / "environment", wheel)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=elsewhere, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    gonio = str(programs / "gonio")
    place = run(str(programs / "python"), "-c", "import gonio; print(gonio.__file__)")
    assert pathlib.Path(place).is_relative_to(tmp_path / "environment")
    run(gonio, "measure", "grey_card", "-o", "card.h5", "--step", "15")
    assert "converged" in run(gonio, "fit", "card.h5", "-m", "lambert", "-o", "card.fit.toml")
    run(gonio, "report", "card.h5", "--fit", "card.fit.toml", "-o", "card.html")
    assert (elsewhere / "card.html").stat().st_size > 50_000
