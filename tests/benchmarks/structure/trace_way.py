"""The way of a table through a verb: the files that are entered, in the order of the first call of each function.

python tests/benchmarks/structure/trace_way.py

`gonio.fit("t.h5", "lambert + ggx(eta=1.5)")` and `gonio.check("t.h5")`, each in a process of its own. A function counts
once, where it is first called; consecutive calls in one file are one entry. A *return* is an entry to a file that had
been left.
"""

import inspect
import os
import subprocess
import sys
import tempfile
from types import FrameType
from typing import Any

CALLS = {"fit": ("t.h5", "lambert + ggx(eta=1.5)"), "check": ("t.h5",)}
MEASURE = ("measure", "satin_plastic_blue", "-o", "t.h5", "--step", "10", "--photons", "1e6")
FLOORS = ("gonio", "fitting", "data", "models")


def trace(verb: str) -> list[str]:
    """The files entered while a verb runs, relative to the project, in the order of each function's first call."""
    import gonio

    root = os.path.dirname(os.path.dirname(os.path.abspath(gonio.__file__)))
    floors = tuple(os.path.join(root, floor) + os.sep for floor in FLOORS)
    codes, way = set(), []

    def note(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or code in codes or not code.co_filename.startswith(floors):
            return
        if not code.co_flags & inspect.CO_OPTIMIZED:  # the body of a module or of a class, run by an import
            return
        codes.add(code)
        file = os.path.relpath(code.co_filename, root)
        if not way or way[-1] != file:
            way.append(file)

    run = getattr(gonio, verb)
    sys.setprofile(note)
    run(*CALLS[verb])
    sys.setprofile(None)
    return way


def report(verb: str) -> None:
    way = trace(verb)
    files = len(set(way))
    print(f"gonio.{verb}: {files} files, {len(way) - files} returns\n  " + " → ".join(way))


def main() -> None:
    environment = {**os.environ, "GONIO_NO_CACHE": "1", "JAX_ENABLE_X64": "1"}
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "gonio", *MEASURE], cwd=folder, check=True, capture_output=True)
        for verb in CALLS:
            subprocess.run([sys.executable, os.path.abspath(__file__), verb], cwd=folder, env=environment, check=True)


if __name__ == "__main__":
    report(sys.argv[1]) if len(sys.argv) > 1 else main()
