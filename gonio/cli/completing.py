"""What the word under the cursor may become: verbs, options, files, and names of materials, models and scenes."""

import argparse
import os
from collections.abc import Callable, Collection
from pathlib import Path

from gonio.models.names import BELOW, WHERE

MAY_BE_MATERIALS = ("material", "subject", "subjects", "against", "input")
MAY_BE_MODELS = ("model", "models", "name")
"""Arguments, by their destinations."""


def complete(verbs: Collection[str], parser: Callable[[str | None], argparse.ArgumentParser]) -> None:
    """Prints what the word under the cursor may become, and ends the process; JAX is not loaded for it.

    Args:
        verbs: the names of all verbs.
        parser: gives the program's parser, with the arguments of the verb that is named.
    """
    import argcomplete

    verb = next((w for w in os.environ.get("COMP_LINE", "").split()[1:] if w in verbs), None)
    top = parser(verb)
    _complete_names(top, verb)
    argcomplete.autocomplete(top, always_complete_options="long")


def _complete_names(top: argparse.ArgumentParser, verb: str | None) -> None:
    """Gives the arguments of a verb their completers: names of materials, models and scenes beside files."""
    import gonio.data

    data = Path(gonio.data.__path__[0])
    materials, scenes = (sorted(p.stem for p in (data / kind).glob("*.toml")) for kind in ("materials", "scenes"))
    words = {name: [*WHERE, *BELOW] for name in MAY_BE_MODELS} | dict.fromkeys(MAY_BE_MATERIALS, materials)
    words |= {"scene": scenes} | ({"name": materials} if verb == "materials" else {})
    pending = [top]
    for parser in pending:
        for action in parser._actions:  # pyright: ignore[reportPrivateUsage] -- there is no public way to them
            if action.dest == "verb" and action.choices is not None and verb is not None:
                pending.append(dict(action.choices)[verb])  # pyright: ignore -- a dictionary of parsers
            elif action.dest in words and not action.choices:
                files = verb not in ("materials", "models")
                setattr(action, "completer", _NamesAndFiles(words[action.dest], files))  # noqa: B010 -- argcomplete's


class _NamesAndFiles:
    def __init__(self, names: list[str], files: bool) -> None:
        self.names, self.files = names, files

    def __call__(self, prefix: str, **_: object) -> list[str]:
        from argcomplete.completers import FilesCompleter

        files = list(FilesCompleter()(prefix)) if self.files else []
        return [*(n for n in self.names if n.startswith(prefix)), *files]
