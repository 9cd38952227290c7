"""Derivatives of a model's values by its named parameters."""

import jax
import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF
from gonio.models.compiling import wide_jit
from gonio.models.expression.builder import Frame, as_array, assemble, frame, number_label, to_expression, together
from gonio.models.expression.parser import numbers, parse
from gonio.models.geometry.directions import Direction


def parameter_derivatives(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> dict[str, jax.Array]:
    """Derivatives of f by each parameter of a model that has an expression.

    Args:
        brdf: the model.
        wi, wo: unit directions, components of shape (n,).

    Returns:
        Arrays of shape (n,) or (n, channels), 1/sr per unit of the parameter, by its label, such as 'ggx.alpha'. Of a
        parameter with one value for each channel: each channel's derivative by its own value.

    Raises:
        GonioError: the model has no expression.
    """
    terms = parse(to_expression(brdf))
    frames = tuple(frame(term) for term in terms)
    values = [{n.path: as_array(n.value.number) for n in numbers(term) if n.value.number is not None} for term in terms]
    return {
        number_label(frames, term, path): _derivative(frames, values, term, path, wi, wo)
        for term, by_path in enumerate(values)
        for path in by_path
    }


@wide_jit
def _derivative(
    frames: tuple[Frame, ...],
    values: list[dict[str, jax.Array]],
    term: int,
    path: str,
    wi: Direction,
    wo: Direction,
) -> jax.Array:
    def f(value: jax.Array) -> jax.Array:
        changed = [{**v, path: value} if k == term else v for k, v in enumerate(values)]
        model = together([assemble(of, v) for of, v in zip(frames, changed, strict=True)])
        return jax.vmap(model.f)(wi, wo)

    value = values[term][path]
    return jax.jvp(f, (value,), (jnp.ones_like(value),))[1]
