"""A sheet's BSDF as files of windows hold it: for light on either side, its reflection and its transmission.

Each of the four blocks is a function of two directions in which light travels, projected on the sheet: that in which it
arrives, −wi, and that in which it leaves, wo. Straight transmission and mirror reflection keep the direction.
"""

import abc
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gonio.data.interpolation.angle_basis import AngleBasis
from gonio.models.arrays import Channels, Scalar
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction, safe_atan2
from gonio.models.geometry.horizon import EVERYWHERE, Hemispheres

BLOCKS = ("reflection front", "transmission front", "transmission back", "reflection back")
"""By the side on which the light falls."""


def pair_of(name: str, arriving: np.ndarray, leaving: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """(theta, phi) of wi and of wo, radians, of directions of travel (n, 2) of the block with this name."""
    front, kept = name.endswith("front"), name.startswith("reflection")
    theta_i = arriving[:, 0] if front else np.pi - arriving[:, 0]
    theta_o = leaving[:, 0] if front == kept else np.pi - leaving[:, 0]
    return (theta_i, (arriving[:, 1] + np.pi) % (2 * np.pi)), (theta_o, leaving[:, 1])


class BlockSamples(NamedTuple):
    """Pairs of directions at which a block stores its values."""

    arriving: np.ndarray
    """(n, 2): theta, to the normal, and phi, the azimuth, radians, of the direction in which light travels."""
    leaving: np.ndarray
    f: np.ndarray
    """(n,), 1/sr."""


class ScatteringBlock(eqx.Module):
    """f of one channel, 1/sr, between two hemispheres, constant in patches."""

    @abc.abstractmethod
    def value(self, arriving: Direction, leaving: Direction) -> Scalar:
        """f for the projected directions of travel, both with z ≥ 0."""

    @abc.abstractmethod
    def samples(self) -> BlockSamples:
        """The block's own patches."""

    @abc.abstractmethod
    def within(self, u: np.ndarray) -> BlockSamples:
        """`samples`, at another place in each patch: u (n, 4) in [0, 1), even in projected solid angle."""

    @abc.abstractmethod
    def incidences(self) -> np.ndarray:
        """(n, 2): theta and phi, radians, in the middle of the block's own patches of arriving directions."""

    @abc.abstractmethod
    def share(self, arriving: np.ndarray) -> np.ndarray:
        """(n,): ∫ f cos θo dωo, the share of the light that leaves, for arriving directions (n, 2); exact."""


class Matrix(ScatteringBlock):
    """A matrix over two angle bases: f[leaving, arriving] [Klems 1994]."""

    values: Float[Array, "leaving arriving"] = eqx.field(converter=jnp.asarray)
    arriving: AngleBasis = eqx.field(static=True)
    leaving: AngleBasis = eqx.field(static=True)

    def value(self, arriving: Direction, leaving: Direction) -> Scalar:
        return self.values[_patch(self.leaving, leaving), _patch(self.arriving, arriving)]

    def samples(self) -> BlockSamples:
        a, b = (np.stack(basis.centres(), axis=-1) for basis in (self.arriving, self.leaving))
        rows, columns = (g.ravel() for g in np.mgrid[: len(b), : len(a)])
        return BlockSamples(a[columns], b[rows], np.asarray(self.values).ravel())

    def within(self, u: np.ndarray) -> BlockSamples:
        rows, columns = (g.ravel() for g in np.mgrid[: self.leaving.size, : self.arriving.size])
        a, b = self.arriving.within(columns, *u[:, :2].T), self.leaving.within(rows, *u[:, 2:].T)
        return BlockSamples(a, b, np.asarray(self.values).ravel())

    def incidences(self) -> np.ndarray:
        return np.stack(self.arriving.centres(), axis=-1)

    def share(self, arriving: np.ndarray) -> np.ndarray:
        shares = self.leaving.projected_solid_angles() @ np.asarray(self.values, float)
        return shares[self.arriving.patch(*arriving.T)]


def _patch(basis: AngleBasis, w: Direction) -> Int[Array, ""]:
    edges = np.sin(np.radians(basis.edges[1:-1])) ** 2
    ring = jnp.sum(w.x**2 + w.y**2 >= edges)
    count, first = (jnp.asarray(a)[ring] for a in (np.array(basis.counts), basis.first))
    turn = safe_atan2(w.y, w.x) / (2 * jnp.pi)
    return first + jnp.floor(turn * count + 0.5).astype(int) % count


class Tree(ScatteringBlock):
    """A tree over the square by which the unit disc of projected directions is mapped [Shirley & Chiu 1997].

    Four dimensions: (x, y) of the arriving, then of the leaving direction. Three: half the distance of the arriving
    direction from the rim, then (x, y) of the leaving one, turned so that the light travels along +x.
    """

    values: Float[Array, " cell"] = eqx.field(converter=jnp.asarray)
    low: Float[Array, "cell dimension"] = eqx.field(converter=jnp.asarray)
    """The least corner of each cell in the unit cube."""
    size: Float[Array, " cell"] = eqx.field(converter=jnp.asarray)
    """The side of each cell."""
    children: Int[Array, "node branch"] = eqx.field(converter=jnp.asarray)
    """A node's branches: the number of a node, or −1 − the number of a leaf."""
    leaves: Int[Array, "leaf 2"] = eqx.field(converter=jnp.asarray)
    """Where a leaf's cells begin, and log₂ of their number along each side."""
    depth: int = eqx.field(static=True)
    """Most nodes above a leaf."""

    def value(self, arriving: Direction, leaving: Direction) -> Scalar:
        if self.low.shape[1] == 4:
            place = (*disc_to_square(arriving.x, arriving.y), *disc_to_square(leaving.x, leaving.y))
            return self.values[self._cell(jnp.stack(place))]
        length2 = arriving.x**2 + arriving.y**2
        known = length2 > 0
        length = jnp.sqrt(jnp.where(known, length2, 1.0))
        c, s = jnp.where(known, arriving.x / length, 1.0), jnp.where(known, arriving.y / length, 0.0)
        x, y = disc_to_square(c * leaving.x + s * leaving.y, c * leaving.y - s * leaving.x)
        return self.values[self._cell(jnp.stack((0.5 - 0.5 * jnp.where(known, length, 0.0), x, y)))]

    def _cell(self, place: Float[Array, " dimension"]) -> Int[Array, ""]:
        dimensions = self.low.shape[1]
        place = jnp.clip(place, 0.0, 1.0 - 1e-12)
        node = jnp.asarray(0 if self.children.shape[0] else -1)
        for _ in range(self.depth):
            inside, half = node >= 0, jnp.floor(2 * place)
            child = self.children[jnp.maximum(node, 0), jnp.sum(half * 2 ** np.arange(dimensions)).astype(int)]
            place, node = jnp.where(inside, 2 * place - half, place), jnp.where(inside, child, node)
        first, level = self.leaves[-1 - node]
        along = jnp.floor(place * 2**level).astype(int)
        return first + jnp.sum(along * 2 ** (level * np.arange(dimensions)[::-1]))

    def samples(self) -> BlockSamples:
        return self.within(np.full((int(np.sum(self._reached())), 4), 0.5))

    def _reached(self) -> np.ndarray:
        """Whether there are directions in a cell: of three dimensions half the cube is empty."""
        return np.asarray(self.low[:, 0]) < (0.5 if self.low.shape[1] == 3 else 1.0)

    def within(self, u: np.ndarray) -> BlockSamples:
        reached = self._reached()
        low, size = np.asarray(self.low, float)[reached], np.asarray(self.size, float)[reached, None]
        values = np.asarray(self.values, float)[reached]
        leaving = _angles(*(low[:, -2:] + size * u[:, 2:]).T)
        if low.shape[1] == 4:
            return BlockSamples(_angles(*(low[:, :2] + size * u[:, :2]).T), leaving, values)
        # A cell may reach beyond the normal, where there is nothing
        rim, core = 1 - 2 * low[:, 0], 1 - 2 * np.minimum(low[:, 0] + size[:, 0], 0.5)
        arriving = np.arcsin(np.sqrt(core**2 + (rim**2 - core**2) * u[:, 0]).clip(max=1.0))
        return BlockSamples(np.stack([arriving, np.zeros(len(low))], axis=-1), leaving, values)

    def incidences(self) -> np.ndarray:
        n = round(1 / float(np.min(self.size)))
        middle = (np.arange(n) + 0.5) / n
        if self.low.shape[1] == 3:
            theta = np.arcsin(1 - 2 * middle[: -(-n // 2)].clip(max=0.5))
            return np.stack([theta, np.zeros(theta.size)], axis=-1)
        return _angles(*(g.ravel() for g in np.meshgrid(middle, middle, indexing="ij")))

    def share(self, arriving: np.ndarray) -> np.ndarray:
        low, size = np.asarray(self.low, float), np.asarray(self.size, float)
        n, axes = round(1 / size.min()), low.shape[1] - 2
        # Each cell gives to all incidences within it: added at its corners, then summed along the axes
        shares = np.zeros((n + 1,) * axes)
        start, stop = np.rint(low[:, :axes] * n).astype(int), np.rint((low[:, :axes] + size[:, None]) * n).astype(int)
        flux = np.pi * np.asarray(self.values, float) * size**2
        for corner in np.ndindex((2,) * axes):
            corners = tuple(np.where(c, stop[:, k], start[:, k]) for k, c in enumerate(corner))
            np.add.at(shares, corners, flux * (-1) ** sum(corner))
        for axis in range(axes):
            shares = np.cumsum(shares, axis)
        sin_i, phi = np.sin(arriving[:, 0]), arriving[:, 1]
        place: tuple = (0.5 - 0.5 * sin_i,)
        if axes == 2:
            place = disc_to_square(sin_i * np.cos(phi), sin_i * np.sin(phi))
        return shares[tuple(np.clip((np.asarray(p) * n).astype(int), 0, n - 1) for p in place)]


def disc_to_square(x: Scalar, y: Scalar) -> tuple[Scalar, Scalar]:
    """(u, v) in the unit square of a point of the unit disc: equal areas, concentric [Shirley & Chiu 1997]."""
    r, phi = jnp.sqrt(x * x + y * y), safe_atan2(y, x)
    quarter = jnp.floor(phi / (jnp.pi / 2) + 0.5)  # -2 to 2
    along, across = r, r * (phi - quarter * jnp.pi / 2) / (jnp.pi / 4)
    turned = (quarter.astype(int)) % 4
    a = jnp.select([turned == 0, turned == 1, turned == 2], [along, -across, -along], across)
    b = jnp.select([turned == 0, turned == 1, turned == 2], [across, along, -across], -along)
    return 0.5 + 0.5 * a, 0.5 + 0.5 * b


def _angles(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(n, 2): theta and phi, radians, of the directions whose projection a point of the unit square stands for."""
    a, b = 2 * u - 1, 2 * v - 1
    wide = np.abs(a) >= np.abs(b)
    r = np.where(wide, a, b)
    turn = np.where(wide, b, a) / np.where(r == 0, 1.0, r) * (np.pi / 4)
    phi = np.where(wide, turn, np.pi / 2 - turn) + np.where(r < 0, np.pi, 0.0)
    return np.stack([np.arcsin(np.abs(r)), phi % (2 * np.pi)], axis=-1)


class SheetBSDF(AbstractBRDF):
    """The BSDF of a sheet by its four blocks, for each channel; f is NaN where the file holds no such block."""

    blocks: dict[str, tuple[ScatteringBlock | None, ...]]
    """By the names of `BLOCKS`; one entry a channel."""

    def only(self, channels: Sequence[int]) -> "SheetBSDF":
        """The sheet in these channels alone, by their numbers."""
        return SheetBSDF({name: tuple(blocks[k] for k in channels) for name, blocks in self.blocks.items()})

    def shared_patches(self) -> "list[tuple[str, list[int]]]":
        """(name of the block, channels) of each set of patches that channels share, in the order of a table's cells."""
        sets: list[tuple[str, list[int]]] = []
        for name in BLOCKS:
            known: list[tuple[np.ndarray, list[int]]] = []
            for channel, block in enumerate(self.blocks[name]):
                if block is None:
                    continue
                samples = block.samples()
                where = np.concatenate([samples.arriving, samples.leaving], axis=1)
                same = next((channels for places, channels in known if np.array_equal(places, where)), None)
                if same is None:
                    known.append((where, same := []))
                same.append(channel)
            sets += [(name, channels) for _, channels in known]
        return sets

    def directions(self, u: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        """(theta_i, phi_i, theta_o, phi_o) (n,), radians, in the middles of all patches of `shared_patches`.

        Args:
            u: (n, 4) in [0, 1): other places than the middles, even in projected solid angle.
        """
        angles, first = [], 0
        for name, channels in self.shared_patches():
            block = self.blocks[name][channels[0]]
            assert block is not None
            samples = block.samples()
            if u is not None:
                samples = block.within(u[first : first + len(samples.f)])
            first += len(samples.f)
            wi, wo = pair_of(name, samples.arriving, samples.leaving)
            angles.append(np.stack([*wi, *wo]))
        return tuple(np.concatenate(angles, axis=1))

    @property
    def hemispheres(self) -> Hemispheres:
        return EVERYWHERE

    @property
    def isotropic(self) -> bool:
        every = [b for blocks in self.blocks.values() for b in blocks if b is not None]
        return all(isinstance(b, Tree) and b.low.shape[1] == 3 for b in every)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        arriving, leaving = Direction(-wi.x, -wi.y, jnp.abs(wi.z)), Direction(wo.x, wo.y, jnp.abs(wo.z))
        front, kept = wi.z > 0, wi.z * wo.z > 0
        # In the order of BLOCKS
        lit = (front & kept, front & ~kept, ~front & ~kept, ~front & kept)
        values = [
            jnp.stack([jnp.asarray(jnp.nan) if b is None else b.value(arriving, leaving) for b in self.blocks[name]])
            for name in BLOCKS
        ]
        return jnp.select([jnp.broadcast_to(m, values[0].shape) for m in lit], values)
