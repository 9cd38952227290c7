"""First-order perturbation of a smooth interface: how its material and the polarisation weigh the scattered light."""

import jax.numpy as jnp

from gonio.models.arrays import Channels, Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.warps.grazing_azimuth import polar_parts


def polarisation_factor(wi: Direction, wo: Direction, eta: Channels, k: Channels | None) -> Scalar:
    """|q|² for unpolarised light, half of the sum over the four polarisations; symmetric in the two directions.

    In the mirror direction it is Fresnel's reflectance; near the normal |(n − 1)/(n + 1)|².

    Args:
        wi: direction to the light, above the horizon.
        wo: direction to the detector, above the horizon.
        eta: refractive index.
        k: extinction coefficient; None: a dielectric.

    References:
        Stover 2012, Optical Scattering, eq. 5.3 to 5.7; Church, Jenkinson & Zavada 1977.
    """
    # With s = sinθ, c = cosθ and ξ = √(ε − s²) of either direction; φ = 0 is the mirror side.
    n2 = (eta + 1j * (0.0 if k is None else k)) ** 2
    (s_i, x_i, y_i), (s_o, x_o, y_o) = polar_parts(wi), polar_parts(wo)
    cos_p, sin_p = -(x_i * x_o + y_i * y_o), x_i * y_o - y_i * x_o
    xi_i, xi_o = jnp.sqrt(n2 - s_i * s_i), jnp.sqrt(n2 - s_o * s_o)
    s_in, s_out = 1.0 / (wi.z + xi_i), 1.0 / (wo.z + xi_o)
    p_in, p_out = 1.0 / (n2 * wi.z + xi_i), 1.0 / (n2 * wo.z + xi_o)
    # ε s s′ − ξ ξ′ cosφ without the difference of its two terms, which are ε times larger than it towards grazing.
    s_s, beside = s_i * s_o, 0.5 * ((x_i + x_o) ** 2 + (y_i + y_o) ** 2)
    under = (wi.z * wi.z + s_i * s_i * wo.z * wo.z) / (1.0 + s_s)
    inside = (n2 * (s_i * s_i + s_o * s_o) - s_s * s_s) / (n2 + xi_i * xi_o)
    along = n2 * (beside - under) + cos_p * inside
    parts = (
        cos_p * s_in * s_out,
        sin_p * xi_o * s_in * p_out,
        sin_p * xi_i * p_in * s_out,
        along * p_in * p_out,
    )
    return 0.5 * _square(n2 - 1.0) * sum(map(_square, parts))


def _square(z: Scalar) -> Scalar:
    return z.real * z.real + z.imag * z.imag
