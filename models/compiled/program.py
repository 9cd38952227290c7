"""A formula compiled for this processor, called with arrays of directions."""

import math
import threading
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from gonio.models.compiled import emission, workers
from gonio.models.compiled.graph import DTYPES, Unsupported
from gonio.models.compiled.kept_loops import Loop, keep, taken_up
from gonio.models.compiled.machine import Code, Machine, compiled, machine, text_key
from gonio.models.compiled.masks import unguarded
from gonio.models.compiled.trace import Traced, traced

PIECE = 1 << 14
"""Pairs that a thread takes at a time: their arrays stay in its cache."""
ALIGNMENT = 64
"""Bytes: what JAX takes for an array without a copy begins at a multiple."""
PAST_CACHES = 4 << 20
"""Bytes of values from which on they go past the caches, which they fill: no line is read before it is written."""


class Program:
    """One formula, for any parameters and any number of directions."""

    def __init__(
        self,
        formula: Callable[..., Any],
        leaves: Sequence[Any],
        axes: Sequence[tuple[int, ...]],
        dtype: Any,
        name: str = "",
    ):
        """Trace and compile `formula(leaves, *components)` of scalar components of a kind.

        Args:
            formula: a function that JAX traces; its value is a number or has one axis, channels.
            leaves: the model's arrays, or others of the same shapes and kinds.
            axes: for each component, the axes of the loops that its array has.
            dtype: the components' kind of number.
            name: another process knows the formula and the kinds of its arrays by it, and takes up what is written now.

        Raises:
            Unsupported: the formula, or this processor, is none of those that programs are written for.
        """
        target = machine()
        if target is None:
            raise Unsupported("this processor")
        self.input_dtype = np.dtype(dtype)
        self.axes = 1 + max(a for each in axes for a in each)
        self.split = tuple(0 in each for each in axes)
        loop, self.code = taken_up(name) or self._written(formula, leaves, axes, target, name)
        self.preparation, self.channels = loop.preparation, loop.channels
        self.dtype = np.dtype(DTYPES[loop.kind])
        self.lanes = _lanes(target, loop.kind)
        self.local = threading.local()

    def _written(
        self,
        formula: Callable[..., Any],
        leaves: Sequence[Any],
        axes: Sequence[tuple[int, ...]],
        target: Machine,
        name: str,
    ) -> tuple[Loop, Code]:
        shapes = [jax.ShapeDtypeStruct(np.shape(v), jax.dtypes.canonicalize_dtype(v.dtype)) for v in leaves]
        scalars = [jax.ShapeDtypeStruct((), self.input_dtype)] * len(axes)
        try:
            trace = translated(jax.make_jaxpr(formula)(shapes, *scalars), leaves, len(axes))
            channels = trace.outputs.shape
            if len(channels) > 1:
                raise Unsupported(f"values of shape {channels}")
            outputs = tuple(unguarded(trace.graph, [int(k) for k in trace.outputs.flat]))
            kind = trace.graph.dtype(int(trace.outputs.flat[0]))
            inputs = tuple(emission.Input("f32" if self.input_dtype.itemsize == 4 else "f64", each) for each in axes)
            kernel = emission.Kernel(
                trace.graph, outputs, inputs, self.axes, _lanes(target, kind), target.estimates, target.flush
            )
            text = emission.module(kernel, target.attributes)
            loop, code = Loop(trace.preparation, channels, kind, text_key(text)), compiled(text)
        except Unsupported:
            keep(name, None, ())
            raise
        keep(name, loop, [np.asarray(v) for v in leaves])
        return loop, code

    def vector(self) -> "Vector":
        rows = np.empty((len(self.split), self.lanes), self.input_dtype)
        output, sizes = np.empty((self.lanes, *self.channels), self.dtype), np.array([self.lanes, True], np.int64)
        pointers = addresses(list(rows))
        places = (pointers.ctypes.data, output.ctypes.data, 0, self.lanes, sizes.ctypes.data)
        return Vector(rows, output, places, (pointers, sizes))

    def bound(self, leaves: Sequence[Any]) -> "Bound":
        """The program with these parameters."""
        parameters = self.preparation.parameters([np.asarray(v) for v in leaves])
        return Bound(self, parameters, parameters.ctypes.data)


class Bound(NamedTuple):
    """A program with its parameters."""

    program: Program
    parameters: np.ndarray
    address: int

    def __call__(self, arrays: Sequence[np.ndarray], sizes: tuple[int, ...]) -> np.ndarray | None:
        """Values of shape (*sizes, *channels), or None where the program does not know that they are right.

        Args:
            arrays: the components, each with the axes that it was declared with.
            sizes: of the loops; the last is `lanes` at least, or the loop is the only one.
        """
        p = self.program
        n = sizes[-1]
        if n <= p.lanes and len(sizes) == 1:
            return self._few(arrays, n)
        output = aligned_empty((*sizes, *p.channels), p.dtype)
        address, extents = output.ctypes.data, np.array([*sizes, output.nbytes < PAST_CACHES], np.int64)
        if all(a.flags.c_contiguous and a.dtype == p.input_dtype for a in arrays):
            pointers, lengths = addresses(arrays), extents.ctypes.data
            table = pointers.ctypes.data

            def work(start: int, stop: int) -> int:
                return p.code.call(self.address, table, address, start, stop, lengths)
        else:
            row = output.nbytes // sizes[0] if sizes[0] else 0

            def work(start: int, stop: int) -> int:
                parts = [a[start:stop] if cut else a for a, cut in zip(arrays, p.split, strict=True)]
                parts = [np.ascontiguousarray(a, p.input_dtype) for a in parts]
                pointers, place = addresses(parts), address + start * row
                return p.code.call(self.address, pointers.ctypes.data, place, 0, stop - start, extents.ctypes.data)

        inner = math.prod(sizes[1:])
        if sizes[0] * inner <= 2 * PIECE:
            status = work(0, sizes[0])
        else:
            # Of one loop each piece begins where a line of memory does.
            status = workers.share(work, sizes[0], max(PIECE // inner, 1), ALIGNMENT if len(sizes) == 1 else 1)
        return None if status else output

    def _few(self, arrays: Sequence[np.ndarray], n: int) -> np.ndarray | None:
        """What fits into one vector, whose other lanes repeat the first."""
        p = self.program
        if n == 0:
            return np.empty((0, *p.channels), p.dtype)
        vector: Vector | None = getattr(p.local, "vector", None)
        if vector is None:
            vector = p.local.vector = p.vector()
        if n == 1:  # all at once: that takes less time than the components one after another
            vector.rows[:] = np.array([[a.item()] for a in arrays])
        else:
            for row, a in zip(vector.rows, arrays, strict=True):
                if a.size == 1:
                    row[:] = a
                else:
                    row[:n], row[n:] = a, a[0]
        status = p.code.call(self.address, *vector.places)
        return None if status else vector.output[:n].copy()


class Vector(NamedTuple):
    """Memory of a thread for one vector of pairs: a row for each component, the values, and what a program is given."""

    rows: np.ndarray
    output: np.ndarray
    places: tuple[int, ...]
    kept: tuple[np.ndarray, ...]


def addresses(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Where the arrays begin; they have to outlive what reads them."""
    return np.array([a.ctypes.data for a in arrays], np.uintp)


def translated(trace: Any, leaves: Sequence[Any], inputs: int, sparing: bool = False) -> Traced:
    """The graph of a trace; what is in it in an unforeseen form, as a user's model may bring, is XLA's."""
    try:
        graph = traced(trace, inputs, sparing)
        graph.parameters([np.asarray(v) for v in leaves])
        return graph
    except (TypeError, ValueError, LookupError, NotImplementedError) as error:
        raise Unsupported(str(error)) from error


def _lanes(target: Machine, kind: str) -> int:
    """Numbers of a kind in one vector."""
    return target.vector_bytes // np.dtype(DTYPES[kind]).itemsize


def aligned_empty(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    size = math.prod(shape) * dtype.itemsize
    memory = np.empty(size + ALIGNMENT, np.uint8)
    first = -memory.ctypes.data % ALIGNMENT
    return memory[first : first + size].view(dtype).reshape(shape)
