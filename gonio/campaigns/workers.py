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

from gonio.environment import jax_environment

RESTARTS_IN = 0.1
"""Seconds until a worker that died is begun again."""


class Prepare(WorkerPlugin):
    """Lets workers keep compiled programs where the other processes of gonio find them."""

    name = "gonio-campaign"

    def setup(self, worker: Any) -> None:
        """Sets what the environment does not say yet."""
        for name, value in jax_environment().items():
            os.environ.setdefault(name, value)


async def serve(address: str, count: int) -> None:
    """Runs worker processes of one thread each for a scheduler, until they are told to end."""
    from distributed import Nanny

    options: dict[str, Any] = {"nthreads": 1, "memory_limit": 0, "dashboard": False, "death_timeout": 30}
    nannies = [Nanny(address, **options) for _ in range(count)]
    await asyncio.gather(*nannies)
    await asyncio.gather(*(nanny.finished() for nanny in nannies))


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


def main() -> None:
    """Begins workers by the command line."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    asyncio.run(serve(sys.argv[1], int(sys.argv[2])))


if __name__ == "__main__":
    main()
