"""The loop of a campaign: hands tasks whose needs are there to an executor, and counts what comes back."""

import dataclasses
import queue
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Protocol

from gonio.campaigns.perform import Unfinished, perform, refused
from gonio.campaigns.store import DONE, Record, Store
from gonio.campaigns.tasks import Task
from gonio.models.errors import GonioError, one_line

MOST_DEATHS = 3
"""Times that a task is handed out again after the executor gave it up, because the workers that did it died."""
PATIENCE = 1.0
"""Seconds between looks at the executor's health."""


class Executor(Protocol):
    """What does tasks: in this process, or in those of a cluster."""

    window: int
    """Tasks that it takes at a time."""

    def submit(self, function: Callable[[Task, str], Record], task: Task, folder: str) -> "Future[Record]":
        """Begins `function(task, folder)`."""
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

    def keep(self, again: bool) -> None:
        """Counts what is there already; with `again` what was refused is done once more."""
        there = self.store.keys()
        for key in self.tasks.keys() & there:
            record = self.store.record(key)
            if record is not None and not (again and record.status != DONE):
                self.tally.count(record, False)
                self.ended.add(key)
                self.failed |= {key} if record.status != DONE else set()
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
        outcomes: queue.SimpleQueue[Future[Record]] = queue.SimpleQueue()
        running: dict[Future[Record], str] = {}
        try:
            looked = time.monotonic()
            while self.ready or running:
                while self.ready and len(running) < executor.window:
                    self._begin(self.ready.popleft(), executor, running, outcomes)
                if running:
                    self._take(executor, running, outcomes)
                if time.monotonic() - looked > PATIENCE:
                    executor.require_alive()
                    looked = time.monotonic()
        finally:
            for future in running:
                future.cancel()

    def _begin(
        self,
        key: str,
        executor: Executor,
        running: "dict[Future[Record], str]",
        outcomes: "queue.SimpleQueue[Future[Record]]",
    ) -> None:
        task = self.tasks[key]
        lost = [self.tasks[need] for need in task.needs if need in self.failed]
        if lost:
            self._need_lost(task, lost[0])
            return
        future = executor.submit(perform, task, str(self.store.folder))
        running[future] = key
        future.add_done_callback(outcomes.put)

    def _need_lost(self, task: Task, need: Task) -> None:
        record = self.store.record(need.key)
        if record is None:  # it ended in a fault, and may be there next time
            self.tally.faults[task.name] = f"not begun, as '{need.name}' was not done"
            self._end(task, False)
            return
        record = refused(task, f"not begun, as its {need.kind} was refused: {record.error}")
        self.store.write_record(record)
        self._recorded(task, record)

    def _take(
        self, executor: Executor, running: "dict[Future[Record], str]", outcomes: "queue.SimpleQueue[Future[Record]]"
    ) -> None:
        try:
            future = outcomes.get(timeout=PATIENCE)
        except queue.Empty:
            return
        task = self.tasks[running.pop(future)]
        if future.cancelled():
            executor.require_alive()
            raise GonioError("the scheduler dropped a task; what is done is kept: run it again to go on")
        error = future.exception()
        if error is None:
            self._recorded(task, future.result())
        elif isinstance(error, Unfinished):
            raise GonioError(f"{str(error).rstrip('.')}; what is done is kept: run it again to go on")
        elif executor.died(error) and self.deaths[task.key] < MOST_DEATHS:
            executor.require_alive()
            self.deaths[task.key] += 1
            self.ready.append(task.key)
        else:
            self.tally.faults[task.name] = fault_of(error, executor.died(error))
            self._end(task, False)

    def _recorded(self, task: Task, record: Record) -> None:
        self.tally.count(record, True)
        self.over(task, record)
        self._end(task, record.status == DONE)

    def _end(self, task: Task, well: bool) -> None:
        self.ended.add(task.key)
        self.failed |= set() if well else {task.key}
        for key in reversed(self.dependents.pop(task.key, [])):
            self.waits[key].discard(task.key)
            if not self.waits[key]:
                self.ready.appendleft(key)  # a subject is finished before the next one is begun


def fault_of(error: BaseException, died: bool) -> str:
    """Why a task ended without a record, as a sentence."""
    if died:
        return "every worker that did it died; look whether it takes more memory than there is"
    first = (str(error).splitlines() or [""])[0]
    return one_line(f"a fault of gonio ({type(error).__name__}: {first}); please report it", 300)
