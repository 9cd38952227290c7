"""What does the tasks of a campaign: this process, or Dask: processes of this machine, or of a scheduler's cluster."""

import contextlib
import logging
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from typing import Any

from gonio.campaigns.engine import Message
from gonio.campaigns.perform import Outcome, Unfinished
from gonio.campaigns.tasks import Task
from gonio.environment import jax_environment, one_thread
from gonio.models.errors import GonioError

AHEAD = 2
"""Messages that are handed out for each worker: the next one is there when a worker is free."""
JOINING = 60.0
"""Seconds in which a first worker has to come."""
MOST_STARTS = 10
"""Times that the processes of this machine are begun again, after all of them were ended."""
QUIET = {
    "distributed.comm.timeouts.connect": "10s",
    "distributed.worker.daemon": False,
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.scheduler.active-memory-manager.start": False,
}
"""Of Dask: what watches its own processes takes some percent of a processor, and nobody looks at it here."""
LOST = "what is done is kept: run it again to go on"


class ThisProcess:
    """Does one message at a time, here."""

    window = 1

    def submit(self, function: Message, tasks: Sequence[Task], folder: str) -> "Future[list[Outcome]]":
        """Does it, and returns when it is done."""
        future: Future[list[Outcome]] = Future()
        try:
            future.set_result(function(tasks, folder))
        except Exception as error:
            future.set_exception(error)
        return future

    def require_alive(self) -> None:
        """It is."""

    def died(self, error: BaseException) -> bool:
        """A task of this process that fails is its own fault."""
        return False


class DaskCluster:
    """Hands tasks to a Dask scheduler. `processes`: of this machine, that do them, begun again where they end."""

    def __init__(self, client: Any, processes: "LocalProcesses | None") -> None:
        self.client, self.processes = client, processes
        self.waiting_since: float | None = None
        self.window = AHEAD

    def submit(self, function: Message, tasks: Sequence[Task], folder: str) -> "Future[list[Outcome]]":
        """Hands it to the scheduler."""
        future: Future[list[Outcome]] = Future()
        remote = self.client.submit(function, tasks, folder, pure=False)
        future.set_running_or_notify_cancel()
        remote.add_done_callback(lambda done: _pass_on(done, future))
        return future

    def require_alive(self) -> None:
        """Takes as many messages as there are workers for. Raises GonioError where scheduler or workers are lost."""
        if self.client.status != "running":
            raise GonioError(f"the connection to the scheduler was lost; {LOST}")
        if self.processes is not None:
            self.processes.keep_alive()
        workers = self.client.scheduler_info(n_workers=-1)["workers"]
        threads = sum(int(w["nthreads"]) for w in workers.values())
        if threads:
            self.window, self.waiting_since = AHEAD * threads, None
            return
        self.waiting_since = self.waiting_since or time.monotonic()
        if time.monotonic() - self.waiting_since > JOINING:
            raise GonioError(f"no worker has come to the scheduler in {JOINING:g} s; start some. What is done is kept")

    def died(self, error: BaseException) -> bool:
        """Whether the scheduler gave a task up because of the workers that died with it."""
        return isinstance(error, ResultLost) or type(error).__name__ == "KilledWorker"


class ResultLost(Exception):
    """What came back was lost with its worker; its files are there."""


def _pass_on(done: Any, future: "Future[list[Outcome]]") -> None:
    if done.status == "finished":
        try:
            future.set_result(done.result())
        except Exception as error:
            future.set_exception(ResultLost(str(error)))
    elif done.status == "error":
        future.set_exception(done.exception())
    else:
        future.set_exception(Unfinished("the scheduler lost what it was handed"))


class LocalProcesses:
    """Worker processes of this machine, begun by one that ends with this one, however that ends."""

    def __init__(self, address: str, count: int) -> None:
        self.address, self.count, self.starts = address, count, 0
        self.process: subprocess.Popen[bytes] | None = None
        self.keep_alive()

    def keep_alive(self) -> None:
        """Begins them again where they have ended. Raises GonioError where that happens again and again."""
        if self.process is not None and self.process.poll() is None:
            return
        if self.starts > MOST_STARTS:
            raise GonioError(f"the workers of this machine end whenever they are begun; {LOST}")
        self.starts += 1
        command = [sys.executable, "-m", "gonio.campaigns.workers", self.address, str(self.count)]
        environment = jax_environment() | dict(os.environ) | one_thread()
        shown = None if os.environ.get("GONIO_DEBUG") else subprocess.DEVNULL
        # Apart from the terminal's signals: this process ends them.
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=shown, stderr=shown, env=environment, start_new_session=True
        )

    def end(self) -> None:
        """Ends them: they read the end of their standard input."""
        process, self.process = self.process, None
        if process is None:
            return
        if process.stdin is not None:
            process.stdin.close()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def dask_cluster(workers: int, scheduler: str | None) -> Iterator[DaskCluster]:
    """Dask's cluster behind a scheduler's address, or one of this machine with so many processes.

    Raises:
        GonioError: Dask is not installed, or no scheduler answers there.
    """
    try:
        from dask.config import set as configured
        from distributed import Client, LocalCluster
    except ImportError:
        raise GonioError(
            "a campaign of several processes needs Dask; install it by pip install 'gonio[campaign]', or give "
            "workers 0 to work in this process alone"
        ) from None
    from gonio.campaigns.workers import Prepare

    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)
    with configured(QUIET), contextlib.ExitStack() as stack:
        if scheduler is None:
            options: dict[str, Any] = {
                "n_workers": 0,
                "processes": True,
                "dashboard_address": "127.0.0.1:0",
                "scheduler_kwargs": {"dashboard": False},
                "protocol": "tcp",
            }
            cluster: Any = stack.enter_context(
                LocalCluster(host="127.0.0.1", scheduler_port=0, silence_logs=100, **options)
            )
            address = str(cluster.scheduler_address)
        else:
            address = scheduler
        try:
            client = stack.enter_context(Client(address, timeout=30, set_as_default=False))
        except (OSError, ValueError, TypeError) as error:
            raise GonioError(
                f"no scheduler answers at {address} ({_first_line(error)}); start one: dask scheduler"
            ) from None
        client.register_plugin(Prepare())
        processes = LocalProcesses(address, workers) if scheduler is None else None
        if processes is not None:
            stack.callback(processes.end)
        executor = DaskCluster(client, processes)
        executor.require_alive()
        yield executor


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
