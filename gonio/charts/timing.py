"""Time of calls on a noisy, shared machine: warm, in turns, and the median of processor seconds."""

import contextlib
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax

SHORTEST = 2e-3
"""Seconds that one sample of a clock lasts at least: shorter calls are repeated within it."""
LONG = 2.0
"""A first call of so many seconds is no matter of compiling alone: it is not repeated within a sample."""


class Timing(NamedTuple):
    """Seconds of a call: the median of warm ones, and of the first beyond it; and the result of the last."""

    median: float
    first_call: float
    result: Any


def clock() -> Callable[[], float]:
    """Processor seconds of all threads; on an accelerator, whose work no processor counts, seconds of the wall."""
    return time.process_time if jax.default_backend() == "cpu" else time.perf_counter


def unit() -> str:
    """The quantity that `clock` counts, in words."""
    return "processor time of all threads" if jax.default_backend() == "cpu" else "wall time"


def in_turns(calls: Sequence[Callable[[], object]], rounds: int = 7, seconds: float = 1.0) -> list[Timing]:
    """The timing of each call; they take turns, so that all run under the same load.

    Ends after `rounds`, or with the first round after which more than `seconds` a call were spent: three rounds at
    least, unless they take three times as much.
    """
    now = clock()
    results: list[Any] = [None] * len(calls)

    def timed(k: int, times: int) -> float:
        began = now()
        for _ in range(times):
            results[k] = jax.block_until_ready(calls[k]())
        return (now() - began) / times

    firsts = [timed(k, 1) for k in range(len(calls))]
    # Repetitions within a sample: from a second call where the first was short, or may have been compiling.
    again = [timed(k, 1) if first < LONG else first for k, first in enumerate(firsts)]
    times = [max(1, min(1000, round(SHORTEST / max(a, 1e-7)))) for a in again]
    samples, began, enough = [], now(), seconds * len(calls)
    for _ in range(rounds):
        samples.append([timed(k, n) for k, n in enumerate(times)])
        # A median of fewer than three is none, unless they take long.
        if now() - began > (enough if len(samples) >= 3 else 3 * enough):
            break
    medians = [statistics.median(of_call) for of_call in zip(*samples, strict=True)]
    return [Timing(m, max(f - m, 0.0), r) for m, f, r in zip(medians, firsts, results, strict=True)]


@contextlib.contextmanager
def precision(name: str) -> Iterator[None]:
    """JAX in float64 or float32 for as long as the block lasts; then again as the caller had it."""
    before = jax.config.read("jax_enable_x64")
    jax.config.update("jax_enable_x64", name == "float64")
    try:
        yield
    finally:
        jax.config.update("jax_enable_x64", before)
