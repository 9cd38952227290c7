"""Runs a command of gonio and writes where its processor time went: python where.py OUT.json VERB ...

Of the main thread: imports (executing modules), and what JAX reports of tracing, lowering, compiling and loading kept
programs; drawing is the layout and rendering of Matplotlib's figures. The rest computes, reads and writes.
"""

import importlib.abc
import json
import sys
import threading
import time
from importlib.machinery import PathFinder
from typing import Any

PHASES = {
    "/jax/core/compile/jaxpr_trace_duration": "tracing",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowering",
    "/jax/core/compile/backend_compile_duration": "compiling",
    "/jax/compilation_cache/cache_retrieval_time_sec": "loading",
}
spent = dict.fromkeys(("imports", "tracing", "lowering", "compiling", "loading", "drawing"), 0.0)
counts = {"programs": 0, "kept": 0}
stack: list[list[Any]] = []
"""Of phases that are going on, outermost first: the name, when it began or went on."""
MAIN = threading.main_thread()


def begin(phase: str) -> None:
    now = time.thread_time()
    if stack:
        spent[stack[-1][0]] += now - stack[-1][1]
    stack.append([phase, now])


def end() -> None:
    now = time.thread_time()
    phase, since = stack.pop()
    spent[phase] += now - since
    if stack:
        stack[-1][1] = now


def timed(phase: str, function: Any) -> Any:
    def call(*args: Any, **options: Any) -> Any:
        if threading.current_thread() is not MAIN:
            return function(*args, **options)
        begin(phase)
        try:
            return function(*args, **options)
        finally:
            end()

    return call


class Loader(importlib.abc.Loader):
    """Another loader, timed; then what is to be measured in the module is wrapped."""

    def __init__(self, loader: Any) -> None:
        self.loader = loader

    def __getattr__(self, name: str) -> Any:
        return getattr(self.loader, name)

    def create_module(self, spec: Any) -> Any:
        return timed("imports", self.loader.create_module)(spec)

    def exec_module(self, module: Any) -> None:
        timed("imports", self.loader.exec_module)(module)
        if module.__name__ == "matplotlib.figure":
            module.Figure.draw = timed("drawing", module.Figure.draw)
        if module.__name__ == "jax._src.dispatch":
            wrap_phases(module)
        if module.__name__ == "jax._src.compilation_cache":
            module.get_executable_and_time = timed("loading", counted("kept", module.get_executable_and_time))


def counted(name: str, function: Any) -> Any:
    def call(*args: Any, **options: Any) -> Any:
        counts[name] += 1
        return function(*args, **options)

    return call


def wrap_phases(module: Any) -> None:
    """The context in which JAX times a phase of a compilation times it here, too."""
    original = module.LogElapsedTimeContextManager

    class Timed(original):
        def __enter__(self) -> Any:
            self.phase = PHASES.get(self.event) if threading.current_thread() is MAIN else None
            if self.event.endswith("backend_compile_duration"):
                counts["programs"] += 1
            if self.phase:
                begin(self.phase)
            return super().__enter__()

        def __exit__(self, *why: Any) -> Any:
            if self.phase:
                end()
            return super().__exit__(*why)

    module.log_elapsed_time = module.LogElapsedTimeContextManager = Timed


class Finder(importlib.abc.MetaPathFinder):
    """Finds what the path finder finds, and has its loading timed."""

    def find_spec(self, name: str, path: Any, target: Any = None) -> Any:
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None and hasattr(spec.loader, "exec_module"):
            spec.loader = Loader(spec.loader)  # type: ignore[assignment]
        return spec


def main() -> None:
    out, sys.argv = sys.argv[1], ["gonio", *sys.argv[2:]]
    sys.path.pop(0)
    sys.meta_path.insert(0, Finder())
    from gonio.__main__ import main as run

    try:
        status = run()
    finally:
        spent["rest"] = time.thread_time() - sum(spent.values())
        spent["other threads"] = time.process_time() - time.thread_time()
        with open(out, "w") as file:
            json.dump(spent | counts, file)
    import os

    sys.stdout.flush()
    os._exit(status)


if __name__ == "__main__":
    main()
