"""Old names of public options and attributes: they keep working, with one warning that names the new one."""

import sys
import warnings
from collections.abc import Mapping
from typing import Any


def renamed(old: str, new: str) -> str:
    """The new name of an option or attribute; one `DeprecationWarning` at the line outside gonio with the old one."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] == "gonio":
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


def renamed_attribute(old: str, new: str) -> property:
    """A property that warns and returns the attribute under its new name."""
    return property(lambda self: getattr(self, renamed(old, new)), doc=f"The old name of `{new}`.")
