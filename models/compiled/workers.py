"""Threads that share one range of work, as many as the processors that this process may use."""

import collections
import functools
import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


@functools.cache
def count() -> int:
    """How many threads to use: one for each processor that is allowed, no more than NPROC says, as in XLA."""
    try:
        available = len(os.sched_getaffinity(0))
    except AttributeError:  # not on this system
        available = os.cpu_count() or 1
    stated = os.environ.get("NPROC", "")
    return min(available, int(stated)) if stated.isdecimal() and int(stated) > 0 else available


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count() - 1, thread_name_prefix="gonio")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork


def share(work: Callable[[int, int], int], total: int, step: int, grain: int = 1) -> int:
    """`work(start, stop)` over 0..total, in pieces of about a step, by all threads; the results' bits together.

    Pieces begin at multiples of `grain`, which is no more than a step.
    """
    pieces = max(1, total // step)
    edges = [*(total * k // pieces // grain * grain for k in range(pieces)), total]
    spans = collections.deque(itertools.pairwise(edges))

    def take() -> int:
        status = 0
        while True:
            try:
                span = spans.popleft()
            except IndexError:
                return status
            status |= work(*span)

    helpers = [_pool().submit(take) for _ in range(min(count(), pieces) - 1)]
    status = take()
    for helper in helpers:
        if not helper.cancel():  # all threads may be busy with other calls; this one is done then
            status |= helper.result()
    return status
