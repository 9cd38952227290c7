"""Divisions and roots from the estimates of AVX-512 and Newton's steps, beside those of the divider.

The divider of such a processor takes 16 to 24 cycles for a vector, in which its other units do 30 to 50 operations.
So work is shared: 1/√x is always refined from its estimate, roots and quotients are while the divider has more to do
than the rest. Quotients and roots are rounded as the divider rounds but for rare last places; 1/√x is off by one.
"""

from collections.abc import Callable

from gonio.models.compiled.graph import Graph

DIVIDER = {("div", "f64"): 16, ("div", "f32"): 14, ("sqrt", "f64"): 24, ("sqrt", "f32"): 19}
"""Cycles of one vector."""
REFINED = {("div", "f64"): 7, ("div", "f32"): 5, ("sqrt", "f64"): 7, ("sqrt", "f32"): 6}
"""Cycles of the other units for the same."""
PER_CYCLE = 2
"""Operations on whole vectors in a cycle."""
TYPES = {"f64": ("double", "pd", "i8", 8), "f32": ("float", "ps", "i16", 16)}


def refined(graph: Graph, nodes: list[int]) -> tuple[set[int], set[int]]:
    """Of the nodes of an inner loop, what to compute from estimates: (quotients and roots, 1/√x as one operation)."""
    slow = [k for k in nodes if (graph.nodes[k].op, graph.dtype(k)) in DIVIDER]
    inverse = {k for k in slow if graph.nodes[k].op == "div" and graph.nodes[graph.nodes[k].arguments[1]].op == "sqrt"}
    inverse = {k for k in inverse if graph.nodes[k].arguments[1] in slow}
    used = {a for k in nodes if k not in inverse for a in graph.nodes[k].arguments}
    used |= {graph.nodes[k].arguments[0] for k in inverse}
    kinds = {k: (graph.nodes[k].op, graph.dtype(k)) for k in slow if k not in inverse}
    kinds = {k: kind for k, kind in kinds.items() if kind[0] == "div" or k in used}
    divider = sum(DIVIDER[kind] for kind in kinds.values())
    rest = (len(nodes) - len(slow)) / PER_CYCLE + sum(REFINED["sqrt", graph.dtype(k)] for k in inverse)
    chosen: set[int] = set()
    for k in sorted(kinds, key=lambda k: DIVIDER[kinds[k]], reverse=True):
        if divider - DIVIDER[kinds[k]] / 2 > rest:
            chosen.add(k)
            divider, rest = divider - DIVIDER[kinds[k]], rest + REFINED[kinds[k]]
    return chosen, inverse


class Refinement:
    """The code of one operation; `line` adds an instruction and gives its name, `declare` a function's declaration."""

    def __init__(self, dtype: str, line: Callable[[str], str], declare: Callable[[str], None]) -> None:
        self.dtype, self.line, self.declare = dtype, line, declare
        self.scalar, self.suffix, self.mask, self.lanes = TYPES[dtype]
        self.kind = f"<{self.lanes} x {self.scalar}>"

    def number(self, value: str) -> str:
        return f"splat ({self.scalar} {value})"

    def estimate(self, name: str, x: str) -> str:
        """The first 14 bits of 1/x or 1/√x."""
        function = f"@llvm.x86.avx512.{name}14.{self.suffix}.512"
        self.declare(f"declare {self.kind} {function}({self.kind}, {self.kind}, {self.mask})")
        return self.line(f"call {self.kind} {function}({self.kind} {x}, {self.kind} zeroinitializer, {self.mask} -1)")

    def fma(self, a: str, b: str, c: str) -> str:
        function = f"@llvm.fma.v{self.lanes}{self.dtype}"
        self.declare(f"declare {self.kind} {function}({', '.join([self.kind] * 3)})")
        return self.line(f"call {self.kind} {function}({self.kind} {a}, {self.kind} {b}, {self.kind} {c})")

    def mul(self, a: str, b: str) -> str:
        return self.line(f"fmul {self.kind} {a}, {b}")

    def neg(self, a: str) -> str:
        return self.line(f"fneg {self.kind} {a}")

    def choose(self, condition: str, a: str, b: str) -> str:
        return self.line(f"select <{self.lanes} x i1> {condition}, {self.kind} {a}, {self.kind} {b}")

    def where_number(self, a: str, otherwise: str) -> str:
        """What estimates of 0, infinity and NaN become in Newton's steps is no number: what they stand for is."""
        return self.choose(self.line(f"fcmp ord {self.kind} {a}, {a}"), a, otherwise)

    def quotient(self, a: str, b: str) -> str:
        r0, minus, one = self.estimate("rcp", b), self.neg(b), self.number("1.0")
        e = self.fma(minus, r0, one)
        r = self.fma(r0, self.fma(e, e, e) if self.dtype == "f64" else e, r0)
        if self.dtype == "f64":
            r = self.fma(r, self.fma(minus, r, one), r)
        if a == one:
            return self.where_number(r, r0)
        q = self.mul(a, r)
        return self.where_number(self.fma(self.fma(minus, q, a), r, q), self.mul(a, r0))

    def _inverse_root(self, x: str) -> tuple[str, str]:
        """(estimate, to 42 bits) of 1/√x; to 28 in single precision."""
        y0 = self.estimate("rsqrt", x)
        e = self.fma(self.neg(self.mul(x, y0)), y0, self.number("1.0"))
        half = self.number("0.5")
        factor = self.fma(e, self.number("0.375"), half) if self.dtype == "f64" else half
        return y0, self.fma(self.mul(y0, e), factor, y0)

    def root(self, x: str) -> str:
        _, y = self._inverse_root(x)
        s = self.mul(x, y)
        s = self.fma(self.fma(self.neg(s), s, x), self.mul(y, self.number("0.5")), s)
        function = f"@llvm.x86.avx512.fpclass.{self.suffix}.512"
        self.declare(f"declare <{self.lanes} x i1> {function}({self.kind}, i32)")
        zero_or_infinite = self.line(f"call <{self.lanes} x i1> {function}({self.kind} {x}, i32 14)")
        return self.choose(zero_or_infinite, x, s)

    def inverse_root(self, a: str, x: str) -> str:
        """a/√x."""
        y0, y = self._inverse_root(x)
        e = self.fma(self.neg(self.mul(x, y)), y, self.number("1.0"))
        y = self.where_number(self.fma(self.mul(y, self.number("0.5")), e, y), y0)
        return y if a == self.number("1.0") else self.mul(a, y)
