"""Memory of compiled programs: each takes several of the memory mappings that the kernel gives to a process.

Where these are used up, XLA cannot go on and the process dies. That takes some thousand models of other structure.
"""

import functools
import time
from pathlib import Path

import jax

from gonio.models.kept_jit import forget_programs

MAPPINGS, LIMIT = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
SHARE = 0.5
"""Of the mappings, from which on programs are forgotten."""
PATIENCE = 10.0
"""Seconds between two looks: a look takes as long as a small fit, and no compiler makes so many programs meanwhile."""

_looked = [float("-inf")]


def free_programs(most: int | None = None) -> bool:
    """Forget all compiled programs where the process has too many memory mappings; they are made again when needed.

    Args:
        most: mappings that there may be, looked at now; by default half of the kernel's limit, at most every 10 s.

    Returns:
        Whether programs were forgotten; never on a system without such a limit.
    """
    if most is None:
        now = time.monotonic()
        if now < _looked[0] + PATIENCE:
            return False
        _looked[0], most = now, _most()
    if not 0 <= most < mappings():
        return False
    forget_programs()
    jax.clear_caches()
    return True


def mappings() -> int:
    """Memory mappings of this process; 0 where the system does not say."""
    try:
        with MAPPINGS.open("rb") as file:
            return sum(1 for _ in file)
    except OSError:
        return 0


@functools.cache
def _most() -> int:
    try:
        return int(SHARE * int(LIMIT.read_text()))
    except (OSError, ValueError):
        return -1
