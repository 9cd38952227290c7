"""JAX's trace of a formula as a graph: what depends on directions as nodes, what does not as steps to take before."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jax.extend import core

from gonio.models.compiled import known
from gonio.models.compiled.arrays import MOVES, contracted
from gonio.models.compiled.graph import DTYPES, Graph, Unsupported
from gonio.models.compiled.lowering import operation

LIMIT = 18_000
"""Operations of one formula: code beyond takes longer to write than it saves."""
KINDS = {np.dtype(d): name for name, d in DTYPES.items()}


class Known(NamedTuple):
    """A value that does not depend on directions: the number of a step's result, and what it is."""

    index: int
    aval: Any


class Nodes(NamedTuple):
    """An array of nodes of a graph."""

    ids: np.ndarray
    dtype: str


Value = np.ndarray | Known | Nodes
"""A constant, a value that parameters decide, or one that directions decide."""


class Step(NamedTuple):
    """An equation whose operands are known before the directions, and the numbers of its results."""

    equation: Any
    operands: tuple[np.ndarray | Known, ...]
    results: tuple[int, ...]


class Preparation(NamedTuple):
    """What is computed before the directions are known: `slots` says which element of which known value is each
    parameter of the graph."""

    steps: tuple[Step, ...]
    slots: tuple[tuple[Known, int], ...]

    def parameters(self, leaves: Sequence[np.ndarray]) -> np.ndarray:
        """The numbers that the graph calls parameters, float64, from the leaves of a model."""
        values: dict[int, np.ndarray] = dict(enumerate(leaves))
        for equation, operands, results in self.steps:
            taken = [values[o.index] if isinstance(o, Known) else o for o in operands]
            values.update(zip(results, known.equation(equation, taken), strict=True))
        return np.array([values[k.index].reshape(-1)[e] for k, e in self.slots], np.float64)


class Traced(NamedTuple):
    """A formula as a graph; `outputs` has the shape of the formula's value."""

    graph: Graph
    outputs: np.ndarray
    preparation: Preparation

    def parameters(self, leaves: Sequence[np.ndarray]) -> np.ndarray:
        """The numbers that the graph calls parameters, float64, from the leaves of a model."""
        return self.preparation.parameters(leaves)


def traced(closed: Any, inputs: int, sparing: bool = False) -> Traced:
    """The graph of a trace whose last operands, scalars, are the directions' components and whose others are known.

    Args:
        closed: the trace.
        inputs: how many operands the directions' components are.
        sparing: steps are those alone that calls which run as programs of their own need; of others that depend on no
            direction, the graph has the operations.

    Raises:
        Unsupported: something depends on the directions in a way that is not translated.
    """
    jaxpr, tracer = closed.jaxpr, _Tracer(sparing)
    leaves = len(jaxpr.invars) - inputs
    values: list[Value] = [tracer.known(v.aval) for v in jaxpr.invars[:leaves]]
    for k, v in enumerate(jaxpr.invars[leaves:]):
        dtype = kind(v.aval)
        values.append(Nodes(np.asarray(tracer.graph.node("input", dtype, (), k)), dtype))
    (result,) = tracer.program(closed, values)
    outputs = tracer.nodes(result)
    if outputs.dtype not in ("f32", "f64"):
        raise Unsupported(f"a value of {outputs.dtype}")
    return Traced(tracer.graph, outputs.ids, Preparation(tracer.needed_steps(), tuple(tracer.slots)))


def kind(aval: Any) -> str:
    """The graph's name of a kind of number."""
    name = KINDS.get(np.dtype(aval.dtype))
    if name is None:
        raise Unsupported(f"numbers of {aval.dtype}")
    return name


class _Tracer:
    def __init__(self, sparing: bool) -> None:
        self.graph = Graph(LIMIT)
        self.sparing = sparing
        self.steps: list[Step] = []
        self.producers: dict[int, Step] = {}
        self.slots: list[tuple[Known, int]] = []
        self.count = 0
        self._given: dict[int, Nodes] = {}

    def known(self, aval: Any) -> Known:
        self.count += 1
        return Known(self.count - 1, aval)

    def needed_steps(self) -> tuple[Step, ...]:
        """The steps that the graph's parameters are made by."""
        needed, steps = {k.index for k, _ in self.slots}, []
        for step in reversed(self.steps):
            if not needed.isdisjoint(step.results):
                steps.append(step)
                needed |= {o.index for o in step.operands if isinstance(o, Known)}
        return tuple(reversed(steps))

    def nodes(self, value: Value) -> Nodes:
        """A value as nodes: constants, or parameters."""
        if isinstance(value, Nodes):
            return value
        if isinstance(value, np.ndarray):
            dtype = kind(value)
            return Nodes(self._each(lambda x: self.graph.constant(x, dtype), value), dtype)
        if value.index not in self._given:
            step = self.producers.get(value.index)
            if self.sparing and step is not None and not known.is_whole(step.equation):
                made = self.equation(step.equation, [self.nodes(o) for o in step.operands])
                self._given.update(zip(step.results, map(self.nodes, made), strict=True))
            else:
                self._given[value.index] = self._parameters(value)
        return self._given[value.index]

    def _parameters(self, value: Known) -> Nodes:
        dtype = kind(value.aval)
        read = "f64" if dtype == "i1" else dtype
        ids = np.empty(value.aval.shape, int)
        for k in range(ids.size):
            self.slots.append((value, k))
            ids.flat[k] = self.graph.convert(self.graph.node("parameter", read, (), len(self.slots) - 1), dtype)
        return Nodes(ids, dtype)

    @staticmethod
    def _each(function: Callable[..., int], *arrays: np.ndarray) -> np.ndarray:
        same = np.broadcast_arrays(*arrays)
        ids = [function(*elements) for elements in zip(*(a.flat for a in same), strict=True)]
        return np.array(ids, int).reshape(same[0].shape)

    def program(self, closed: Any, values: Sequence[Value]) -> list[Value]:
        jaxpr = closed.jaxpr
        env: dict[Any, Value] = dict(zip(jaxpr.invars, values, strict=True))
        env |= {v: np.asarray(c) for v, c in zip(jaxpr.constvars, closed.consts, strict=True)}

        def value(atom: Any) -> Value:
            return known.literal(atom) if isinstance(atom, core.Literal) else env[atom]

        for equation in jaxpr.eqns:
            env.update(zip(equation.outvars, self.equation(equation, [value(a) for a in equation.invars]), strict=True))
        return [value(a) for a in jaxpr.outvars]

    def equation(self, equation: Any, values: Sequence[Value]) -> Sequence[Value]:
        name, parameters = equation.primitive.name, equation.params
        if all(isinstance(v, np.ndarray) for v in values):
            return known.equation(equation, values)  # pyright: ignore[reportArgumentType]
        whole = known.is_whole(equation) and not any(isinstance(v, Nodes) for v in values)
        if name in known.INLINED and not whole:
            return self.program(known.called(equation), values)
        if not any(isinstance(v, Nodes) for v in values):
            results = [self.known(v.aval) for v in equation.outvars]
            self.steps.append(Step(equation, tuple(values), tuple(r.index for r in results)))  # pyright: ignore[reportArgumentType]
            self.producers.update(dict.fromkeys(self.steps[-1].results, self.steps[-1]))
            return results
        if name == "scan":
            return self._scan(values, **parameters)
        operands = [self.nodes(v) for v in values]
        dtype = kind(equation.outvars[0].aval)
        if name in MOVES:
            return [Nodes(MOVES[name](*(o.ids for o in operands), **parameters), dtype)]
        return [Nodes(self._computed(name, parameters, [o.ids for o in operands], dtype), dtype)]

    def _computed(self, name: str, parameters: Any, ids: list[np.ndarray], dtype: str) -> np.ndarray:
        if name in ("reduce_sum", "reduce_max", "reduce_min", "reduce_prod", "reduce_and", "reduce_or"):
            return self._reduced(name, ids[0], parameters["axes"], dtype)
        if name == "dot_general":
            function = operation(self.graph, "mul", {}, dtype)
            return contracted(
                ids[0], ids[1], parameters["dimension_numbers"], function, lambda v: self._total("add", v, dtype)
            )
        return self._each(operation(self.graph, name, parameters, dtype), *ids)

    def _total(self, name: str, values: list[int], dtype: str) -> int:
        function, total = operation(self.graph, name, {}, dtype), values[0]
        for value in values[1:]:
            total = function(total, value)
        return total

    def _reduced(self, name: str, ids: np.ndarray, axes: tuple[int, ...], dtype: str) -> np.ndarray:
        one = {"sum": "add", "prod": "mul"}.get(name.split("_")[1], name.split("_")[1])
        free = [k for k in range(ids.ndim) if k not in axes]
        shape = [ids.shape[k] for k in free]
        rows = ids.transpose([*free, *axes]).reshape(int(np.prod(shape, dtype=int)), -1)
        return np.array([self._total(one, [int(i) for i in row], dtype) for row in rows], int).reshape(shape)

    def _scan(
        self, values: Sequence[Value], jaxpr: Any, length: int, num_consts: int, num_carry: int, reverse: bool, **_: Any
    ) -> list[Value]:
        constants, carry = list(values[:num_consts]), list(values[num_consts : num_consts + num_carry])
        rows = [self.nodes(v) for v in values[num_consts + num_carry :]]
        stacked: list[list[Nodes]] = [[] for _ in range(len(jaxpr.jaxpr.outvars) - num_carry)]
        for k in reversed(range(length)) if reverse else range(length):
            results = self.program(jaxpr, [*constants, *carry, *(Nodes(r.ids[k], r.dtype) for r in rows)])
            carry = results[:num_carry]
            for row, r in zip(stacked, results[num_carry:], strict=True):
                row.append(self.nodes(r))
        ordered = [row[::-1] if reverse else row for row in stacked]
        return [*carry, *(Nodes(np.stack([n.ids for n in row]), row[0].dtype) for row in ordered)]
