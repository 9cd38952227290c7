"""Derivatives of a model's values by its named parameters."""

import weakref

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Channels
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import Frame, as_array, assemble, frame, number_label, to_expression, together
from gonio.models.expression.parser import numbers, parse
from gonio.models.geometry.directions import Direction

KEPT = 64
"""Models whose derivatives a process remembers."""


def parameter_derivatives(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> dict[str, np.ndarray | jax.Array]:
    """Derivatives of f by each parameter of a model that has an expression.

    Args:
        brdf: the model.
        wi, wo: unit directions, components of any shapes that broadcast to one, S.

    Returns:
        Arrays of shape S + (channels,), one channel where the model has none, 1/sr per unit of the parameter, by its
        label, such as 'ggx.alpha'. Of a parameter with one value for each channel: each channel's derivative by its own
        value.

    Raises:
        GonioError: the model has no expression.
    """
    labels, derivatives = _derivatives_of(brdf)
    if not labels:
        return {}
    rows = evaluate(derivatives, wi, wo)  # pyright: ignore[reportArgumentType] -- it has what is used of a model
    rows = rows.reshape(*rows.shape[:-1], len(labels), rows.shape[-1] // len(labels))
    return {label: rows[..., k, :] for label, k in labels.items()}


def _places(values: list[dict[str, jax.Array]]) -> list[tuple[int, str]]:
    """Every number of an expression: its term, and its path in that, in the order that trees of JAX keep."""
    return [(term, path) for term, by_path in enumerate(values) for path in sorted(by_path)]


class _Derivatives(eqx.Module):
    """A model's derivatives by all its numbers, as one formula that is evaluated like f."""

    values: list[dict[str, jax.Array]]
    frames: tuple[Frame, ...] = eqx.field(static=True)

    def f(self, wi: Direction, wo: Direction) -> Channels:
        """Derivatives by each number, each of all channels."""

        def value(values: list[dict[str, jax.Array]]) -> jax.Array:
            return together([assemble(of, v) for of, v in zip(self.frames, values, strict=True)]).f(wi, wo)

        rows = []
        for term, path in _places(self.values):
            slopes = [{k: jnp.zeros_like(v) for k, v in by_path.items()} for by_path in self.values]
            slopes[term][path] = jnp.ones_like(self.values[term][path])
            rows.append(jax.jvp(value, (self.values,), (slopes,))[1])
        return jnp.stack(rows).reshape(-1)

    def array_values(self, wi: Direction, wo: Direction) -> None:
        """No derivative is looked up."""


_remembered: dict[int, tuple[weakref.ref, dict[str, int], _Derivatives]] = {}


def _derivatives_of(brdf: AbstractBRDF) -> tuple[dict[str, int], _Derivatives]:
    """The derivatives of a model, and the place of each by its label; remembered, since a model cannot change."""
    known = _remembered.get(id(brdf))
    if known is not None and known[0]() is brdf:
        return known[1:]
    terms = parse(to_expression(brdf))
    frames = tuple(frame(term) for term in terms)
    values = [{n.path: as_array(n.value.number) for n in numbers(term) if n.value.number is not None} for term in terms]
    places = _places(values)
    labels = {
        number_label(frames, term, path): places.index((term, path))
        for term, by_path in enumerate(values)
        for path in by_path
    }
    derivatives = _Derivatives(values, frames)
    if all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(eqx.filter(brdf, eqx.is_array))):
        if len(_remembered) >= KEPT:
            _remembered.clear()
        _remembered[id(brdf)] = weakref.ref(brdf), labels, derivatives
    return labels, derivatives
