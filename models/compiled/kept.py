"""Compiled programs on disk, in gonio's folder of the user's cache: each has a checksum, and is written whole."""

import contextlib
import hashlib
import os
import tempfile
import time
from pathlib import Path

MARK = b"gonio program 1\n"
"""What a file begins with; the number changes when what is kept does."""
UNUSED = 60 * 86400.0
"""Seconds after which a program that nothing has read goes."""


def folder() -> Path | None:
    """Where programs are kept: beside those of XLA, or GONIO_PROGRAMS_DIR; None where GONIO_NO_CACHE forbids it."""
    if os.environ.get("GONIO_NO_CACHE"):
        return None
    if chosen := os.environ.get("GONIO_PROGRAMS_DIR"):
        return Path(chosen)
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(home) / "gonio" / "programs"


def keeping() -> bool:
    """Whether programs may be known by the names of what they are made of: where JAX is told to keep its own."""
    return bool(os.environ.get("JAX_COMPILATION_CACHE_DIR") and not os.environ.get("GONIO_NO_CACHE"))


def key(*parts: str) -> str:
    """The name of a program: a digest of all that it depends on."""
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def read(name: str) -> bytes | None:
    """A kept program, or None where there is none, or not what was written."""
    place = folder()
    try:
        data = _own(place / name) if place else b""
    except OSError:
        return None
    with contextlib.suppress(OSError):
        os.utime(place / name if place else "")  # in use: it stays
    mark, digest, program = data[: len(MARK)], data[len(MARK) : len(MARK) + 32], data[len(MARK) + 32 :]
    return program if mark == MARK and _digest(name, program) == digest else None


def _own(path: Path) -> bytes:
    """What a file holds that nobody else can have written; nothing of another: programs are run."""
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        foreign = hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & 0o022)
        return b"" if foreign else file.read()


def write(name: str, program: bytes) -> None:
    """Keep a program, where the folder can be written to."""
    if (place := folder()) is None:
        return
    with contextlib.suppress(OSError):
        place.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.NamedTemporaryFile(dir=place, delete=False) as file:
            try:
                file.write(MARK + _digest(name, program) + program)
                file.close()
                os.replace(file.name, place / name)
            except OSError:
                os.unlink(file.name)
        if place not in searched:
            searched.add(place)
            _remove_unused(place)


searched: set[Path] = set()
"""Folders that this process has searched for unused programs: once each, a folder may hold thousands."""


def _remove_unused(place: Path) -> None:
    """Programs of other releases, or of a processor that is no more."""
    oldest = time.time() - UNUSED
    with os.scandir(place) as entries:
        unused = [e.path for e in entries if e.is_file() and e.stat().st_mtime < oldest]
    for path in unused:
        with contextlib.suppress(OSError):
            os.unlink(path)


def _digest(name: str, program: bytes) -> bytes:
    return hashlib.sha256(name.encode() + program).digest()
