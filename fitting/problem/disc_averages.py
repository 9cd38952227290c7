"""Averages of a model over the discs of light and detector, as a fit takes them: rules, and where readings are laid.

    reading = ∫∫ f cosθi cosθo dωi dωo / (∫ cosθi dωi · ∫ cosθo dωo),   directions below the horizon left out

Rules have numbers `KINDS`·step + kind; number 0 is the centres alone. Where there are two discs, both above the
horizon, their nodes are pairs of directions (`pair_rules`), fine in the half vector or (`OPPOSED`) in what changes it
least, as wi − wo does. Else each node of one disc meets each of the other: n = `STEPS[step]` by n of a disc that is no
point, and n by 2n where the horizon cuts one (`CUT`). A block's lanes all use one rule. Where few readings need a rule
of many nodes, 2^`halvings` lanes side by side serve one reading, each with its share of the nodes.
"""

import dataclasses
import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gonio.fitting.problem.pair_rules import COUNTS, FINENESS, pair_rules
from gonio.fitting.problem.readings import AnyArray
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.horizon import turned_over
from gonio.models.warps.disc_frames import DiscFrame, disc_frame, disc_ray, pair_normal, psi_of_horizon, ray_about

STEPS = (1, 2, 3, 4, 6, 9, 14, 22, 34, 52, 78)
KINDS = 3
CUT, OPPOSED = 1, 2
PAIRS_MAX = 14**4  # nodes of a rule over both discs
ROOM = 1 + sum(COUNTS)  # for the pairs of nodes of all rules: every problem's arrays have one shape


class DiscRules(NamedTuple):
    """Nodes of all rules in both discs, n columns (x, √(1 − x²), weight) by m rows (y over √(1 − x²), weight).

    Of rules for cut discs the columns are (ψ over where it ends, 1, weight). Rules of `pair_rules` begin at `first` of
    `pairs`, others have −1 there. `sizes`: pairs of nodes of each rule.
    """

    tan_s: Float[AnyArray, "2"]
    columns: Float[AnyArray, "r 2 n 3"]
    rows: Float[AnyArray, "r 2 m 2"]
    shape: Int[AnyArray, "r 2 2"]
    pairs: Float[AnyArray, "5 k"]
    first: Int[AnyArray, " r"]
    sizes: Int[AnyArray, " r"]

    @property
    def counts(self) -> Int[AnyArray, "r 2"]:
        """Number of nodes in each disc, of rules that are not of pairs."""
        return self.shape[..., 0] * self.shape[..., 1]


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
    size, most = KINDS * len(STEPS), STEPS[-1]
    columns, rows = np.zeros((size, 2, most, 3)), np.zeros((size, 2, 2 * most, 2))
    shape, first = np.ones((size, 2, 2), np.int32), np.full(size, -1, np.int32)
    for rule, d in np.ndindex(size, 2):
        n = STEPS[rule // KINDS] if half_angles[d] > 0 else 1
        of_n = (_cut_rule if rule % KINDS == CUT else _whole_rule)(n)
        shape[rule, d] = tuple(map(len, of_n))
        columns[rule, d, : len(of_n[0])], rows[rule, d, : len(of_n[1])] = of_n
    pairs, sizes = np.zeros((5, ROOM)), shape.prod(axis=(1, 2), dtype=np.int32)
    if min(half_angles) > 0:
        tan_i, tan_o = np.tan(half_angles).tolist()
        counts = np.array([1, *COUNTS])
        for kind in (0, OPPOSED):
            whole = slice(kind, KINDS * counts.size, KINDS)
            first[whole], sizes[whole] = np.cumsum(counts) - counts, counts
        pairs = np.concatenate([np.eye(5)[:, 4:], *pair_rules((tan_i, tan_o))], axis=1)
    return DiscRules(np.tan(half_angles), columns, rows, shape, pairs, first, sizes)


def program_rules(half_angles: tuple[float, float]) -> DiscRules:
    """The rules as XLA's programs take them: the many numbers are not copied for each page."""
    return disc_rules(half_angles)._replace(pairs=_on_device(half_angles, jnp.result_type(float)))


@functools.lru_cache(maxsize=16)
def _on_device(half_angles: tuple[float, float], dtype: np.dtype) -> Array:
    return jnp.asarray(np.asarray(disc_rules(half_angles).pairs, dtype))


def _whole_rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns by Gauss's rule of the second Chebyshev kind, rows by Gauss–Legendre: exact to degree 2n − 1."""
    if n == 1:
        return np.array([[0.0, 1.0, 1.0]]), np.array([[0.0, 1.0]])
    psi = np.pi * np.arange(1, n + 1) / (n + 1)
    columns = np.stack([np.cos(psi), np.sin(psi), np.sin(psi) ** 2], axis=1)
    return columns, np.stack(np.polynomial.legendre.leggauss(n), axis=1)


def _cut_rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre in ψ up to the horizon, and 2n rows: a lobe seen at grazing is narrow in azimuth."""
    if n == 1:
        return _whole_rule(1)
    (g, w), rows = np.polynomial.legendre.leggauss(n), np.polynomial.legendre.leggauss(2 * n)
    return np.stack([0.5 * (1 + g), np.ones(n), w], axis=1), np.stack(rows, axis=1)


def steps_of(half_angles: tuple[float, float]) -> tuple[int, int]:
    """Number of the steps, the centres alone among them, that discs of these half-angles allow: whole ones, and cut."""
    products = int(np.count_nonzero(disc_rules(half_angles).counts[::KINDS].prod(axis=1) <= PAIRS_MAX))
    return (1 + len(COUNTS) if min(half_angles) > 0 else products), products


def farthest_node(half_angles: tuple[float, float], step: int) -> float:
    """Radians from the mirror configuration to the nearest node of a rule, at most."""
    s, n = (sum(half_angles), FINENESS[step - 1]) if min(half_angles) > 0 else (max(half_angles), STEPS[step])
    return math.sqrt(2.0) * s / (n + 1)


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
        nodes = disc_rules(half_angles).sizes
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
    normal: Direction
    sides: tuple[Array, Array]
    """−1 where a disc is behind the sample: it is averaged as its mirror image in front."""


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
        sides = jnp.where(wi.z < 0, -1.0, 1.0), jnp.where(wo.z < 0, -1.0, 1.0)
        wi, wo = turned_over(wi, sides[0]), turned_over(wo, sides[1])
        frames = disc_frame(wi, rules.tan_s[0]), disc_frame(wo, rules.tan_s[1])
        whole = jnp.full_like(wi.z, jnp.pi)
        ends = jax.lax.cond(rule % KINDS == CUT, lambda: tuple(map(psi_of_horizon, frames)), lambda: (whole, whole))
        steps = (rules.sizes[rule] + (1 << halvings) - 1) >> halvings
        return cls(steps, rules, rule, halvings, _Discs(frames, ends, pair_normal(wi, wo), sides))

    def pair(self, k: Int[AnyArray, ""]) -> tuple[Direction, Direction, Float[Array, " n"]]:
        """(wi, wo, weight) of pair k of each lane."""
        total, n = self.rules.sizes[self.rule], self.discs.psi_ends[0].size
        node = (jnp.arange(n) & ((1 << self.halvings) - 1)) + (k << self.halvings)
        inside = node < total
        node = jnp.where(inside, node, 0)
        of_pairs = self.rules.first[self.rule] >= 0
        wi, wo, share = jax.lax.cond(of_pairs, lambda: self._paired(node), lambda: self._product(node))
        # Of one pair exactly 1: what is not averaged keeps its bits.
        return wi, wo, jnp.where(total == 1, 1.0, jnp.where(inside, share, 0.0))

    def _paired(self, node: Int[Array, " n"]) -> tuple[Direction, Direction, Array]:
        x_i, y_i, x_o, y_o, w = self.rules.pairs[:, self.rules.first[self.rule] + node]
        (tan_i, tan_o), discs = self.rules.tan_s, self.discs
        tan_o = jnp.where(self.rule % KINDS == OPPOSED, -tan_o, tan_o)
        wi, share_i = ray_about(discs.frames[0].axis, discs.normal, tan_i * x_i, tan_i * y_i)
        wo, share_o = ray_about(discs.frames[1].axis, discs.normal, tan_o * x_o, tan_o * y_o)
        return turned_over(wi, discs.sides[0]), turned_over(wo, discs.sides[1]), w * share_i * share_o

    def _product(self, node: Int[Array, " n"]) -> tuple[Direction, Direction, Array]:
        count = self.rules.counts[self.rule, 1]
        wi, share_i = self._ray(0, node // count)
        wo, share_o = self._ray(1, node % count)
        return wi, wo, share_i * share_o

    def _ray(self, d: int, node: Int[Array, " n"]) -> tuple[Direction, Array]:
        frame, psi_end = self.discs.frames[d], self.discs.psi_ends[d]
        columns, rows = self.rules.columns[self.rule, d], self.rules.rows[self.rule, d]
        m = self.rules.shape[self.rule, d, 1]

        def read(node: Array) -> Array:
            return jnp.concatenate([columns[node // m], rows[node % m]], axis=-1).T

        def of_all() -> Array:
            return jnp.broadcast_to(read(node[0])[:, None], (5, node.size))

        x, length, w, v, w_v = jax.lax.cond(self.halvings == 0, of_all, lambda: read(node))

        def cut() -> tuple[Array, Array, Array]:
            sine = jnp.sin(psi_end * x)
            return jnp.cos(psi_end * x), sine * v, w * w_v * psi_end * sine * sine

        bent = (self.rule % KINDS == CUT) & (self.rules.counts[self.rule, d] > 1)
        x, y, w = jax.lax.cond(bent, cut, lambda: (x, length * v, w * w_v))
        ray, share = disc_ray(frame, frame.tan_s * x, frame.tan_s * y)
        return turned_over(ray, self.discs.sides[d]), w * share

    def gathered(self, a: Float[AnyArray, "*b n"]) -> Float[AnyArray, "*b n"]:
        """Sums over the lanes of one reading, in the lane that stands for it."""
        return jax.lax.fori_loop(0, self.halvings, lambda k, a: a + jnp.roll(a, -(1 << k), axis=-1), a)
