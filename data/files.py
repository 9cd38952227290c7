"""Files at the edge: what a user may get wrong about a path or a TOML file, each in one sentence."""

import contextlib
import errno
import os
import re
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from gonio.data.serialise import deepest
from gonio.models.errors import GonioError, nearest, printable

TOML_FORMAT = 1
TomlKeys = Mapping[str, tuple[type, str]]
"""The types of the entries of a TOML table by their keys, and what to call them in a sentence."""
T = TypeVar("T")
UNFINISHED = ".part"
"""The ending of a table that is being written block by block."""
MOST_PARTS = 32
"""Parts of a dotted key, at most: the parser's memory grows as the square of their number. Brackets likewise."""
LARGEST_TEXT = 1 << 27
"""Bytes of a text that is parsed: its lines and numbers take ten times as much."""
LARGEST_WHOLE = 1 << 30
"""Bytes of a file that is read as a whole."""


def input_size(path: str | os.PathLike[str]) -> int:
    """Bytes of a file to be read. Raises GonioError where it is absent, a folder, empty or not readable."""
    path = Path(path)
    if "\0" in str(path):
        raise GonioError(f"{path} is no name of a file; leave out the null character")
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):  # a pipe would be waited for, a device has no end
            kind = "folder" if stat.S_ISDIR(mode) else "pipe, socket or device"
            raise GonioError(f"{path} is a {kind}; expected a file")
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
    except FileNotFoundError:
        raise GonioError(f"{path} does not exist; check the name and the folder") from None
    except OSError as error:
        raise GonioError(f"{path} cannot be read ({error.strerror}); check its permissions") from None
    if size == 0:
        raise GonioError(f"{path} is empty; expected a file with measured values")
    return size


def whole_size(path: str | os.PathLike[str]) -> int:
    """`input_size` of a file that is read as a whole. Raises GonioError beyond `LARGEST_WHOLE` too."""
    if (size := input_size(path)) > LARGEST_WHOLE:
        raise GonioError(f"{path} has {size >> 20} MiB; such a file has at most {LARGEST_WHOLE >> 20}")
    return size


def stem(path: str | os.PathLike[str]) -> str:
    """The name of a file without folder and ending: what a table is called that has no name in its file."""
    return printable(os.path.splitext(os.path.basename(path))[0])


def refuse_existing(path: str | os.PathLike[str], force: bool) -> None:
    """Raises GonioError where `path` is a folder, or exists and is not to be replaced."""
    path = Path(path)
    if path.is_dir():
        raise GonioError(f"{path} is a folder; name a file to write")
    if path.exists() and not path.is_file():
        raise GonioError(f"{path} is a device, not a file; name a file to write")
    if path.exists() and not force:
        raise GonioError(f"{path} exists already; give another name, or --force to replace it")


def refuse_outputs(
    outputs: Iterable[str | os.PathLike[str] | None],
    inputs: Iterable[str | os.PathLike[str] | None],
    force: bool,
    makes_folder: bool = False,
) -> None:
    """Refuses outputs that exist (unless `force`), that are inputs, or that are one file, before any work.

    The folder of each must be there, and be writable, unless the command `makes_folder`. None and "-" are no
    files; an input may be ``FILE:NAME``, a part of a file. Links are followed.
    """
    given = [str(i) for i in inputs if i is not None]
    given += [i.rsplit(":", 1)[0] for i in given if ":" in i]
    known: dict[str, str] = {os.path.realpath(i): i for i in given if os.path.exists(i)}
    written: dict[str, str] = {}
    for path in (str(o) for o in outputs if o is not None and str(o) != "-"):
        refuse_existing(path, force)
        real = os.path.realpath(path)
        for name in (path, f"{path}{UNFINISHED}"):
            if os.path.exists(name) and any(os.path.samefile(name, i) for i in known):
                raise GonioError(f"{name} is an input of this command; name another output")
        if real in written:
            raise GonioError(f"{path} and {written[real]} are one file; give each output a name of its own")
        if not makes_folder:
            require_writable_folder(path)
        written[real] = path


def require_writable_folder(path: str | os.PathLike[str]) -> None:
    """Raises GonioError, as `output_errors` does, where the folder of `path` is not there or cannot be written."""
    with output_errors(path):
        if not os.access(Path(path).absolute().parent, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


@contextlib.contextmanager
def output_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turns the OSErrors of writing `path` into a GonioError of one sentence."""
    try:
        yield
    except OSError as error:
        folder = Path(path).absolute().parent
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG) or "No space left" in str(error)
        if full:
            message = f"no room on the disk for {path}; free some, or write to another folder"
        elif not folder.is_dir():
            message = f"the folder {folder} of {path} does not exist; make it first"
        else:
            # HDF5 puts a paragraph of its insides where others say why.
            why = os.strerror(error.errno) if error.errno else "refused"
            message = f"{path} cannot be written ({why}); choose a folder you may write to"
        raise GonioError(message) from None


@contextlib.contextmanager
def new_file(path: str | os.PathLike[str], force: bool = False) -> Iterator[Path]:
    """A temporary path beside `path` to write to; it takes its place, whole and on disk, when the block ends
    well.

    When the block fails nothing is left behind. Raises GonioError as `refuse_existing` and `output_errors`
    do.
    """
    path = Path(path)
    refuse_existing(path, force)
    with output_errors(path):
        temporary = temporary_beside(path)
        try:
            yield temporary
            publish(temporary, path)
        except BaseException as error:
            temporary.unlink(missing_ok=True)
            if isinstance(error, GonioError) and str(temporary) in str(error):  # what was written cannot be read again
                text = str(error).replace(f"for {temporary};", f"for {path};")
                raise GonioError(text.replace(str(temporary), f"{path}, which is not written:")) from error
            raise


def temporary_beside(path: Path) -> Path:
    """A new empty file in the folder of `path`, which its name begins with; a name of any length finds room."""
    start = os.fsdecode(os.fsencode(path.name)[:200])
    handle, name = tempfile.mkstemp(dir=path.absolute().parent, prefix=f".{start}.", suffix=".tmp")
    os.close(handle)
    return Path(name)


def publish(temporary: str | os.PathLike[str], path: str | os.PathLike[str], durable: bool = True) -> None:
    """Puts a finished file in its place: what it holds is on disk before its name is, unless it may be lost."""
    mask = os.umask(0)
    os.umask(mask)
    os.chmod(temporary, 0o666 & ~mask)
    if durable:
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())
    os.replace(temporary, path)


def read_toml(
    path: str | os.PathLike[str], kind: str, largest: int, keys: TomlKeys, make: Callable[[dict[str, Any]], T]
) -> T:
    """What `make` makes of a TOML file that begins with ``gonio_<kind> = 1``.

    Args:
        path: the file.
        kind: what it holds, such as "scene".
        largest: bytes, at most.
        keys: those that it may have besides the first.
        make: from the content; a GonioError of it gets the name of the file.

    Raises:
        GonioError: in one sentence that names the file, for anything else.
    """
    first = f"gonio_{kind}"
    if (size := input_size(path)) > largest:
        raise GonioError(f"{path} has {size} bytes; a {kind} file has at most {largest}")
    try:
        text = Path(path).read_bytes().decode()
        if _deepest_key(text) > MOST_PARTS:
            raise ValueError(f"a key has more than {MOST_PARTS} parts")
        if deepest(text) > MOST_PARTS:
            raise ValueError(f"more than {MOST_PARTS} brackets stand inside one another")
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        reason = reason.partition(" for integer string")[0]  # Python's own advice is for programmers
        raise GonioError(f"{path} is not a TOML file ({reason}); expected a {kind}") from None
    version = data.pop(first, None)
    if type(version) is not int:
        raise GonioError(f"{path}: it has no integer {first}; such a file begins with '{first} = {TOML_FORMAT}'")
    if version != TOML_FORMAT:
        update = f"this gonio reads format {TOML_FORMAT}, so update gonio"
        raise GonioError(f"{path}: {kind} format {version} is not known; {update}")
    try:
        check_keys(data, keys)
        return make(data)
    except GonioError as error:
        raise GonioError(f"{path}: {error}") from None


def _deepest_key(text: str) -> int:
    """The largest number of dotted parts before an equals sign or in a header, in time linear in the text."""
    deepest = 0
    for piece in re.split(r"[=\n]", text):
        parts = re.split(r"[{,\[\]]", piece.rstrip(" \t]"))[-1].split(".")
        if len(parts) > deepest and all(part.strip() and not re.search(r"\s", part.strip()) for part in parts):
            deepest = len(parts)
    return deepest


def check_keys(given: Mapping[str, Any], keys: TomlKeys, where: str = "") -> None:
    """Raises GonioError, beginning with `where`, for a key that is not known (with the nearest), and a wrong type."""
    for key, value in given.items():
        if key not in keys:
            raise GonioError(f"{where}unknown key '{key}'; {nearest(key, keys)}")
        kind, expected = keys[key]
        if not isinstance(value, kind):
            raise GonioError(f"{where}{key} is {type(value).__name__}; expected {expected}")
