"""Guards that a mask makes needless are left out of compiled loops, and nothing changes."""

import numpy as np

from gonio.models.compiled.graph import Graph
from gonio.models.compiled.masks import unguarded

X = np.array([-1.0, 0.0, 0.1, 0.5, 1.0, np.nan])


def values(graph, node, x):
    """A node's values by NumPy, over an input."""
    made = graph.nodes[node]
    if made.op == "input":
        return x[made.value]
    if made.op == "constant":
        return made.value
    from gonio.models.compiled.graph import NUMPY

    with np.errstate(all="ignore"):
        return NUMPY[made.op](*(values(graph, a, x) for a in made.arguments))


def reached(graph, node):
    """The operations that a node needs."""
    made = graph.nodes[node]
    return {made.op} | {op for a in made.arguments for op in reached(graph, a)}


def guarded(graph, horizon, comparison="gt"):
    """1/x + 1/√y, each guarded by its own cosine, masked where the smaller is on the horizon."""
    x, y = (graph.node("input", "f64", (), k) for k in range(2))
    one, limit = graph.constant(1.0, "f64"), graph.constant(horizon, "f64")
    safe = [graph.apply("select", graph.apply("gt", c, limit), c, one) for c in (x, y)]
    root = graph.apply("sqrt", graph.maximum(safe[1], graph.constant(horizon / 2, "f64")))
    value = graph.apply("add", graph.apply("div", one, safe[0]), graph.apply("div", one, root))
    mask = graph.apply(comparison, graph.minimum(x, y), limit)
    again = graph.apply("select", graph.apply("gt", graph.minimum(*safe), limit), value, graph.constant(0.0, "f64"))
    return graph.apply("select", mask, again, graph.constant(0.0, "f64"))


def test_guards_below_a_mask_are_left_out_bit_for_bit():
    graph, grid = Graph(1000), [c.reshape(-1) for c in np.meshgrid(X, X)]
    before = guarded(graph, 0.1)
    (after,) = unguarded(graph, [before])
    np.testing.assert_array_equal(values(graph, before, grid), values(graph, after, grid))
    _, value, _ = graph.nodes[after].arguments
    assert not reached(graph, value) & {"select", "gt", "lt", "ne"}


def test_a_mask_that_does_not_decide_a_guard_keeps_it():
    graph, grid = Graph(1000), [c.reshape(-1) for c in np.meshgrid(X, X)]
    before = guarded(graph, 0.1, "ge")  # at 0.1 itself the guards replace what the mask shows
    (after,) = unguarded(graph, [before])
    np.testing.assert_array_equal(values(graph, before, grid), values(graph, after, grid))


def test_what_is_required_need_not_hold_where_the_value_is_masked():
    graph = Graph(1000)
    before = guarded(graph, 0.1)
    x = graph.nodes.index(next(n for n in graph.nodes if n.op == "input"))
    graph.require(graph.apply("lt", x, graph.constant(0.4, "f64")))
    unguarded(graph, [before])
    (condition,) = graph.required
    np.testing.assert_array_equal(
        values(graph, condition, [X, np.full_like(X, 0.7)]), [True, True, True, False, False, True]
    )
