"""Tasks from their inputs to their files: run in this process or in a worker, and safe to be run again."""

import functools
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gonio import __version__
from gonio.campaigns.keys import digest_of
from gonio.campaigns.store import DONE, REFUSED, Record, Store
from gonio.campaigns.tasks import Task
from gonio.models.errors import GonioError, one_line

SETTLED = 10.0
"""Seconds after its last change from which a file's next one has another time of change, on any file system."""


class Unfinished(GonioError):
    """A task that could not be ended for a reason that is not its own: no room on the disk, a file that has changed."""


class Fault(NamedTuple):
    """A task that ended in an error of the program, with a sentence about it; nothing is recorded."""

    key: str
    why: str


Outcome = Record | Fault


def perform_all(tasks: Sequence[Task], folder: str) -> list[Outcome]:
    """Does tasks one after another; what has its record from a worker that died meanwhile is not done again.

    Args:
        tasks: in an order in which each comes behind what it needs.
        folder: of the campaign.

    Returns:
        What became of each, without those that need one of these tasks which has no result.

    Raises:
        Unfinished: one could not be ended for a reason that is not its own; those before it have their records.
    """
    store = Store(Path(folder))
    outcomes: list[Outcome] = []
    without_result: set[str] = set()
    for task in tasks:
        if without_result.intersection(task.needs):
            without_result.add(task.key)
            continue
        outcome = store.record(task.key) or _performed(task, folder)
        outcomes.append(outcome)
        if isinstance(outcome, Fault) or outcome.status != DONE:
            without_result.add(task.key)
    return outcomes


def _performed(task: Task, folder: str) -> Outcome:
    try:
        return perform(task, folder)
    except Unfinished:
        raise
    except Exception as error:
        return Fault(task.key, fault_of(error))


def fault_of(error: BaseException) -> str:
    """Why a task ended without a record, as a sentence."""
    first = (str(error).splitlines() or [""])[0]
    return one_line(f"a fault of gonio ({type(error).__name__}: {first}); please report it", 300)


def perform(task: Task, folder: str) -> Record:
    """Does a task, writes its result and its record into the folder, and returns the record.

    Raises:
        Unfinished: nothing is recorded, and the task is to be done again.
    """
    import jax

    store = Store(Path(folder))
    if not store.folder.is_dir():
        raise Unfinished(f"a worker does not see the folder {folder}; give one on a file system that all workers share")
    if task.version != __version__:
        raise Unfinished(f"a worker has gonio {__version__}, and the campaign {task.version}; install one version")
    began, worked = time.perf_counter(), time.process_time()
    _require_unchanged(task)
    with jax.enable_x64(True):
        record, write = _computed(task, store)
    try:
        file = None if write is None else store.write(task.kind, task.key, write)
        record["seconds"] = round(time.perf_counter() - began, 6)
        record["cpu_seconds"] = round(time.process_time() - worked, 6)
        done = Record(task.key, task.kind, labels=task.labels, file=file, **record)
        store.write_record(done)
    except GonioError as error:
        raise Unfinished(str(error)) from None
    return done


def refused(task: Task, reason: str) -> Record:
    """The record of a task that was not begun, as what it needs was refused."""
    return Record(task.key, task.kind, REFUSED, False, task.labels, {}, reason)


def _computed(task: Task, store: Store) -> tuple[dict[str, Any], Any]:
    from gonio.campaigns.steps import STEPS
    from gonio.campaigns.table_parts import LostPart

    try:
        product = STEPS[task.kind](task, store)
    except LostPart as error:
        raise Unfinished(str(error)) from None
    except GonioError as error:
        return {"status": REFUSED, "good": False, "row": {}, "error": str(error)}, None
    return {"status": DONE, "good": product.good, "row": product.row}, product.write


def _require_unchanged(task: Task) -> None:
    """Refuses files that are not those of the key any more."""
    for path, digest in task.digests.items():
        try:
            same = _digest(path) == digest
        except GonioError as error:
            raise Unfinished(str(error)) from None
        if not same:
            raise Unfinished(f"{path} has changed since the campaign began; run it again")


def _digest(path: str) -> str:
    """`digest_of` a file; that of a large one is not taken again in this process until the file is written again."""
    state = os.stat(path) if os.path.exists(path) else None
    if state is None or time.time() - state.st_mtime < SETTLED:
        return digest_of(path)
    return _kept_digest(path, state.st_size, state.st_mtime_ns, state.st_ino)


@functools.lru_cache(maxsize=64)
def _kept_digest(path: str, *state: int) -> str:
    return digest_of(path)
