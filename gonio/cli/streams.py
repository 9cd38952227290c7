"""``-`` for standard input where a file is read, and for standard output where text is written."""

import argparse
import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Generator
from pathlib import Path

from gonio.cli.arguments import words_of
from gonio.models.errors import GonioError
from gonio.text import printing

READ = ("against", "continued", "directions", "file", "files", "input", "instrument", "material", "scan", "subject",
        "subjects", "table")  # fmt: skip
"""Arguments that may be a file to read."""
NAME = "standard input"
LARGEST = 1 << 30
"""Bytes that are taken from standard input."""
STREAM = "-"


@contextlib.contextmanager
def standard_streams(args: argparse.Namespace, ending: Callable[[argparse.Namespace], str] | None) -> Generator[None]:
    """Puts files in the place of `-` while the block lasts: a copy of standard input, and one to be printed at its end.

    Args:
        args: of the verb.
        ending: of the name of a file that its output is text in; None where it cannot be printed. Verbs whose `output`
            is None, or who have none, print what they write themselves.

    Raises:
        GonioError: standard input is wanted twice, or is a terminal; an output that is no text.
    """
    reads = [name for name in READ for word in words_of(args, name) if word == STREAM]
    prints = getattr(args, "output", None) == STREAM
    if len(reads) > 1:
        raise GonioError(f"standard input can be read once, but {' and '.join(reads)} are '-'; name a file")
    if prints and getattr(args, "json", None) == STREAM:
        raise GonioError("the output and --json would both go to standard output; name a file for one of them")
    prints = prints and ending is not None
    if not reads and not prints:
        yield
        return
    with tempfile.TemporaryDirectory() as folder:
        try:
            if reads:
                _put(args, reads[0], _copied(Path(folder) / NAME))
            if prints and ending is not None:
                args.output = os.path.join(folder, f"standard output{ending(args)}")
            with printing(data=prints):
                yield
        except GonioError as error:
            raise GonioError(str(error).replace(f"{folder}{os.sep}", "")) from None
        if prints:
            _print(Path(args.output))


def refuse_stream(args: argparse.Namespace) -> str:
    """Of a verb whose output is no text. Raises GonioError."""
    raise GonioError(f"what '{args.verb}' writes is no text that can be printed; name a file in place of '-'")


def _put(args: argparse.Namespace, name: str, path: str) -> None:
    words = [path if word == STREAM else word for word in words_of(args, name)]
    setattr(args, name, words if isinstance(getattr(args, name), list) else path)


def _copied(path: Path) -> str:
    source = sys.stdin.buffer
    if source.isatty():
        raise GonioError("nothing comes on standard input; pipe a file into this command, or name it")
    with path.open("wb") as copy:
        while chunk := source.read(1 << 20):
            copy.write(chunk)
            if copy.tell() > LARGEST:
                raise GonioError(f"standard input gives more than {LARGEST >> 20} MiB; name a file")
    return str(path)


def _print(path: Path) -> None:
    sys.stdout.flush()
    with path.open("rb") as file:
        if b"\0" in file.read(1 << 16):
            raise GonioError("this format is no text that can be printed; name a file in place of '-'")
        file.seek(0)
        shutil.copyfileobj(file, sys.stdout.buffer)
    sys.stdout.flush()
