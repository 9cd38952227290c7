"""Libraries that a module needs once it computes: loaded at the first use, not with the module."""

import importlib
from types import ModuleType
from typing import Any


class _Deferred(ModuleType):
    def __getattr__(self, name: str) -> Any:
        value = getattr(importlib.import_module(self.__name__), name)
        setattr(self, name, value)
        return value


def deferred(name: str) -> ModuleType:
    """The module of this name, imported when something of it is first asked for."""
    return _Deferred(name)
