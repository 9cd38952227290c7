"""Programs got ready beside other work: to trace and load them takes Python's time while a file is read and sorted."""

import contextlib
import threading
from collections.abc import Callable, Hashable

_known: set[Hashable] = set()
_running: list[threading.Thread] = []


def ahead(key: Hashable, job: Callable[[], None]) -> None:
    """Begin a job in a thread of its own; nothing where one of this key was begun before."""
    if key in _known:
        return
    _known.add(key)

    def run() -> None:
        # What goes wrong here goes wrong again where it is needed, and is said there.
        with contextlib.suppress(Exception):
            job()

    thread = threading.Thread(target=run, name="gonio-ahead")
    _running.append(thread)
    thread.start()


def finished() -> None:
    """Wait for what was begun, so that nothing is traced twice."""
    while _running:
        with contextlib.suppress(IndexError):
            _running.pop().join()
