"""Models over arrays of directions: the one place where `vmap` adds axes to their scalar formulas."""

import math
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from gonio.models.arrays import Channels, Scalar
from gonio.models.brdf import AbstractBRDF
from gonio.models.compiled import kept
from gonio.models.compiled.directed import directed_values
from gonio.models.compiling import wide_jit
from gonio.models.errors import GonioError
from gonio.models.fingerprint import program_name
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.horizon import Hemispheres

BLOCK = 1 << 17
"""Pairs of one pass: what a formula of several loops, a quadrature or channels puts aside stays in the cache."""
SMALL_BLOCK = 8192
"""Pairs of one pass where their number changes from call to call."""
SIZES = (64, 256, 1024, 4096, 8192, 16384, 32768, 65536, BLOCK)
"""Pairs are filled up to one of these, so that few programs serve any number of them."""
LOST, NOWHERE = (0.0, 0.0, -1.0), (float("nan"),) * 3
"""What stands for the direction of light that does not leave the surface: against the normal, where pdf is 0 then; of
surfaces that transmit, whose light may leave there, no number."""
FEW_DRAWS = 2048
"""Drawn directions in single precision whose density is looked at beside them."""
LARGEST_CHANGE, MOST_COARSE = 0.1, 0.005
"""Relative change of a density between neighbouring numbers, and the share of directions that may have more."""

PLAIN = frozenset((np.ndarray, np.float64, np.float32, float, int))


@wide_jit
def _values(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> Channels:
    pairs = wi.z.shape[0]
    if pairs <= BLOCK:
        return jax.vmap(brdf.f)(wi, wo)

    def start(index: Scalar) -> Scalar:
        return jnp.minimum(index * BLOCK, pairs - BLOCK)  # the last block begins inside the one before it

    def block(index: Scalar) -> Channels:
        part = [Direction(*(jax.lax.dynamic_slice(c, (start(index),), (BLOCK,)) for c in w)) for w in (wi, wo)]
        return jax.vmap(brdf.f)(*part)

    def put(index: Scalar, values: Channels) -> Channels:
        return jax.lax.dynamic_update_slice_in_dim(values, block(index), start(index), 0)

    kind = jax.eval_shape(block, 0)
    return jax.lax.fori_loop(0, -(-pairs // BLOCK), put, jnp.zeros((pairs, *kind.shape[1:]), kind.dtype))


def component_arrays(wi: Direction, wo: Direction) -> tuple[list[np.ndarray], tuple[int, ...]]:
    """The six components as arrays, and the shape that they broadcast to."""
    for w in (wi, wo):
        if not isinstance(w, tuple) or len(w) != 3:
            raise GonioError(f"A direction is Direction(x, y, z), three arrays; a {type(w).__name__} came.")
    arrays = [np.asarray(c) for c in (*wi, *wo)]
    first = arrays[0].shape
    if [a.shape for a in arrays] == [first] * 6:
        return arrays, first
    try:
        return arrays, np.broadcast_shapes(*(a.shape for a in arrays))
    except ValueError:
        shapes = ", ".join(str(a.shape) for a in arrays)
        raise GonioError(f"The components of wi and wo have the shapes {shapes}, which do not broadcast.") from None


def flat_pair(wi: Direction, wo: Direction) -> tuple[Direction, Direction, tuple[int, ...]]:
    """Both directions broadcast to one shape and flattened to one axis, with that shape."""
    arrays, shape = component_arrays(wi, wo)
    dtype = jnp.result_type(float)
    flat = [jnp.asarray(np.broadcast_to(c, shape).reshape(-1), dtype) for c in arrays]
    return Direction(*flat[:3]), Direction(*flat[3:]), shape


def _looked_up(brdf: AbstractBRDF, arrays: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray | None:
    """f of a model that looks it up, shape (*shape, channels); None of others, and of many pairs, where XLA is faster.

    Arguments as `component_arrays` returns them.
    """
    if math.prod(shape) > BLOCK:
        return None
    dtype = jnp.result_type(float)
    flat = [np.broadcast_to(c, shape).reshape(-1).astype(dtype) for c in arrays]
    values = brdf.array_values(Direction(*flat[:3]), Direction(*flat[3:]))
    return None if values is None else values.reshape(*shape, values.shape[-1])


def _filled_up(w: Direction) -> Direction:
    """Directions (n,) with the last one repeated, up to one of `SIZES`."""
    n = w.z.shape[0]
    size = next((s for s in SIZES if n <= s), n) if n else 0
    return Direction(*(jnp.asarray(np.pad(np.asarray(c), (0, size - n), mode="edge")) for c in w)) if size > n else w


def evaluate(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> np.ndarray | jax.Array:
    """f(wi, wo), 1/sr, for directions of any broadcastable shape S: shape ``S``, or ``S + (channels,)``.

    Compiled once for each kind of model, whatever the number of pairs (`gonio.models.compiled`); what cannot be so is
    looked up by NumPy, or compiled by XLA once for each of a few numbers of pairs. Numbers are those of JAX's
    precision.

    Returns:
        An array of NumPy; of JAX where a direction is.

    Raises:
        GonioError: a direction is not three components, or their shapes do not broadcast.
    """
    arrays, shape = component_arrays(wi, wo)
    values = directed_values(brdf, arrays, shape)
    if values is None:
        values = _looked_up(brdf, arrays, shape)
    if values is None:
        wi, wo, shape = flat_pair(wi, wo)
        if any(isinstance(v, Tracer) for v in jax.tree.leaves(brdf)):  # part of a larger program
            values = jax.vmap(brdf.f)(wi, wo)
        else:
            values = np.asarray(_values(brdf, *(_filled_up(w) for w in (wi, wo))))[: wi.z.size]
        values = values.reshape(shape + values.shape[1:])
    # To ask of any number whether it is an array of JAX takes longer than to evaluate it.
    of_jax = any(type(c) not in PLAIN and isinstance(c, jax.Array) for c in (*wi, *wo))
    return jnp.asarray(values) if of_jax else values


def evaluate_in_blocks(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> np.ndarray:
    """f, 1/sr, of n pairs: shape (n, channels), one channel where the model has none.

    XLA's blocks have one size, so that one compilation serves any number of pairs.
    """
    arrays, shape = component_arrays(wi, wo)
    whole = directed_values(brdf, arrays, shape)
    if whole is None:
        whole = _looked_up(brdf, arrays, shape)
    if whole is not None:
        return np.asarray(whole, float).reshape(math.prod(shape), math.prod(whole.shape[len(shape) :]))
    parts = np.broadcast_arrays(*arrays)
    n, values = parts[0].size, []
    for start in range(0, n, SMALL_BLOCK):
        block = [np.resize(c.reshape(-1)[start : start + SMALL_BLOCK], SMALL_BLOCK) for c in parts]
        f = np.asarray(_values(brdf, *flat_pair(Direction(*block[:3]), Direction(*block[3:]))[:2]), float)
        values.append(f.reshape(SMALL_BLOCK, -1)[: n - start])
    return np.concatenate(values)


@wide_jit
def _samples(brdf: AbstractBRDF, wi: Direction, u1: jax.Array, u2: jax.Array) -> Direction:
    lost = NOWHERE if Hemispheres.TRANSMISSION in brdf.hemispheres else LOST

    def one(w: Direction, a: jax.Array, b: jax.Array) -> Direction:
        wo, leaves = brdf.sample(w, a, b)
        return Direction(*(jnp.where(leaves, c, d) for c, d in zip(wo, lost, strict=True)))

    return jax.vmap(one)(wi, u1, u2)


@wide_jit
def _densities(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> jax.Array:
    return jax.vmap(lambda i, o: jnp.asarray(brdf.pdf(i, o)))(wi, wo)


def sampled_directions(brdf: AbstractBRDF, wi: Direction, u1: np.ndarray, u2: np.ndarray) -> Direction:
    """The directions that the importance sampler draws for u1, u2 in [0, 1); `LOST`, or `NOWHERE`, for what is lost.

    u1 and u2 have the shape (n,); wi has it, or is one direction.
    """
    dtype = jnp.result_type(float)
    w = Direction(*(jnp.broadcast_to(jnp.asarray(c, dtype), np.shape(u1)) for c in wi))
    wo = Direction(*_samples(brdf, w, jnp.asarray(u1, dtype), jnp.asarray(u2, dtype)))
    if dtype == jnp.float32 and (note := rounding_of_draws(brdf, w, wo)):
        warnings.warn(note, stacklevel=2)
    return wo


def rounding_of_draws(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> str:
    """A sentence where drawn directions are rounded so coarsely that their density is another one; else nothing.

    wi and wo have components (n,): `FEW_DRAWS` of them are moved by a rounding.
    """
    some = slice(None, None, max(wi.z.size // FEW_DRAWS, 1))
    wi, wo = (Direction(*(c[some] for c in w)) for w in (wi, wo))
    beside = Direction(*(jnp.nextafter(c, jnp.full_like(c, 2.0)) for c in wo))
    here, there = (np.asarray(_densities(brdf, wi, w), float) for w in (wo, beside))
    share = float(np.mean(np.abs(there - here) > LARGEST_CHANGE * here))
    if share <= MOST_COARSE:
        return ""
    return (
        f"the density of {100 * share:.2g} % of the drawn directions changes by more than a tenth between neighbouring"
        " numbers of single precision: this lobe is too narrow for it, draw in double precision"
    )


def sampling_density(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> jax.Array:
    """Density, 1/sr, of the sampler's directions, for pairs of any broadcastable shape."""
    wi, wo, shape = flat_pair(wi, wo)
    return _densities(brdf, wi, wo).reshape(shape)


def channel_count(brdf: AbstractBRDF) -> int | None:
    """Number of channels of a model, or None where f is a single number."""
    # By the kinds of its arrays, as another process may have counted them: a trace takes a quarter of a second.
    arrays = {id(v) for v in jax.tree.leaves(brdf) if isinstance(v, jax.Array | np.ndarray | np.generic)}
    name = program_name("channel count", brdf, traced=arrays) if kept.keeping() else ""
    data = kept.read(name) if name else None
    if data is None:
        count = _traced_channel_count(brdf)
        if name:
            kept.write(name, str(count or "").encode())
        return count
    return int(data) if data else None


def _traced_channel_count(brdf: AbstractBRDF) -> int | None:
    d = Direction(*(jax.ShapeDtypeStruct((), jnp.result_type(float)) for _ in range(3)))
    shape = eqx.filter_eval_shape(lambda b, w: b.f(w, w), brdf, d).shape
    return shape[0] if shape else None
