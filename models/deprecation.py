"""Old names of public options and attributes: they keep working, with one warning that names the new one."""

import dataclasses
import functools
import inspect
import warnings
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, ParamSpec, TypeVar, cast

from gonio.models.errors import nearest

Settings = TypeVar("Settings")
P = ParamSpec("P")
R = TypeVar("R")


def renamed(old: str, new: str) -> str:
    """The new name of an option or attribute; one `DeprecationWarning` at the line outside gonio with the old one."""
    level, frame = 1, inspect.currentframe()
    while frame and frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] == "gonio":
        level, frame = level + 1, frame.f_back
    warnings.warn(f"{old} is called {new} now; the old name goes in a later version", DeprecationWarning, level)
    return new


def renamed_options(options: Mapping[str, Any], new_names: Mapping[str, str]) -> dict[str, Any]:
    """Keyword arguments with old names replaced by new ones (`new_names`: old to new); a warning for each old one.

    Raises:
        TypeError: an option is given under both of its names.
    """
    both = [old for old, new in new_names.items() if old in options and new in options]
    if both:
        raise TypeError(f"{both[0]} is the old name of {new_names[both[0]]}; give one of them")
    return {renamed(key, new_names[key]) if key in new_names else key: value for key, value in options.items()}


def old_keywords(**new_names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator that lets a function take keywords by old names (old=new), with a warning for each."""

    def decorator(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def wrapper(*args: P.args, **options: P.kwargs) -> R:
            return cast(Callable[..., R], function)(*args, **renamed_options(options, new_names))

        return wrapper

    return decorator


def renamed_attribute(old: str, new: str) -> property:
    """A property that warns and returns the attribute under its new name."""
    return property(lambda self: getattr(self, renamed(old, new)), doc=f"The old name of `{new}`.")


def settings_of(
    kind: type[Settings], verb: str, options: Mapping[str, Any], new_names: Mapping[str, str] = MappingProxyType({})
) -> Settings:
    """The settings of a verb's keyword arguments: the dataclass `kind` of the options, with old names replaced.

    Raises:
        TypeError: an option that the verb does not have.
    """
    values = renamed_options(options, new_names)
    known = [f.name for f in dataclasses.fields(cast(Any, kind))]
    if unknown := [name for name in values if name not in known]:
        raise TypeError(f"{verb} has no option '{unknown[0]}'; {nearest(unknown[0], known)}")
    return kind(**values)
