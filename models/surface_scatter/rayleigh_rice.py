"""Scatter of a polished surface by the power spectral density of its heights."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from gonio.models.brdf import Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.errors import GonioError
from gonio.models.fresnel import fresnel
from gonio.models.microfacet.base import ETA, K
from gonio.models.surface_scatter import power_spectra as spectra
from gonio.models.surface_scatter.he_torrance import SIGMA, TAU, WAVELENGTH
from gonio.models.surface_scatter.perturbation import polarisation_factor
from gonio.models.surface_scatter.shift_invariant import AbstractDiscLobe
from gonio.models.warps.direction_cosines import projected_distance2

ABC, GAUSSIAN, FRACTAL, TABLE = "abc", "gaussian", "fractal", "table"
A = ParameterInfo(
    0.0, 1e6, "µm⁴", "spectral density at frequency 0", start=0.01, role="scale", linear=True, only=("spectrum", ABC)
)
B = ParameterInfo(
    1e-2, 1e6, "µm", "inverse frequency where it falls", start=100.0, role="length", log=True, only=("spectrum", ABC)
)
C = ParameterInfo(0.1, 10.0, "1", "power of its fall", start=2.5, role="exponent", only=("spectrum", ABC))
G_SIGMA, G_TAU = (
    ParameterInfo(**{**vars(info), "only": ("spectrum", GAUSSIAN), "start": start})
    for info, start in ((SIGMA, 0.005), (TAU, 3.0))
)
STRENGTH = ParameterInfo(
    0.0, 1.0, "µm^(4−p)", "density of a fractal at 1/µm", start=1e-7, role="scale", linear=True,
    only=("spectrum", FRACTAL),
)  # fmt: skip
POWER = ParameterInfo(
    0.1, 8.0, "1", "power p of a fractal's fall", start=2.5, role="exponent", only=("spectrum", FRACTAL)
)
LOWEST = ParameterInfo(
    1e-6, 10.0, "1/µm", "frequency below which a fractal is level", start=0.01, role="shoulder", log=True,
    only=("spectrum", FRACTAL),
)  # fmt: skip

MOST_PHASE = 0.3
"""4πσ/λ above which the first order errs by more than some percent."""
MOST_SLOPE = 0.1
SLOPE_NODES = 2000


class RayleighRice(AbstractDiscLobe):
    """f = (16π²/λ⁴) cosθi cosθo |q|² S2(|β−β₀|/λ): first-order scatter of a polished surface [Rice 1951].

    S2 is the two-dimensional power spectral density of the heights, by `spectrum`: "abc", a/(1+b²f²)^(c/2), also called
    K-correlation; "gaussian", of rms height `sigma` and autocorrelation length `tau`; "fractal", strength·f^(−power)
    from the frequency `lowest` on; "table", psd="f:S2 f:S2 …", f in 1/µm and S2 in µm⁴. |q|² is the unpolarised factor
    of the material, `eta` (and `k`). Lengths and `wavelength` in µm.
    f is the scattered light alone. The image of the source, `specular`, is R exp(−(4πσ cosθi/λ)²), with σ over the
    frequencies up to 1/λ: no table holds it, and `gonio check` counts it. Made for 4πσ cosθ/λ ≪ 1 and small slopes.
    """

    violates: ClassVar = {"energy": "Beyond 4πσ/λ ≪ 1: f grows with σ² without limit."}

    wavelength: Channels = parameter(WAVELENGTH)
    eta: Channels = parameter(ETA)
    k: Channels | None = parameter(K, default=None)
    a: Channels | None = parameter(A, default=None)
    b: Channels | None = parameter(B, default=None)
    c: Channels | None = parameter(C, default=None)
    sigma: Channels | None = parameter(G_SIGMA, default=None)
    tau: Channels | None = parameter(G_TAU, default=None)
    strength: Channels | None = parameter(STRENGTH, default=None)
    power: Channels | None = parameter(POWER, default=None)
    lowest: Channels | None = parameter(LOWEST, default=None)
    spectrum: str = eqx.field(static=True, default=ABC, metadata={"choices": (ABC, GAUSSIAN, FRACTAL, TABLE)})
    psd: str = eqx.field(static=True, default="", metadata={"choices": ()})

    def __check_init__(self) -> None:
        if (self.spectrum == TABLE) != bool(self.psd):
            raise GonioError(
                f'rayleigh_rice has the spectrum "{self.spectrum}" and {"a" if self.psd else "no"} psd; give both'
                ' spectrum="table" and psd="f:S2 f:S2 ...", or neither'
            )
        if self.psd:
            spectra.TabulatedSpectrum(self.psd)

    @property
    def _numbers(self) -> tuple[Scalar, ...]:
        names = {ABC: "a b c", GAUSSIAN: "sigma tau", FRACTAL: "strength power lowest", TABLE: ""}[self.spectrum]
        return tuple(getattr(self, name) for name in names.split())

    def _form(self, name: str) -> Callable[[Scalar], Scalar]:
        if self.spectrum == TABLE:
            return getattr(spectra.TabulatedSpectrum(self.psd), name)
        form = getattr(spectra, f"{self.spectrum}_{name}")
        return lambda f: form(f, *self._numbers)

    def density(self, f2: Scalar) -> Scalar:
        """S2, µm⁴, by the square of the frequency, 1/µm²."""
        return self._form("density")(f2)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        inverse2 = 1.0 / (self.wavelength * self.wavelength)
        density = self.density(projected_distance2(wi, wo) * inverse2)
        material = polarisation_factor(wi, wo, self.eta, self.k)
        return (16 * jnp.pi**2) * (wi.z * wo.z) * material * density * inverse2 * inverse2

    def core(self, wi: Direction) -> tuple[Channels, Channels]:
        if self.spectrum == ABC:
            _, length, fall = self._numbers
            return self.wavelength / length, 0.5 * fall
        if self.spectrum == GAUSSIAN:
            return self.wavelength / (jnp.pi * self._numbers[1]), jnp.ones_like(self._numbers[1])
        if self.spectrum == FRACTAL:
            _, power, lowest = self._numbers
            return self.wavelength * lowest, 0.5 * power
        table = spectra.TabulatedSpectrum(self.psd)
        return self.wavelength * table.lowest, jnp.full_like(self.wavelength, 0.5 * table.mean_power)

    @property
    def reach(self) -> float:
        return 60.0 if self.spectrum == GAUSSIAN else 1e30

    def rms_height(self, low: float = 0.0, high: float | None = None) -> Channels:
        """σ, µm, over the spatial frequencies from `low` to `high`, 1/µm; by default up to 1/λ, which scatter light.

        Raises:
            GonioError: for a band that is none.
        """
        variance = self._form("variance")
        if high is None:
            top = 1.0 / self.wavelength
        else:
            low, high = spectra.half_open_band(low, high)
            top = jnp.asarray(high, self.wavelength.dtype)
        bottom = jnp.asarray(low, self.wavelength.dtype)
        return jnp.sqrt(jnp.maximum(variance(top) - variance(bottom), 0.0))

    def mirror_reflectance(self, wi: Direction) -> Channels:
        phase = 4 * jnp.pi * self.rms_height() * wi.z / self.wavelength
        return fresnel(wi.z, None, self.eta, self.k) * jnp.exp(-phase * phase)

    @property
    def validity_notes(self) -> tuple[str, ...]:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return ()
        wavelength = np.atleast_1d(np.asarray(self.wavelength, float))
        sigma = np.atleast_1d(np.asarray(self.rms_height(), float))
        phase = float(np.max(4 * np.pi * sigma / wavelength))
        frequencies = np.geomspace(1e-6, 1.0, SLOPE_NODES)[:, None] / wavelength
        density = np.broadcast_to(np.asarray(self.density(jnp.asarray(frequencies**2))), frequencies.shape)
        slope = max(float(spectra.rms_slope(f, d[:, None])[0]) for f, d in zip(frequencies.T, density.T, strict=True))
        notes = []
        if phase > MOST_PHASE:
            notes.append(
                f"rayleigh_rice is made for 4πσ cosθ/λ ≪ 1; here 4πσ/λ is {phase:.3g} (σ {float(sigma.max()):.3g} µm up"
                " to the frequency 1/λ): he_torrance has no such limit"
            )
        if slope > MOST_SLOPE:
            notes.append(f"rayleigh_rice is made for small slopes; here their rms is {slope:.3g} up to 1/λ")
        return tuple(notes)


def total_integrated_scatter(sigma: Scalar, wavelength: Scalar, cos_i: Scalar = 1.0) -> Scalar:
    """TIS = (4πσ cosθi/λ)², the scattered share of what a smooth surface reflects [Bennett & Porteus 1961].

    `sigma`, the rms height over the frequencies that scatter, and `wavelength` in one unit; small against 1.
    """
    return (4 * jnp.pi * sigma * cos_i / wavelength) ** 2
