"""A formula as a graph of scalar operations: each distinct operation once, what is constant computed beforehand.

Operations are named as in LLVM's language where it has them; `NUMPY` says what each of them does.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

FLOATS = ("f32", "f64")
DTYPES: dict[str, Any] = {"f32": np.float32, "f64": np.float64, "i32": np.int32, "i64": np.int64, "i1": np.bool_}
BITS = {"f32": "i32", "f64": "i64"}
"""The integers that the bits of a number of each precision are."""
COMPARISONS: dict[str, Any] = {
    "lt": np.less, "le": np.less_equal, "gt": np.greater, "ge": np.greater_equal, "eq": np.equal, "ne": np.not_equal
}  # fmt: skip
NUMPY: dict[str, Callable[..., Any]] = {
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide, "neg": np.negative, "abs": np.abs,
    "sqrt": np.sqrt, "floor": np.floor, "rint": np.rint, "and": np.bitwise_and, "or": np.bitwise_or,
    "xor": np.bitwise_xor, "shl": np.left_shift, "ashr": np.right_shift, **COMPARISONS,
    "add_exact": np.add, "sub_exact": np.subtract, "mul_exact": np.multiply,
    "select": lambda c, a, b: np.where(c, a, b), "fma": lambda a, b, c: a * b + c,
}  # fmt: skip
"""Operations; those called exact are never fused into a multiplication with addition. `fma` is rounded once when
compiled, twice here. Others: `input`, `parameter`, `constant`, `convert`, `bits` (reinterpretation), `lgamma`."""


class Unsupported(Exception):
    """The formula has something that is not translated: XLA evaluates it."""


class Node(NamedTuple):
    """One operation: its name, the kind of its result, the nodes that it reads, a number that belongs to it."""

    op: str
    dtype: str
    arguments: tuple[int, ...] = ()
    value: Any = None


class Graph:
    """Nodes in the order of their making, which is an order of evaluation."""

    def __init__(self, limit: int) -> None:
        self.nodes: list[Node] = []
        self.limit = limit
        self.required: list[int] = []
        """Conditions under which the translation is accurate: where one is false, XLA evaluates."""
        self._known: dict[Any, int] = {}

    def node(self, op: str, dtype: str, arguments: Sequence[int] = (), value: Any = None) -> int:
        made = Node(op, dtype, tuple(arguments), value)
        key = (op, dtype, made.arguments, np.asarray(value).tobytes() if op == "constant" else value)
        if key not in self._known:
            if len(self.nodes) >= self.limit:
                raise Unsupported(f"more than {self.limit} operations")
            self._known[key] = len(self.nodes)
            self.nodes.append(made)
        return self._known[key]

    def constant(self, value: Any, dtype: str) -> int:
        return self.node("constant", dtype, (), DTYPES[dtype](value))

    def dtype(self, node: int) -> str:
        return self.nodes[node].dtype

    def known(self, *nodes: int) -> bool:
        return all(self.nodes[n].op == "constant" for n in nodes)

    def value(self, node: int) -> Any:
        return self.nodes[node].value

    def apply(self, op: str, *arguments: int) -> int:
        """The result of an operation of `NUMPY`; the arguments are of one kind, but for the condition of `select`."""
        dtype = "i1" if op in COMPARISONS else self.dtype(arguments[-1])
        if self.known(*arguments) and op != "fma":
            with np.errstate(all="ignore"):
                return self.constant(NUMPY[op](*(self.value(a) for a in arguments)), dtype)
        same = self._simplified(op, arguments)
        return self.node(op, dtype, arguments) if same is None else same

    def _simplified(self, op: str, arguments: tuple[int, ...]) -> int | None:
        """An argument that equals the result, bit for bit."""
        if op in ("mul", "mul_exact"):
            for one, other in (arguments, arguments[::-1]):
                if self.known(one) and self.value(one) == 1:
                    return other
        if op == "div" and self.known(arguments[1]) and self.value(arguments[1]) == 1:
            return arguments[0]
        if op == "select":
            if self.known(arguments[0]):
                return arguments[1] if self.value(arguments[0]) else arguments[2]
            if arguments[1] == arguments[2]:
                return arguments[1]
        if op in ("and", "or"):
            for one, other in (arguments, arguments[::-1]):
                if self.known(one) and self.dtype(one) == "i1":
                    return other if bool(self.value(one)) == (op == "and") else one
        return None

    def convert(self, node: int, dtype: str) -> int:
        if self.dtype(node) == dtype:
            return node
        if self.known(node):
            with np.errstate(all="ignore"):
                return self.constant(self.value(node), dtype)
        if dtype == "i1":
            return self.apply("ne", node, self.constant(0, self.dtype(node)))
        if self.dtype(node) == "i1":
            return self.apply("select", node, self.constant(1, dtype), self.constant(0, dtype))
        return self.node("convert", dtype, (node,))

    def bits(self, node: int, dtype: str) -> int:
        """The same bits as another kind of number."""
        if self.known(node):
            return self.constant(np.asarray(self.value(node)).view(DTYPES[dtype])[()], dtype)
        return self.node("bits", dtype, (node,))

    def require(self, condition: int) -> None:
        if not (self.known(condition) and bool(self.value(condition))):
            self.required.append(condition)

    def maximum(self, a: int, b: int) -> int:
        return self._extreme("gt", a, b)

    def minimum(self, a: int, b: int) -> int:
        return self._extreme("lt", a, b)

    def _extreme(self, comparison: str, a: int, b: int) -> int:
        """The larger or the smaller of two, NaN where one of them is: one instruction where one is a known number."""
        if self.known(b) and not self.known(a):
            a, b = b, a
        best = self.apply("select", self.apply(comparison, a, b), a, b)
        if self.dtype(a) not in FLOATS or (self.known(a) and not math.isnan(self.value(a))):
            return best
        return self.apply("select", self.apply("ne", a, a), a, best)
