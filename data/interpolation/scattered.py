"""Scattered samples as a material: kriged where their own left-out values are predicted better so, else averaged."""

import functools
import hashlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.data.flags import Flag
from gonio.data.interpolation import inverse_distance
from gonio.data.interpolation.kriging import (
    HIGH,
    LOW,
    NAMES,
    Kriging,
    Places,
    Samples,
    Symmetry,
    correlation,
    likeliest,
    places,
)
from gonio.data.polarisation import are_their_own_exchange
from gonio.data.table import Table, index_of, part_sides
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction

FLOOR = 1e-3
"""Share of the white diffuser, or of bright samples if they are darker, below which values are told apart evenly."""
FEWEST, MOST = 24, 4000
"""Samples that are kriged: fewer tell no law, more need too large a matrix."""
BETTER = 0.7
"""Of the inverse-distance mean's error at samples left out: from there on kriging is taken."""
NO_WORSE, EXACT = 1.0, 1e-6
"""The same for a law that the provenance states, which may be damaged; an error of compressed values that is none."""
BEYOND = 0.5
"""Of compressed values past the least and the largest: no value is extrapolated farther."""
KEY = "kriging"
"""Of the provenance that states a law: {"law": {name: value}, "floor": 1/sr}; "laws" by sides of light and detector."""
DESCRIPTION = (
    "kriging of log f over tan θh and θd with a Matérn covariance, its numbers by maximum likelihood; {}never beyond "
    "what was read by more than e^0.5; an approximation"
)
ASSUMED = {
    (True, True): "reciprocity is assumed, isotropy and mirror symmetry too; ",
    (True, False): "reciprocity is assumed; ",
    (False, True): "isotropy and mirror symmetry are assumed; ",
    (False, False): "",
}
"""By whether the symmetry is reciprocal, and isotropic."""


class Kriged(AbstractBRDF):
    """mean + Σ weights · covariances with the samples, of compressed values."""

    main: Float[Array, "chunks chunk 2"]
    tilted: Float[Array, "chunks chunk tilts"]
    weights: Float[Array, "chunks chunk channel"]
    mean: Float[Array, " channel"]
    ends: Float[Array, "2 channel"]
    law: Float[Array, " numbers"]
    floor: Float[Array, ""]
    symmetry: Symmetry = eqx.field(static=True)

    @property
    def isotropic(self) -> bool:
        return self.symmetry.isotropic

    def formula(self, wi: Direction, wo: Direction) -> Float[Array, " channel"]:
        i, o = (Direction(*(c[None] for c in w)) for w in (wi, wo))
        here = places(i, o, self.law, self.symmetry, jnp)

        def step(total: Array, chunk: tuple[Array, Array, Array]) -> tuple[Array, None]:
            main, tilted, weights = chunk
            row = correlation(here, Places(main, tilted), jnp.exp(self.law[6]), jnp)[0]
            return total + row @ weights, None

        start = jnp.zeros(self.weights.shape[-1], self.weights.dtype)
        total, _ = jax.lax.scan(step, start, (self.main, self.tilted, self.weights))
        return 2 * self.floor * jnp.sinh(jnp.clip(self.mean + total, *self.ends))


def scattered_material(table: Table, reciprocal: bool = True) -> AbstractBRDF:
    """The interpolant of a scattered table. Raises GonioError for too many samples.

    `reciprocal`: whether a sample stands for its directions swapped too.
    """
    reciprocal = reciprocal and are_their_own_exchange(table.channels.names)
    kriging = kriging_of(table, reciprocal)
    if kriging is None:
        return inverse_distance.scattered_material(table, reciprocal)
    system, floor = kriging
    variance, values, dtype = np.exp(system.law[8]), system.samples.values, jnp.result_type(float)
    ends = np.stack([values.min(axis=0) - BEYOND, values.max(axis=0) + BEYOND])
    rows = (*system.here, variance * system.weights)
    main, tilted, weights = (jnp.asarray(inverse_distance.chunks(a), dtype) for a in rows)
    mean, ends, law, floor = (jnp.asarray(a, dtype) for a in (system.mean, ends, system.law, floor))
    return Kriged(main, tilted, weights, mean, ends, law, floor, system.samples.symmetry)


def description(table: Table, reciprocal: bool = True) -> str:
    """One sentence on how a scattered table is interpolated."""
    reciprocal = reciprocal and are_their_own_exchange(table.channels.names)
    kriging = kriging_of(table, reciprocal)
    if kriging is None:
        return inverse_distance.DESCRIPTION.format(inverse_distance.SWAPPED if reciprocal else "")
    return DESCRIPTION.format(ASSUMED[reciprocal, kriging.system.samples.symmetry.isotropic])


class FlooredKriging(NamedTuple):
    """A solved system, and the floor f₀, 1/sr, of its compressed values asinh(f / 2f₀)."""

    system: Kriging
    floor: float


def compressed(f: np.ndarray, floor: float) -> np.ndarray:
    """asinh(f / 2 floor)."""
    return np.arcsinh(f / (2 * floor))


def samples_of(table: Table, floor: float, reciprocal: bool = True) -> Samples:
    """The samples of a scattered table that are valid in all channels, compressed above a floor."""
    block = table.samples()
    usable = (block.flag == Flag.VALID).all(axis=1)
    wi, wo = (Direction(*(np.asarray(c, float)[usable] for c in w)) for w in (block.wi, block.wo))
    f, u_f = (a[usable].astype(float) for a in (block.f, block.u_f))
    noise = np.mean((np.nan_to_num(u_f) / np.hypot(f, 2 * floor)) ** 2, axis=1)
    return Samples(wi, wo, compressed(f, floor), noise, symmetry_of(table, wi, reciprocal))


def symmetry_of(table: Table, wi: Direction, reciprocal: bool) -> Symmetry:
    """That of samples with light from wi, NumPy components (n,), of a part of a table."""
    light, detector = part_sides(table)
    index = index_of(table) ** ((light - detector) // 2)
    return Symmetry(inverse_distance.one_azimuth(wi), reciprocal, index)


def kriging_of(table: Table, reciprocal: bool = True) -> FlooredKriging | None:
    """The kriging of a scattered table, by the law of its provenance or else the likeliest; None: not better.

    `reciprocal`: whether a sample stands for its directions swapped too.
    """
    reciprocal = reciprocal and are_their_own_exchange(table.channels.names)
    stated, valid = _stated(table.provenance.get(KEY), part_sides(table)), table.valid_cells().size
    if not FEWEST <= valid <= MOST:
        return None
    return _solved(_Content(table, stated, reciprocal))


class _Content:
    """A table by what its interpolation depends on."""

    def __init__(self, table: Table, stated: tuple[np.ndarray, float] | None, reciprocal: bool) -> None:
        self.table, self.stated, self.reciprocal = table, stated, reciprocal
        about = (stated, reciprocal, part_sides(table), index_of(table))
        digest = hashlib.sha256(repr(about).encode())
        for array in (*table.layout.angles(), *table.read_values().values()):
            digest.update(np.ascontiguousarray(array).tobytes())
        self.digest = digest.hexdigest()

    def __hash__(self) -> int:
        return hash(self.digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Content) and self.digest == other.digest


@functools.lru_cache(maxsize=4)
def _solved(content: _Content) -> FlooredKriging | None:
    table, stated = content.table, content.stated
    block = table.samples()
    bright = np.quantile(np.abs(block.f[block.flag == Flag.VALID]), 0.9)
    floor = stated[1] if stated else FLOOR * min(1 / np.pi, float(bright))
    if not floor > 0:
        return None
    samples = samples_of(table, floor, content.reciprocal)
    if len(samples.noise) < FEWEST:
        return None
    try:
        system = Kriging.of(samples, stated[0] if stated else likeliest(samples))
        if not _better(system, samples, NO_WORSE if stated else BETTER):
            return None
    except np.linalg.LinAlgError:
        return None
    return FlooredKriging(system, floor)


def _better(system: Kriging, samples: Samples, share: float) -> bool:
    """Whether samples left out are predicted with less than a share of the inverse-distance mean's error."""
    means = inverse_distance.left_out(
        samples.wi, samples.wo, samples.values, samples.symmetry.isotropic, samples.symmetry.reciprocal
    )
    ours, theirs = (np.sqrt(np.mean(e**2)) for e in (system.left_out()[0], samples.values - means))
    return bool(ours < max(share * theirs, EXACT if share == NO_WORSE else 0.0))


def _stated(kept: Any, sides: tuple[int, int] = (1, 1)) -> tuple[np.ndarray, float] | None:
    """Law and floor that a provenance states for sides of light and detector; None where it states none."""
    if not isinstance(kept, Mapping):
        return None
    laws = kept.get("laws")
    if isinstance(laws, list):
        kept = {**kept, **next((e for e in laws if isinstance(e, Mapping) and e.get("sides") == [*sides]), {})}
    if not isinstance(kept.get("law"), Mapping):
        return None
    numbers = [kept["law"].get(name) for name in NAMES] + [kept.get("floor")]
    if not all(isinstance(v, int | float) and np.isfinite(v) and v > 0 for v in numbers):
        return None
    return np.clip(np.log(np.array(numbers[:-1], float)), LOW, HIGH), float(numbers[-1])
