"""Programs got ready beside other work: to trace and load them takes Python's time while a file is read and sorted."""

import contextlib
import ctypes
import threading
from collections.abc import Callable, Hashable

import jax.numpy as jnp

_known: set[Hashable] = set()
_running: list[threading.Thread] = []


def ahead(key: Hashable, job: Callable[[], object]) -> None:
    """Begin a job in a thread of its own; nothing where one of this key was begun before."""
    precision = jnp.result_type(float)
    if (key, precision) in _known:
        return
    _known.add((key, precision))

    def run() -> None:
        # A precision that only the caller's thread has is not known here. What goes wrong goes wrong again where it is
        # needed, and is said there.
        with contextlib.suppress(Exception):
            if jnp.result_type(float) == precision:
                job()

    thread = threading.Thread(target=run, name="gonio-ahead")
    _running.append(thread)
    thread.start()


def finished() -> None:
    """Wait for what was begun, so that nothing is traced twice."""
    waited = bool(_running)
    while _running:
        with contextlib.suppress(IndexError):
            _running.pop().join()
    if waited:
        _give_back()


def _give_back() -> None:
    """Return what compilers have freed to the system: glibc keeps it, more than a hundred megabytes."""
    with contextlib.suppress(OSError, AttributeError, TypeError):  # no glibc
        ctypes.CDLL(None).malloc_trim(0)
