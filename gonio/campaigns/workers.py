"""The processes that do a campaign's tasks: ``python -m gonio.campaigns.workers tcp://... N`` begins N of them.

They end with the process that began them: at the end of their standard input. What JAX reads from the environment is
set before it is imported, in workers that others began too (`Prepare`).
"""

import asyncio
import os
import sys
import threading
from typing import Any

from distributed.diagnostics.plugin import WorkerPlugin

from gonio.environment import prepare_jax

ENDING = 6.0
"""Seconds in which workers have to end."""


class Prepare(WorkerPlugin):
    """Lets workers keep compiled programs where the other processes of gonio find them."""

    name = "gonio-campaign"

    def setup(self, worker: Any) -> None:
        """Sets what the environment does not say yet."""
        prepare_jax()


async def serve(address: str, count: int) -> None:
    """Runs worker processes of one thread each for a scheduler, until this process' standard input ends."""
    from dask.config import set as configured
    from distributed import Nanny

    from gonio.campaigns.executors import QUIET

    configured(QUIET)
    options: dict[str, Any] = {"nthreads": 1, "memory_limit": 0, "dashboard": False, "death_timeout": 30}
    nannies = [Nanny(address, **options) for _ in range(count)]
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    threading.Thread(target=_wait_for_parent, args=(loop, ended), daemon=True).start()
    await asyncio.gather(*nannies)
    finished = asyncio.gather(*(nanny.finished() for nanny in nannies))
    await asyncio.wait([finished, asyncio.ensure_future(ended.wait())], return_when=asyncio.FIRST_COMPLETED)
    await asyncio.gather(*(nanny.close(timeout=ENDING / 2) for nanny in nannies))


def _wait_for_parent(loop: asyncio.AbstractEventLoop, ended: asyncio.Event) -> None:
    sys.stdin.buffer.read()
    loop.call_soon_threadsafe(ended.set)
    threading.Timer(ENDING, os._exit, (0,)).start()


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1], int(sys.argv[2])))
