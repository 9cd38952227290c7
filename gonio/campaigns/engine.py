"""The loop of a campaign: hands tasks whose needs are there to an executor, and counts what comes back.

Short tasks go many in one message: what a message costs (some 15 ms of processor time) is small beside its work.
"""

import dataclasses
import queue
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Protocol

from gonio.campaigns.perform import Fault, Outcome, Unfinished, fault_of, perform_all, refused
from gonio.campaigns.store import DONE, Record, Store
from gonio.campaigns.tasks import Task
from gonio.models.errors import GonioError

MESSAGE_SECONDS = 1.0
"""Of work in one message: little enough that a lost one, or the last, costs nobody much."""
MOST_OF_A_MESSAGE = 256
"""Tasks in one message."""
MOST_DEATHS = 3
"""Times that a task is handed out again, alone, after the executor gave it up as the workers that did it died."""
DIED = "every worker that did it died; look whether it takes more memory than there is"
PATIENCE = 1.0
"""Seconds between looks at the executor's health."""


Message = Callable[[Sequence[Task], str], list[Outcome]]
Running = dict["Future[list[Outcome]]", list[str]]


class Executor(Protocol):
    """What does tasks: in this process, or in those of a cluster."""

    window: int
    """Messages that it takes at a time."""

    def submit(self, function: Message, tasks: Sequence[Task], folder: str) -> "Future[list[Outcome]]":
        """Begins `function(tasks, folder)`."""
        ...

    def require_alive(self) -> None:
        """Raises GonioError where nothing more will come from it."""
        ...

    def died(self, error: BaseException) -> bool:
        """Whether an outcome says that workers died, not that the task failed."""
        ...


@dataclasses.dataclass
class Tally:
    """What became of the tasks of a run, by kind."""

    done: Counter[str] = dataclasses.field(default_factory=Counter)
    kept: Counter[str] = dataclasses.field(default_factory=Counter)
    refused: Counter[str] = dataclasses.field(default_factory=Counter)
    bad: Counter[str] = dataclasses.field(default_factory=Counter)
    """Of those that are there: fits that failed, checks that failed, tables that do not keep a tolerance."""
    faults: dict[str, str] = dataclasses.field(default_factory=dict)
    """Tasks that ended in an error of the program or lost their workers, by name: not recorded, done next time."""

    def count(self, record: Record, new: bool) -> None:
        """Counts a record."""
        if record.status == DONE:
            (self.done if new else self.kept)[record.kind] += 1
            self.bad[record.kind] += not record.good
        else:
            self.refused[record.kind] += 1

    @property
    def all_good(self) -> bool:
        """Whether a user has nothing to look after."""
        return not (self.refused.total() or self.bad.total() or self.faults)


class Run:
    """One run over the tasks of a recipe; `over` is called with each record that is new."""

    def __init__(self, tasks: Sequence[Task], store: Store, over: Callable[[Task, Record], None]) -> None:
        self.tasks, self.store, self.over = {task.key: task for task in tasks}, store, over
        self.tally = Tally()
        self.ended: set[str] = set()
        self.failed: set[str] = set()
        self.dependents: dict[str, list[str]] = defaultdict(list)
        self.waits: dict[str, set[str]] = {}
        self.ready: deque[str] = deque()
        self.deaths: Counter[str] = Counter()
        self.handed: set[str] = set()
        """Keys of the tasks that are with the executor."""
        self.pace: dict[str, float] = {}
        """Seconds of the last tasks of each kind, the latest counted most."""

    def keep(self, again: bool) -> None:
        """Counts what is there already; with `again` what was refused is done once more."""
        there = self.store.keys()
        for key in self.tasks.keys() & there:
            record = self.store.record(key)
            if record is not None and again and record.status != DONE:
                self.store.forget(key)
            elif record is not None:
                self.tally.count(record, False)
                self._timed(record)
                self.ended.add(key)
                self.failed |= {key} if record.status != DONE else set()
        for task in self.tasks.values():
            if task.parts and task.key in self.ended and task.key not in self.failed:
                self.store.discard_parts(task.parts)
                self.ended.update(task.parts)
        for key, task in self.tasks.items():
            if key in self.ended:
                continue
            self.waits[key] = {k for k in (*task.needs, *task.after) if k in self.tasks and k not in self.ended}
            for need in self.waits[key]:
                self.dependents[need].append(key)
            if not self.waits[key]:
                self.ready.append(key)

    def work(self, executor: Executor) -> None:
        """Does what is not there yet. Raises GonioError where no more can be done now; what is there is kept."""
        outcomes: queue.SimpleQueue[Future[list[Outcome]]] = queue.SimpleQueue()
        running: Running = {}
        try:
            looked = time.monotonic()
            while self.ready or running:
                while self.ready and len(running) < executor.window:
                    keys = self._next(executor.window)
                    if keys:
                        future = executor.submit(perform_all, [self.tasks[k] for k in keys], str(self.store.folder))
                        running[future] = keys
                        future.add_done_callback(outcomes.put)
                if running:
                    self._take(executor, running, outcomes)
                if time.monotonic() - looked > PATIENCE:
                    executor.require_alive()
                    looked = time.monotonic()
        finally:
            for future in running:
                future.cancel()

    def _next(self, window: int) -> list[str]:
        """Keys of the next message: tasks whose needs are there or before them in it, as many as fill its time.

        The first task of a kind goes alone, as nobody knows how long it takes, and so does one whose workers died.
        Toward the end messages become small, so that all workers end together.
        """
        most = min(max(1, (len(self.tasks) - len(self.ended)) // (4 * window)), MOST_OF_A_MESSAGE)
        chosen: dict[str, None] = {}
        remaining = MESSAGE_SECONDS
        following: deque[str] = deque()
        while len(chosen) < most and (following or self.ready):
            queued = following or self.ready
            key = queued.popleft()
            task = self.tasks[key]
            lost = [self.tasks[need] for need in task.needs if need in self.failed]
            if lost:
                self._need_lost(task, lost[0])
                continue
            seconds = self.pace.get(task.kind, float("inf")) if not self.deaths[key] else float("inf")
            if chosen and seconds > remaining:
                if queued is self.ready:
                    self.ready.appendleft(key)
                break
            chosen[key], remaining = None, remaining - seconds
            following.extend(k for k in self.dependents.get(key, []) if self.waits[k] <= chosen.keys())
        self.handed |= chosen.keys()
        return list(chosen)

    def _need_lost(self, task: Task, need: Task) -> None:
        record = self.store.record(need.key)
        if record is None:  # it ended in a fault, and may be there next time
            self.tally.faults[task.name] = f"not begun, as '{need.name}' was not done"
            self._end(task, False)
            return
        record = refused(task, f"not begun, as its {need.kind} was refused: {record.error}")
        self.store.write_record(record)
        self._recorded(task, record)

    def _take(self, executor: Executor, running: Running, outcomes: "queue.SimpleQueue[Future[list[Outcome]]]") -> None:
        try:
            future = outcomes.get(timeout=PATIENCE)
        except queue.Empty:
            return
        keys = running.pop(future)
        if future.cancelled():
            executor.require_alive()
            raise GonioError("the scheduler dropped a task; what is done is kept: run it again to go on")
        error = future.exception()
        if isinstance(error, Unfinished):
            raise GonioError(f"{str(error).rstrip('.')}; what is done is kept: run it again to go on")
        if error is None:
            self._return(keys, future.result())
        elif executor.died(error):
            executor.require_alive()
            self._workers_died(keys)
        else:
            self._return(keys, [Fault(key, fault_of(error)) for key in keys[:1]])

    def _return(self, keys: Sequence[str], outcomes: Sequence[Outcome]) -> None:
        """Counts what became of a message's tasks; those that were not begun wait again for what they need."""
        for outcome in outcomes:
            task = self.tasks[outcome.key]
            if isinstance(outcome, Record):
                self._recorded(task, outcome)
            else:
                self.tally.faults[task.name] = outcome.why
                self._end(task, False)
        self.handed.difference_update(keys)
        self.ready.extendleft(key for key in reversed(keys) if key not in self.ended and not self.waits[key])

    def _workers_died(self, keys: Sequence[str]) -> None:
        """Hands out again what a lost message has no records of; its first task was the one that they died with."""
        records = [record for record in map(self.store.record, keys) if record is not None]
        done = {record.key for record in records}
        first = next((key for key in keys if key not in done), None)
        outcomes: list[Outcome] = [*records]
        if first is not None:
            self.deaths[first] += 1
            if self.deaths[first] > MOST_DEATHS:
                outcomes.append(Fault(first, DIED))
        self._return(keys, outcomes)

    def _recorded(self, task: Task, record: Record) -> None:
        self.tally.count(record, True)
        self._timed(record)
        self.over(task, record)
        if task.parts and record.status == DONE:
            self.store.discard_parts(task.parts)
        self._end(task, record.status == DONE)

    def _timed(self, record: Record) -> None:
        if record.status == DONE:
            self.pace[record.kind] = 0.7 * self.pace.get(record.kind, record.seconds) + 0.3 * record.seconds

    def _end(self, task: Task, well: bool) -> None:
        self.ended.add(task.key)
        self.failed |= set() if well else {task.key}
        for key in reversed(self.dependents.pop(task.key, [])):
            self.waits[key].discard(task.key)
            if not self.waits[key] and key not in self.handed:
                self.ready.appendleft(key)  # a subject is finished before the next one is begun
