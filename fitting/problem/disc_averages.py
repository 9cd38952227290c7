"""Averages of a model over the discs of light and detector, as a fit takes them: rules, and where readings are laid.

    reading = ∫∫ f cosθi cosθo dωi dωo / (∫ cosθi dωi · ∫ cosθo dωo),   directions below the horizon left out

A rule of number 2·step + grazing has n = `STEPS[step]` by n nodes in each disc that is no point, and n by 2n where one
stands low or the horizon cuts it. Number 0 is the centres alone. A block's lanes all use one rule. Where few readings
need a rule of many nodes, 2^`halvings` lanes side by side serve one reading, each with its share of the nodes.
"""

import dataclasses
import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gonio.fitting.problem.readings import AnyArray
from gonio.models.geometry.directions import Direction
from gonio.models.warps.disc_frames import DiscFrame, disc_frame, disc_ray, psi_of_horizon

STEPS = (1, 2, 3, 4, 6, 9, 14)
PAIRS_MAX = 9**4  # nodes of a rule over both discs


class DiscRules(NamedTuple):
    """Nodes of all rules in both discs: (x, y, weight), of grazing ones (ψ over where it ends, y/sin ψ, weight)."""

    tan_s: Float[AnyArray, "2"]
    nodes: Float[AnyArray, "r 2 k 3"]
    counts: Int[AnyArray, "r 2"]


class BlockRules(NamedTuple):
    """Rule of each block, and how often its lanes are halved."""

    rule: Int[AnyArray, " b"]
    halvings: Int[AnyArray, " b"]


class Samples(NamedTuple):
    """Samples of a fit in blocks, padded with weight 0. B blocks, a multiple of `PAGE`, of n samples, C channels."""

    wi: Direction  # components (B, n)
    wo: Direction
    target: Float[AnyArray, "B n C"]  # T(y c)
    weight: Float[AnyArray, "B n C"]
    blocks: AnyArray  # how many of the B are in use
    floor: AnyArray  # of the loss
    rules: BlockRules
    discs: DiscRules


@functools.lru_cache(maxsize=16)
def disc_rules(half_angles: tuple[float, float]) -> DiscRules:
    """The rules for discs of these half-angles of source and detector, radians; 0 is a point."""
    nodes = np.zeros((2 * len(STEPS), 2, 2 * STEPS[-1] ** 2, 3))
    counts = np.ones((2 * len(STEPS), 2), np.int32)
    for step, n in enumerate(STEPS):
        for d, s in enumerate(half_angles):
            for grazing in (0, 1):
                of_disc = (_whole_nodes, _grazing_nodes)[grazing](n if s > 0 else 1)
                counts[2 * step + grazing, d] = len(of_disc)
                nodes[2 * step + grazing, d, : len(of_disc)] = of_disc
    return DiscRules(np.tan(half_angles), nodes, counts)


def _whole_nodes(n: int) -> np.ndarray:
    """(n², 3): Gauss's rule of the second Chebyshev kind in x by Gauss–Legendre along the chords."""
    if n == 1:
        return np.array([[0.0, 0.0, 1.0]])
    psi = np.pi * np.arange(1, n + 1) / (n + 1)
    v, w = np.polynomial.legendre.leggauss(n)
    x, y = np.broadcast_arrays(np.cos(psi)[:, None], np.sin(psi)[:, None] * v)
    return np.stack([x, y, (np.sin(psi) ** 2)[:, None] * w], axis=-1).reshape(-1, 3)


def _grazing_nodes(n: int) -> np.ndarray:
    """(2n², 3): Gauss–Legendre in ψ and along the chords, as a lobe seen at grazing is narrow in azimuth."""
    if n == 1:
        return _whole_nodes(1)
    (g, w_g), (v, w_v) = (np.polynomial.legendre.leggauss(m) for m in (n, 2 * n))
    g, v = np.broadcast_arrays(0.5 * (1 + g)[:, None], v)
    return np.stack([g, v, w_g[:, None] * w_v], axis=-1).reshape(-1, 3)


def steps_of(half_angles: tuple[float, float]) -> int:
    """Number of the steps, the centres alone among them, that discs of these half-angles allow."""
    return int(np.count_nonzero(disc_rules(half_angles).counts[::2].prod(axis=1) <= PAIRS_MAX))


@dataclasses.dataclass(frozen=True)
class Lanes:
    """Where readings are laid in blocks of lanes.

    Attributes:
        source: index of the reading that each lane serves, −1 for none.
        place: (n,) the lane that stands for each reading.
        blocks: rules of the blocks.
    """

    source: np.ndarray
    place: np.ndarray
    blocks: BlockRules

    @classmethod
    def of(cls, rules: np.ndarray, half_angles: tuple[float, float], block: int) -> "Lanes":
        """The lanes of readings with these rules (n,), in blocks of so many lanes."""
        nodes = disc_rules(half_angles).counts.prod(axis=1)
        place, source, numbers, halvings, first = np.empty(rules.size, np.int64), [], [], [], 0
        for rule in np.unique(rules):
            cells = np.flatnonzero(rules == rule)
            halved = _halvings(cells.size, int(nodes[rule]), block)
            count = -(-(cells.size << halved) // block)
            lanes = np.full(count * block, -1)
            lanes[: cells.size << halved] = np.repeat(cells, 1 << halved)
            place[cells] = first + (np.arange(cells.size) << halved)
            source.append(lanes)
            numbers += [rule] * count
            halvings += [halved] * count
            first += lanes.size
        return cls(np.concatenate(source), place, BlockRules(*(np.asarray(a, np.int32) for a in (numbers, halvings))))

    def directions(self, c: np.ndarray, fill: float) -> np.ndarray:
        """A component of the readings' directions, in lanes."""
        return np.where(self.source >= 0, c[self.source], fill)

    def values(self, a: np.ndarray) -> np.ndarray:
        """Values of the readings (n, ...), in lanes; 0 where a lane stands for none."""
        laid = np.zeros((self.source.size, *a.shape[1:]))
        laid[self.place] = a
        return laid


def _halvings(cells: int, nodes: int, block: int) -> int:
    """How often to halve lanes so that so many cells of so many nodes cost least."""
    most = min(math.ceil(math.log2(nodes)), int(math.log2(block))) if nodes > 1 else 0
    return min(range(most + 1), key=lambda e: -(-(cells << e) // block) * -(-nodes // (1 << e)))


def block_rules(lanes: Lanes | None, blocks: int) -> BlockRules:
    """The rules of so many blocks, those beyond the lanes with the centres alone."""
    if lanes is None:
        return BlockRules(np.zeros(blocks, np.int32), np.zeros(blocks, np.int32))
    return BlockRules(*(np.pad(a, (0, blocks - a.size)) for a in lanes.blocks))


class _Discs(NamedTuple):
    """Frames of both discs of a block's lanes, and where the horizon cuts them if they are cut."""

    frames: tuple[DiscFrame, DiscFrame]
    psi_ends: tuple[Array, Array]


class NodePairs(NamedTuple):
    """The pairs of nodes of a block's rule, in its lanes: how many a lane has, and what is needed for each."""

    steps: Int[AnyArray, ""]
    rules: DiscRules
    rule: Int[AnyArray, ""]
    halvings: Int[AnyArray, ""]
    discs: _Discs

    @classmethod
    def of(cls, rules: DiscRules, rule: Array, halvings: Array, wi: Direction, wo: Direction) -> "NodePairs":
        """The pairs about directions of shape (n,)."""
        frames = disc_frame(wi, rules.tan_s[0]), disc_frame(wo, rules.tan_s[1])
        whole = jnp.full_like(wi.z, jnp.pi)
        ends = jax.lax.cond(rule % 2 == 1, lambda: tuple(map(psi_of_horizon, frames)), lambda: (whole, whole))
        total = jnp.prod(rules.counts[rule])
        steps = (total + (1 << halvings) - 1) >> halvings
        return cls(steps, rules, rule, halvings, _Discs(frames, ends))

    def pair(self, k: Int[AnyArray, ""]) -> tuple[Direction, Direction, Float[Array, " n"]]:
        """(wi, wo, weight) of pair k of each lane."""
        counts, n = self.rules.counts[self.rule], self.discs.psi_ends[0].size
        total = counts[0] * counts[1]
        node = (jnp.arange(n) & ((1 << self.halvings) - 1)) + (k << self.halvings)
        inside = node < total
        node = jnp.where(inside, node, 0)
        wi, share_i = self._ray(0, node // counts[1])
        wo, share_o = self._ray(1, node % counts[1])
        # Of one pair exactly 1: what is not averaged keeps its bits.
        return wi, wo, jnp.where(total == 1, 1.0, jnp.where(inside, share_i * share_o, 0.0))

    def _ray(self, d: int, node: Int[Array, " n"]) -> tuple[Direction, Array]:
        table, frame, psi_end = self.rules.nodes[self.rule, d], self.discs.frames[d], self.discs.psi_ends[d]
        alike = self.halvings == 0
        x, y, w = jax.lax.cond(
            alike, lambda: jnp.broadcast_to(table[node[0]][:, None], (3, node.size)), lambda: table[node].T
        )

        def grazing() -> tuple[Array, Array, Array]:
            sine = jnp.sin(psi_end * x)
            return jnp.cos(psi_end * x), y * sine, w * psi_end * sine * sine

        x, y, w = jax.lax.cond((self.rule % 2 == 1) & (self.rules.counts[self.rule, d] > 1), grazing, lambda: (x, y, w))
        ray, share = disc_ray(frame, frame.tan_s * x, frame.tan_s * y)
        return ray, w * share

    def gathered(self, a: Float[AnyArray, "*b n"]) -> Float[AnyArray, "*b n"]:
        """Sums over the lanes of one reading, in the lane that stands for it."""
        return jax.lax.fori_loop(0, self.halvings, lambda k, a: a + jnp.roll(a, -(1 << k), axis=-1), a)
