"""RGL's adaptive parameterisation [Dupuy 2018]: measured data read between its samples by the format's own
warp.

The unit square of the samples is bent onto the half vectors by the distribution of visible normals of each
incidence (a marginal over rows, then a conditional over columns, of a bilinear density); the inverse of this
warp, at the half vector of a pair of directions, says where to read the spectra. Maps: θ = u²π/2, φ = (2u −
1)π.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.data.interpolation.rgl_data import RGLData
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction, half_vector, to_spherical

Slices = tuple[tuple[Array, Array], Array]
"""((phi numbers, theta numbers), weights) of the stored incidences around one."""


class Place(NamedTuple):
    """Where the arrays of a file are read for one pair of directions."""

    slices: Slices
    x: Array
    y: Array
    """Position among the samples of `spectra`, in [0, 1]."""
    u_x: Array
    u_y: Array
    """Position in `ndf`: of the half vector."""
    i_x: Array
    i_y: Array
    """Position in `sigma`: of the light."""


class RGLMaterial(AbstractBRDF):
    """A material of the RGL database: f(wi, wo) in 1/sr, without the cosine that the files include.

    Reproduces Mitsuba's `measured` plugin. Real files hold negative values; they are kept. Below the horizon
    f is 0.
    """

    theta_i: Float[Array, " theta"]
    phi_i: Float[Array, " phi"]
    ndf: Float[Array, "height width"]
    sigma: Float[Array, "height width"]
    vndf: Float[Array, "phi theta h w"]
    conditional: Float[Array, "phi theta h w"]
    marginal: Float[Array, "phi theta h"]
    spectra: Float[Array, "phi theta r r channel"]
    same_all_round: bool = eqx.field(static=True)
    reduction: int = eqx.field(static=True)
    jacobian: bool = eqx.field(static=True)

    def __init__(self, data: RGLData) -> None:
        dtype = jnp.result_type(float)
        vndf, conditional, marginal = data.warp
        self.theta_i, self.phi_i = jnp.asarray(data.theta_i, dtype), jnp.asarray(data.phi_i, dtype)
        self.ndf, self.sigma = jnp.asarray(data.ndf, dtype), jnp.asarray(data.sigma, dtype)
        self.vndf, self.conditional = jnp.asarray(vndf, dtype), jnp.asarray(conditional, dtype)
        self.marginal = jnp.asarray(marginal, dtype)
        self.spectra = jnp.asarray(np.moveaxis(data.spectra, 2, -1), dtype)
        self.same_all_round, self.reduction, self.jacobian = data.isotropic, data.reduction, data.jacobian

    @property
    def isotropic(self) -> bool:
        return self.same_all_round

    def only(self, channels: Sequence[int]) -> "RGLMaterial":
        """The material in these channels alone, by their numbers."""
        return eqx.tree_at(lambda m: m.spectra, self, self.spectra[..., np.asarray(channels)])

    def formula(self, wi: Direction, wo: Direction) -> Float[Array, " channel"]:
        place = self.place(wi, wo)
        value = _bilinear(self.spectra, place.slices, place.x, place.y)
        if self.jacobian:
            sigma = _bilinear(self.sigma, None, place.i_x, place.i_y)
            ndf = _bilinear(self.ndf, None, place.u_x, place.u_y)
            value = value * (ndf / (4 * jnp.where(sigma > 0, sigma, jnp.inf)))
        return value / wo.z

    def place(self, wi: Direction, wo: Direction) -> Place:
        """Where the value of a pair of directions is read."""
        wi, wo = self._reduced(wi, wo)
        theta_i, phi_i = _spherical(wi)
        theta_m, phi_m = _spherical(half_vector(wi, wo))
        if self.same_all_round:
            phi_m = phi_m - phi_i
        u_x = jnp.sqrt(theta_m * (2 / jnp.pi))
        u_y = jnp.mod((phi_m + jnp.pi) / (2 * jnp.pi), 1.0)
        slices = _slices(self.phi_i, self.theta_i, phi_i, theta_i)
        x, y = self._inverse_warp(slices, u_x, u_y)
        return Place(slices, x, y, u_x, u_y, jnp.sqrt(theta_i * (2 / jnp.pi)), (phi_i + jnp.pi) / (2 * jnp.pi))

    def _reduced(self, wi: Direction, wo: Direction) -> tuple[Direction, Direction]:
        """Both directions in the sector of azimuths that the file stores: (−π, −π/2), (−π, 0) or all.

        Isotropic files too are read with wi.y < 0: it matters only where an azimuth is undefined, at normal
        incidence and for the mirror direction. There the samples that meet in one direction differ, and this
        is the choice that Mitsuba makes (the azimuth of a vector at the pole is 0).
        """
        reduction = 2 if self.same_all_round else self.reduction
        if reduction < 2:
            return wi, wo
        flip_y = jnp.where(wi.y >= 0, -1.0, 1.0)
        flip_x = jnp.where(wi.x >= 0, -1.0, 1.0) if reduction == 4 else flip_y
        return Direction(wi.x * flip_x, wi.y * flip_y, wi.z), Direction(wo.x * flip_x, wo.y * flip_y, wo.z)

    def _inverse_warp(self, slices: Slices, u_x: Array, u_y: Array) -> tuple[Array, Array]:
        """The sample (x, y) in the unit square whose warped position is (u_x, u_y)."""
        h, w = self.vndf.shape[-2:]
        (x0, t_x), (y0, t_y) = _cell(u_x, w), _cell(u_y, h)

        def between_rows(values: Array, column: Any) -> Array:
            return _mix(_of_slices(values, slices, y0, column), _of_slices(values, slices, y0 + 1, column), t_y)

        along, below = [between_rows(self.vndf, x0 + i) for i in (0, 1)], between_rows(self.conditional, x0)
        r0, r1 = (_of_slices(self.conditional, slices, y0 + k, w - 1) for k in (0, 1))
        row = _mix(r0, r1, t_y)
        x = (below + t_x * (along[0] + 0.5 * t_x * (along[1] - along[0]))) / jnp.where(row > 0, row, 1.0)
        y = _of_slices(self.marginal, slices, y0) + t_y * (r0 + 0.5 * t_y * (r1 - r0))
        return x, y


def _spherical(w: Direction) -> tuple[Array, Array]:
    theta, phi = to_spherical(w)
    return theta, jnp.where(phi > jnp.pi, phi - 2 * jnp.pi, phi)


def _mix(a: Array, b: Array, t: Array) -> Array:
    return (1.0 - t) * a + t * b


def _cell(u: Array, nodes: int) -> tuple[Array, Array]:
    """(lower node, position inside the cell) of a coordinate in [0, 1] over equally spaced nodes."""
    scaled = jnp.clip(u, 0.0, 1.0) * (nodes - 1)
    low = jnp.clip(jnp.floor(scaled), 0, nodes - 2).astype(jnp.int32)
    return low, scaled - low


def _slices(phi_nodes: Array, theta_nodes: Array, phi: Array, theta: Array) -> Slices:
    """((phi numbers, theta numbers), weights), each 2 × 2 (1 × 2 for a single phi), of the stored incidences."""
    numbers, weights = [], []
    for nodes, x in ((phi_nodes, phi), (theta_nodes, theta)):
        n = nodes.shape[0]
        if n == 1:
            numbers.append(jnp.zeros(1, jnp.int32))
            weights.append(jnp.ones_like(x)[None])
            continue
        low = jnp.clip(jnp.searchsorted(nodes, x, side="right") - 1, 0, n - 2).astype(jnp.int32)
        t = jnp.clip((x - nodes[low]) / (nodes[low + 1] - nodes[low]), 0.0, 1.0)
        numbers.append(jnp.stack([low, low + 1]))
        weights.append(jnp.stack([1.0 - t, t]))
    p, t = jnp.meshgrid(*numbers, indexing="ij")
    return (p, t), weights[0][:, None] * weights[1][None, :]


def _of_slices(values: Array, slices: Slices, *node: Any) -> Array:
    """Values at one node, interpolated over the incidence; a trailing channel axis is kept."""
    (p, t), weight = slices
    corners = values[(p, t, *node)]
    return jnp.sum(corners * weight.reshape(weight.shape + (1,) * (corners.ndim - 2)), axis=(0, 1))


def _bilinear(values: Array, slices: Slices | None, x: Array, y: Array) -> Array:
    rows, columns = values.shape[:2] if slices is None else values.shape[2:4]
    (x0, t_x), (y0, t_y) = _cell(x, columns), _cell(y, rows)

    def look_up(row: Array, column: Array) -> Array:
        return values[row, column] if slices is None else _of_slices(values, slices, row, column)

    (a, b), (c, d) = [[look_up(y0 + j, x0 + i) for i in (0, 1)] for j in (0, 1)]
    return _mix(_mix(a, b, t_x), _mix(c, d, t_x), t_y)
