"""What a formula need not guard against where its value is masked.

A model replaces directions beyond the horizon by the normal, so that nothing divides by 0 and no gradient is NaN, and
masks its value. In a program of values alone the mask suffices: what it decides of selections below it is left out.
"""

from gonio.models.compiled.graph import COMPARISONS, FLOATS, Graph

FLIPPED = {"lt": "gt", "le": "ge", "gt": "lt", "ge": "le", "eq": "eq", "ne": "ne"}
"""Comparisons with their arguments exchanged."""


def unguarded(graph: Graph, outputs: list[int]) -> list[int]:
    """Outputs that are the same, bit for bit, without the guards of what is masked.

    What the graph requires need not hold where the value is masked.
    """
    masks = {graph.nodes[k].arguments[0] for k in outputs if _masked(graph, k)}
    if len(masks) != 1 or not all(_masked(graph, k) for k in outputs):
        return outputs
    (mask,) = masks
    graph.limit += 2 * len(graph.nodes)  # what is left out is not written
    below, shown = _Below(graph, mask), _simple(graph, mask)
    hidden = graph.apply("xor", shown, graph.constant(True, "i1"))
    required, graph.required = graph.required, []
    for condition in required:
        graph.require(graph.apply("or", hidden, below(condition)))
    return [
        graph.apply("select", shown, below(value), masked) for _, value, masked in (graph.nodes[k][2] for k in outputs)
    ]


def _masked(graph: Graph, node: int) -> bool:
    made = graph.nodes[node]
    return made.op == "select" and graph.known(made.arguments[2])


def _simple(graph: Graph, mask: int) -> int:
    """A mask; that the smaller of two numbers is beyond a third, as that both are."""
    op, _, arguments, _ = graph.nodes[mask]
    both = _minimum(graph, arguments[0]) if op in ("gt", "ge") else None
    return mask if both is None else graph.apply("and", *(graph.apply(op, x, arguments[1]) for x in both))


def _minimum(graph: Graph, node: int) -> tuple[int, int] | None:
    """The two that a node is the smaller of, and NaN where one is, as `Graph.minimum` writes it."""
    made = graph.nodes[node]
    if made.op != "select":
        return None
    unordered, a, best = made.arguments
    inner = graph.nodes[best]
    if inner.op != "select" or inner.arguments[1] != a:
        return None
    less, _, b = inner.arguments
    named = [(graph.nodes[k].op, graph.nodes[k].arguments) for k in (unordered, less)]
    return (a, b) if named == [("ne", (a, a)), ("lt", (a, b))] else None


class _Below:
    """Nodes as they may be computed where a mask is true."""

    def __init__(self, graph: Graph, mask: int) -> None:
        self.graph, self.true = graph, set[int]()
        self.rewritten: dict[int, int] = {}
        self.least: dict[int, tuple[float, bool]] = {}
        """Numbers that nodes are not below, and whether they are beyond them."""
        self._assume(mask)

    def _assume(self, condition: int) -> None:
        self.true.add(condition)
        op, _, arguments, _ = self.graph.nodes[condition]
        if op == "and":
            for one in arguments:
                self._assume(one)
        elif op in ("gt", "ge") and self.graph.known(arguments[1]) and self.graph.dtype(arguments[1]) in FLOATS:
            for x in (arguments[0], *(_minimum(self.graph, arguments[0]) or ())):
                self.least[x] = float(self.graph.value(arguments[1])), op == "gt"

    def __call__(self, node: int) -> int:
        pending = [node]
        while pending:
            k = pending[-1]
            missing = [a for a in self.graph.nodes[k].arguments if a not in self.rewritten]
            if not missing:
                pending.pop()
                self.rewritten.setdefault(k, self._rewritten(k))
            pending += missing
        return self.rewritten[node]

    def _rewritten(self, k: int) -> int:
        op, dtype, arguments, _ = self.graph.nodes[k]
        below = [self.rewritten[a] for a in arguments]
        decided = True if k in self.true else self._decided(op, below)
        if decided is not None:
            return self.graph.constant(decided, "i1")
        if not below:
            return k
        if op in ("convert", "bits"):
            return getattr(self.graph, op)(below[0], dtype)
        result = self.graph.apply(op, *below)
        if op == "select" and all(b in self.least for b in below[1:]):  # such as the smaller of two cosines
            self.least.setdefault(result, min(self.least[b] for b in below[1:]))
        return result

    def _decided(self, op: str, arguments: list[int]) -> bool | None:
        """What a comparison is, where the bounds tell."""
        if op not in COMPARISONS:
            return None
        x, y = arguments
        if x == y:
            return False if op == "ne" and x in self.least else None
        if self.graph.known(x):
            x, y, op = y, x, FLIPPED[op]
        least, beyond = self.least.get(x, (float("nan"), False))
        if not (self.graph.known(y) and float(self.graph.value(y)) <= least):
            return None
        if op == "ge" or (op == "gt" and (beyond or float(self.graph.value(y)) < least)):
            return True
        return False if op == "lt" or (op == "le" and beyond) else None
