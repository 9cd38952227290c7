"""Extension modules of SciPy without their packages, which load much that goes unused.

To import `scipy.special` takes a quarter of a second, as long as a check of a table: nearly all of it loads NumPy's
test tools and interfaces of other array libraries. The functions themselves are in one extension module.
"""

import contextlib
import importlib
import os
import sys
import threading
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any


class _NotKept(ImportError):
    """A package was imported for its extension module alone, and is forgotten."""


class _Alone(MetaPathFinder, Loader):
    """Imports an extension module in place of its package's code, for the thread that made this.

    The import system holds its lock on the package meanwhile: other threads wait, and then import all of it.
    """

    def __init__(self, package: str, module: str) -> None:
        self.package, self.module, self.thread = package, module, threading.get_ident()
        self.made: ModuleType | None = None

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self.package or threading.get_ident() != self.thread:
            return None
        spec = PathFinder.find_spec(fullname, path)
        if spec is not None:
            spec.loader = self
        return spec

    def create_module(self, spec: ModuleSpec) -> None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        self.made = importlib.import_module(f"{self.package}.{self.module}")
        raise _NotKept


def parts(package: str, module: str, *names: str) -> list[Any]:
    """What the extension module of a package calls by these names.

    It is taken from the whole package where that is loaded already, is to serve other arrays than NumPy's, or does not
    have them in that module.
    """
    if package not in sys.modules and not os.environ.get("SCIPY_ARRAY_API"):
        alone = _Alone(package, module)
        sys.meta_path.insert(0, alone)
        try:
            with contextlib.suppress(ImportError):
                importlib.import_module(package)
        finally:
            sys.meta_path.remove(alone)
        if all(hasattr(alone.made, name) for name in names):
            return [getattr(alone.made, name) for name in names]
    whole = importlib.import_module(package)
    return [getattr(whole, name) for name in names]
