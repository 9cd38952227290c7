"""The program of XLA that forms residuals, derivatives and the sums of their products, a page of samples at a time.

The Jacobian is never stored: a block's rows are formed, multiplied and forgotten. One compiled program for each model
and loss takes a page of samples and up to `LANES` vectors of free numbers; how many of both are in use is data, so that
it serves every table and every stage of a fit.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.core as jax_core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from gonio.fitting.problem.disc_averages import Samples, block_rules, program_rules
from gonio.fitting.problem.lobes import averaged_lobes, rows_of, strengths_of, sum_of_lobes
from gonio.fitting.problem.parameterisation import FixedValues, Parameterisation
from gonio.fitting.problem.readings import LANES, PAGE, POINTS, AnyArray, block_of, transform, uses_cosine
from gonio.models.compiling import options
from gonio.models.geometry.directions import NORMAL, Direction
from gonio.models.kept_jit import kept_jit


class Request(NamedTuple):
    """What a program computes: for how many lanes; the score covariance too; of f itself, in place of its loss."""

    lanes: Int[AnyArray, ""]
    scores: Bool[AnyArray, ""]
    plain: Bool[AnyArray, ""]


def _computed(always: Bool[AnyArray, ""], function: Callable[[], Any]) -> Any:
    """The function's values, written to memory: a branch that is always taken, which XLA cannot know.

    XLA would otherwise compute lobes again for every channel, and losses for every derivative that uses them.
    """
    # Traced once: models are long, and shapes and branch would each run through them.
    traced, shapes = jax.make_jaxpr(function, return_shape=True)()
    leaves, tree = jax.tree.flatten(shapes)
    computed = jax.lax.cond(
        always,
        lambda: jax_core.eval_jaxpr(traced.jaxpr, traced.consts),
        lambda: [jnp.zeros(h.shape, h.dtype) for h in leaves],
    )
    return jax.tree.unflatten(tree, computed)


def _block(
    s: Parameterisation,
    loss: str,
    p: Float[AnyArray, " p"],
    fixed: FixedValues,
    page: Samples,
    b: Int[AnyArray, ""],
    plain: Bool[AnyArray, ""],
) -> tuple[Float[AnyArray, "c g n"], Float[AnyArray, "c n"]]:
    """(residuals and under them their derivatives (C, 1 + groups, n), the model's f (C, n)) of block b."""
    always = b < page.blocks
    strengths, cosine = strengths_of(s, p, fixed), jnp.abs(page.wi.z[b])
    lobes = averaged_lobes(s, p, fixed, page, b)

    def compared() -> tuple[Array, Array, AnyArray]:
        f = sum_of_lobes(lobes, strengths)
        weight = page.weight[b].T
        used = weight > 0
        c = cosine[None, :] if uses_cosine(loss) else jnp.ones_like(cosine)[None, :]
        value, slope = transform(loss, f * c, page.floor)
        value, slope = jnp.where(plain, f, value), jnp.where(plain, 1.0, slope * c)
        residual = jnp.where(used, weight * (value - page.target[b].T), 0.0)
        return residual, jnp.where(used, weight * slope, 0.0), f

    residual, by_f, f = _computed(always, compared)

    def rows() -> Array:
        return jnp.stack([residual, *(row * by_f for row in rows_of(s, lobes, strengths))], axis=1)

    return _computed(always, rows), f


@functools.lru_cache(maxsize=256)
def page_program(s: Parameterisation, loss: str) -> Callable:
    """The program (p (LANES, P), order, request, fixed, page) → (squares, f) of one page.

    `squares` (LANES, 2, C, 1 + groups, 1 + groups): products of residuals and derivatives with each other, and of these
    times the residuals; `f` (PAGE, C, n): the model at the samples, of the last lane in use. One program for all that a
    fit computes of a model: to trace a model takes as long as to run it over a million samples.
    """
    size = 1 + len(s.free)

    def squared(rows: AnyArray) -> Array:
        return jax.lax.dot_general(rows, rows, (((2,), (2,)), ((0,), (0,))))

    def one_lane(p: Array, f: Array, request: Request, fixed: FixedValues, page: Samples) -> tuple[Array, Array]:
        def add_block(b: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            square, scores, f = carry
            rows, at_samples = _block(s, loss, p, fixed, page, b, request.plain)
            again = jax.lax.cond(request.scores, lambda: scores + squared(rows * rows[:, :1]), lambda: scores)
            return square + squared(rows), again, f.at[b].set(at_samples)

        none = jnp.zeros((s.channels, size, size))
        square, scores, f = jax.lax.fori_loop(0, page.blocks, add_block, (none, none, f))
        return jnp.stack([square, scores]), f

    def program(p: Array, order: Array, request: Request, fixed: FixedValues, page: Samples) -> tuple[Array, Array]:
        def lane(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
            out, f = carry
            squares, f = one_lane(p[order[k]], f, request, fixed, page)
            return out.at[order[k]].set(squares), f

        out = jnp.zeros((LANES, 2, s.channels, size, size))
        f = jnp.zeros((PAGE, s.channels, page.wi.z.shape[1]))
        return jax.lax.fori_loop(0, request.lanes, lane, (out, f))

    return kept_jit(program, s, loss, options=options)


def compile_page_program(s: Parameterisation, loss: str, fixed: FixedValues) -> None:
    """Compile the program of a model and a loss, before there are readings."""
    n, c = block_of(s.channels), s.channels
    up = Direction(*(np.full((PAGE, n), e) for e in NORMAL))
    none = np.zeros((PAGE, n, c))
    blocks = block_rules(None, PAGE)
    page = Samples(up, up, none, none, np.asarray(0), np.asarray(1.0), blocks, program_rules(POINTS))
    request = Request(np.asarray(0, np.int32), np.asarray(False), np.asarray(False))
    program = page_program(s, loss)
    program(np.zeros((LANES, s.size)), np.zeros(LANES, np.int32), request, fixed, page)[0].block_until_ready()
