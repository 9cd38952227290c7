"""Names of what a traced program depends on: equal in every process, or none where that cannot be known."""

import dataclasses
import enum
import functools
import hashlib
import importlib.util
import os
import platform
import sys
import types
from collections.abc import Container
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

ROOTS = ("gonio", "jax", "jaxlib", "equinox", "numpy", "builtins")
"""Packages whose code `surroundings` names; that of others may change unseen."""
SOURCES = (".py", ".npz", ".npy")
PACKAGES = ("jax", "jaxlib", "equinox", "lineax", "optimistix", "numpy")


class Unknown(Exception):
    """What something is cannot be named so that another process would know it again."""


def fingerprint(value: Any, traced: Container[int] = ()) -> str:
    """The name of a PyTree of parameters and of what goes with them.

    Args:
        value: numbers, texts, containers, named tuples, dataclasses (of gonio's and its libraries), functions by name.
        traced: identities of arrays of which only the kind counts; of others, all numbers do.

    Raises:
        Unknown: it holds something else, or is being traced.
    """
    if isinstance(value, Tracer):
        raise Unknown("a tracer")
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        kind = f"{value.dtype}{value.shape}{getattr(value, 'weak_type', False)}"
        return f"<{kind}>" if id(value) in traced else f"<{kind}{_digest(value)}>"
    if value is None or value is ... or type(value) in (bool, int, float, complex, str, bytes):
        return repr(value)
    if isinstance(value, enum.Enum):
        return f"{_name(type(value))}.{value.name}"
    if isinstance(value, type | types.FunctionType | types.BuiltinFunctionType | functools._lru_cache_wrapper):
        return _name(value)
    inner = functools.partial(fingerprint, traced=traced)
    if isinstance(value, tuple | list):
        return f"{_name(type(value))}({','.join(map(inner, value))})"
    if type(value) is dict:
        return "{" + ",".join(f"{inner(k)}:{inner(v)}" for k, v in value.items()) + "}"
    if isinstance(value, frozenset | set):
        return f"{_name(type(value))}({','.join(sorted(map(inner, value)))})"
    if dataclasses.is_dataclass(value):
        parts = (f"{f.name}={inner(getattr(value, f.name, None))}" for f in dataclasses.fields(value))
        return f"{_name(type(value))}({','.join(parts)})"
    raise Unknown(type(value).__name__)


def program_name(*parts: Any, traced: Container[int] = ()) -> str:
    """A name of a program that depends on these, and on gonio; empty where another process would not know it again.

    Args:
        parts: as in `fingerprint`.
        traced: identities of arrays of which only the kind counts.
    """
    try:
        names = (fingerprint(part, traced) for part in parts)
        return hashlib.sha256("\0".join([surroundings(), *names]).encode()).hexdigest()
    except Unknown:
        return ""


def _digest(array: Any) -> str:
    numbers = np.asarray(array)
    if numbers.dtype == object:
        raise Unknown("an array of objects")
    return hashlib.sha256(np.ascontiguousarray(numbers).tobytes()).hexdigest()


@functools.cache
def _name(thing: Any) -> str:
    """Where a class or function stands."""
    module, name = getattr(thing, "__module__", None) or "builtins", getattr(thing, "__qualname__", "<locals>")
    if module.partition(".")[0] not in ROOTS:
        raise Unknown(f"{module}.{name}")
    there: Any = importlib.import_module(module)
    for part in name.split("."):
        there = getattr(there, part, None)
    if there is not thing:
        raise Unknown(f"{module}.{name}")
    return f"{module}.{name}"


@functools.cache
def surroundings() -> str:
    """A digest of what every program depends on: gonio's files, versions, the processor, flags of XLA."""
    digest = hashlib.sha256()
    for package in ("gonio", "gonio.models", "gonio.data", "gonio.fitting"):
        spec = importlib.util.find_spec(package)
        for folder in (spec and spec.submodule_search_locations) or ():
            digest.update("\n".join(_files(folder)).encode())
    versions = []
    for name in PACKAGES:
        try:
            versions.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            versions.append(f"{name} -")
    environment = (f"{k}={os.environ.get(k)}" for k in ("XLA_FLAGS", "NPROC", "JAX_PLATFORMS"))
    digest.update("\n".join([*versions, sys.version, *environment, str(os.cpu_count()), _processor()]).encode())
    return digest.hexdigest()


def _files(folder: str) -> list[str]:
    """Names, lengths and times of the sources below a folder."""
    lines: list[str] = []
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda e: e.name):
            if entry.name.endswith(SOURCES):
                status = entry.stat()
                lines.append(f"{entry.name} {status.st_size} {status.st_mtime_ns}")
            elif entry.is_dir() and not entry.name.startswith(("__", ".")):
                lines += [entry.name, *_files(entry.path)]
    return lines


def _processor() -> str:
    """What the processor is and can do."""
    try:
        with open("/proc/cpuinfo") as file:
            lines = file.read().split("\n\n")[0].splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return "\n".join(line for line in lines if line.startswith(("model name", "flags", "Features", "CPU")))
