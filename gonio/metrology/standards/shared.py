"""What several calls about the same table compute once."""

import contextlib
import contextvars
from collections.abc import Callable, Hashable, Iterator
from typing import Any, TypeVar

from gonio.data.table import Table

T = TypeVar("T")

_memory: contextvars.ContextVar[dict[tuple[int, Hashable], tuple[Table, Any]] | None] = contextvars.ContextVar(
    "shared_integrals", default=None
)


@contextlib.contextmanager
def shared_integrals() -> Iterator[None]:
    """Meanwhile, integrals of the same table are found once; its readings must not be changed."""
    token = _memory.set({})
    try:
        yield
    finally:
        _memory.reset(token)


def once(table: Table, what: Hashable, make: Callable[[], T]) -> T:
    """What `make` gives; while integrals are shared, what it gave before for the same table and name."""
    memory = _memory.get()
    if memory is None:
        return make()
    key = (id(table), what)
    if key not in memory:
        # The table is held along with it: another one could have its identity else.
        memory[key] = (table, make())
    return memory[key][1]
