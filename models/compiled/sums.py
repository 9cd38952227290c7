"""Sums over many elements of products of what a formula gives for each: one loop, which stores no more than is asked.

A formula gives rows of numbers for each element, such as a residual and its derivatives; normal equations are sums of
products of pairs of rows.
"""

import ctypes
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from gonio.models.compiled import emission, workers
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.machine import Code, Machine, compiled, compiled_as, machine
from gonio.models.compiled.program import translated
from gonio.models.compiled.sums_emission import adding_module, sums_module
from gonio.models.compiled.trace import Traced

PIECE = 1 << 13
"""Elements that a thread takes at a time, at most: their sums are added to the others' in the order of the pieces."""
BYTES = 8
"""Of a number: all are of double precision."""


class Rows:
    """A formula of rows; it is traced when a program of it has to be compiled."""

    def __init__(
        self,
        formula: Callable[..., Any],
        leaves: Sequence[Any],
        scalars: int,
        steps: Sequence[int],
        outer: int = 0,
        name: str = "",
        prepared: bool = False,
    ):
        """The rows `formula(leaves, *scalars, *of_outer, *elements)`, a value with one axis.

        Args:
            formula: a function that JAX traces.
            leaves: arrays on which the rows depend, or others of the same shapes and kinds.
            scalars: how many numbers the formula takes that are the same for all elements.
            steps: for each array of elements, how many numbers lie from one element to the next.
            outer: how many arrays there are of a loop around that over the elements.
            name: another process knows the formula by it: its kept programs are used without a trace. Only where
                there are no leaves.
            prepared: what depends on leaves and scalars alone is computed before the loops (`parameters`), which take
                no scalars then: for models of which this is much.

        Raises:
            Unsupported: the formula, or this processor, is none of those that programs are written for; of a formula
                with a name only its programs tell.
        """
        target = machine()
        if target is None:
            raise Unsupported("this processor")
        self.machine: Machine = target
        self.name, self._formula, self._leaves = name, formula, leaves
        self.prepared, self._count = scalars if prepared else 0, scalars + outer + len(steps)
        inner = 1 if outer else 0
        self.axes, self.lanes = 1 + inner, target.vector_bytes // BYTES
        self.inputs = (
            *[emission.Input("f64", ())] * (scalars - self.prepared), *[emission.Input("f64", (0,))] * outer,
            *(emission.Input("f64", (inner,), step) for step in steps),
        )  # fmt: skip
        if not name:
            self.nodes  # noqa: B018  (traced now)

    @functools.cached_property
    def trace(self) -> Traced:
        """The formula as a graph. Raises Unsupported."""
        shapes = [jax.ShapeDtypeStruct(np.shape(v), np.asarray(v).dtype) for v in self._leaves]
        trace = jax.make_jaxpr(self._formula)(shapes, *[jax.ShapeDtypeStruct((), np.float64)] * self._count)
        before = [*self._leaves, *np.ones(self.prepared)]
        return translated(trace, before, self._count - self.prepared, self.prepared > 0)

    def parameters(self, leaves: Sequence[np.ndarray], scalars: np.ndarray) -> np.ndarray:
        """What loops are given as parameters, of these leaves and scalars."""
        return self.trace.parameters([*leaves, *np.atleast_1d(scalars)[: self.prepared]])

    @functools.cached_property
    def nodes(self) -> list[int]:
        """Of the graph, the rows. Raises Unsupported."""
        nodes = [int(k) for k in self.trace.outputs.flat]
        if any(self.trace.graph.dtype(k) != "f64" for k in nodes):
            raise Unsupported("rows of another precision")
        return nodes

    def kernel(self, outputs: Sequence[int]) -> emission.Kernel:
        """What is to be written where these rows are stored. Raises Unsupported."""
        nodes, target = tuple(self.nodes[k] for k in outputs), self.machine
        return emission.Kernel(
            self.trace.graph, nodes, self.inputs, self.axes, self.lanes, target.estimates, target.flush
        )

    def compiled(self, kind: str, text: Callable[[], str]) -> Code:
        """The function of a text made of these rows; `kind` says which. Raises Unsupported."""
        return compiled_as(f"{self.name}\0{kind}\0{self.inputs}", text) if self.name else compiled(text())


class SumsProgram:
    """Compiled sums of products of rows; some rows are stored, too."""

    def __init__(self, rows: Rows, products: Sequence[tuple[int, int]], stored: Sequence[int] = ()):
        """Compile the sums of products of these pairs of rows, and what is stored of each element.

        Raises:
            Unsupported: LLVM does not take the code.
        """
        self.rows, self.products, self.stored = rows, len(products), len(stored)

        def text() -> str:
            pairs = [(rows.nodes[a], rows.nodes[b]) for a, b in products]
            return sums_module(rows.kernel(stored), pairs, rows.machine.attributes)

        self.code = rows.compiled(f"sums {[*products]} {[*stored]}", text)

    def __call__(self, parameters: np.ndarray, addresses: np.ndarray, count: int) -> np.ndarray | None:
        """Sums of shape (S, products), or None where the program does not know that they are right.

        Args:
            parameters: `rows.parameters` of the leaves; of rows that are prepared, for each of S (S, parameters).
            addresses: where the scalars (of rows that are prepared, none), the arrays of elements, and what is stored
                begin, for each of S (S, arrays); the arrays have to outlive the call.
            count: elements, a multiple of a vector's numbers.
        """
        vectors, lanes = count // self.rows.lanes, self.rows.lanes
        pieces = max(1, -(-count // PIECE))
        edges = [vectors * k // pieces * lanes for k in range(pieces + 1)]
        addresses = np.ascontiguousarray(addresses, np.uintp)
        parts, length = np.zeros((len(addresses), pieces, self.products, lanes)), np.array([count], np.int64)
        # Asked for once, and not of `ctypes.data`: that takes as long as a call.
        first_address, first_part, of_length = map(_address, (addresses, parts, length))
        of_all = parameters.ctypes.data if parameters.size else 0
        step, each, call = addresses.strides[0], parts.strides[1], self.code.call
        of_each = parameters.strides[0] if parameters.ndim > 1 else 0

        def work(first: int, last: int) -> int:
            status = 0
            for k in range(first, last):
                s, piece = divmod(k, pieces)
                places = of_all + of_each * s, first_address + step * s, first_part + each * k
                status |= call(*places, edges[piece], edges[piece + 1], of_length)
            return status

        total = len(addresses) * pieces
        # A few thousand elements are done before another thread wakes.
        status = work(0, total) if total * edges[1] <= 2 * PIECE else workers.share(work, total, 1)
        with np.errstate(all="ignore"):  # a model without a finite value has no finite sum
            return None if status else parts.sum(axis=(1, 3))


def _address(a: np.ndarray) -> int:
    """Where the numbers of an array begin that may be written to."""
    return ctypes.addressof(ctypes.c_char.from_buffer(a.data)) if a.nbytes else 0


class AddingProgram:
    """Compiled sums of rows over an outer loop, for each element of the inner one."""

    def __init__(self, rows: Rows, count: int):
        """Compile the sums of all rows, so many, which have an outer loop.

        Raises:
            Unsupported: LLVM does not take the code.
        """
        self.rows, self.count = rows, count
        every = range(count)
        self.code = rows.compiled("added", lambda: adding_module(rows.kernel(every), rows.machine.attributes))

    def __call__(self, parameters: np.ndarray, addresses: np.ndarray, sizes: tuple[int, int]) -> np.ndarray | None:
        """Sums of shape (rows, elements), or None where the program does not know that they are right.

        Args:
            parameters: `rows.trace.parameters` of the leaves.
            addresses: where the scalars, the arrays of the outer loop, and those of the elements begin (arrays,).
            sizes: of the outer loop, and elements, a multiple of a vector's numbers.
        """
        sums, lengths = np.zeros((self.count, sizes[1])), np.array(sizes, np.int64)
        places = parameters.ctypes.data, addresses.ctypes.data, sums.ctypes.data
        return None if self.code.call(*places, 0, sizes[0], lengths.ctypes.data) else sums
