"""Materials: a model with its name, channels and source; from a name, a file or an expression, and to a file."""

import dataclasses
import importlib
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.angles import SLACK, as_numbers, broadcast, radian_arrays
from gonio.data.channels import Channels
from gonio.data.layouts import spherical_angles
from gonio.models.deprecation import renamed_attribute
from gonio.models.display import Displayed, listed
from gonio.models.errors import GonioError, printable
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.sides import Hemispheres

if TYPE_CHECKING:
    from gonio.models.albedo import Estimate
    from gonio.models.brdf import AbstractBRDF


@dataclasses.dataclass(frozen=True, repr=False)
class Material(Displayed):
    """A BRDF that knows what it is: whatever takes a material takes this.

    `expression` is None where the model has none (an interpolated table). `channels` are those of the model's values;
    `source` says where the numbers come from; `meta` is anything JSON can hold (`fit`: how it was fitted; `file`).
    """

    name: str
    brdf: "AbstractBRDF"
    expression: str | None
    channels: Channels
    description: str = ""
    source: str = ""
    meta: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", printable(self.name))

    def __hash__(self) -> int:
        return hash((self.name, self.expression))

    spelling = renamed_attribute("spelling", "expression")

    def f(
        self, theta_i: ArrayLike, phi_i: ArrayLike, theta_o: ArrayLike, phi_o: ArrayLike, degrees: bool = False
    ) -> np.ndarray:
        """BRDF values, and BTDF values where the detector is on the other side, 1/sr, without the cosine.

        Args:
            theta_i: polar angle of the direction to the light, [0, π]; beyond π/2 it is behind the material.
            phi_i: its azimuth.
            theta_o: polar angle of the direction to the detector, [0, π]; below the horizon f is 0 of a material that
                only reflects.
            phi_o: its azimuth.
            degrees: whether the angles are degrees; else radians.

        Returns:
            Array of the angles' broadcast shape + (channels,); the last axis has length 1 for a grey material.

        Raises:
            GonioError: angles out of range, or shapes that do not broadcast.
        """
        from gonio.models.evaluation import evaluate

        wi, wo = _pair(radian_arrays(degrees, True, theta_i=theta_i, phi_i=phi_i, theta_o=theta_o, phi_o=phi_o))
        return self._by_channel(evaluate(self.brdf, wi, wo), wi.z.shape)

    def sample(
        self, theta_i: ArrayLike, phi_i: ArrayLike, u1: ArrayLike, u2: ArrayLike, degrees: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Directions that the importance sampler draws, by two uniform random numbers each.

        Args:
            theta_i: polar angle of the light, as of `f`.
            phi_i: its azimuth.
            u1: uniform random numbers in [0, 1].
            u2: others.
            degrees: whether all angles, those of the result too, are degrees; else radians.

        Returns:
            (theta_o, phi_o), each of the arguments' broadcast shape. theta_o may lie below the horizon, where f is 0.
            Of light that does not leave the surface (total reflection below a coat) it is π, and pdf is 0 there: count
            its weight f cosθ/pdf as 0. Of a material that transmits it is then not a number.

        Raises:
            GonioError: as `f` does, for u1 or u2 out of range, and without a sampler.
        """
        from gonio.models.evaluation import sampled_directions

        angles = radian_arrays(degrees, self._transmits, theta_i=theta_i, phi_i=phi_i)
        uniform = {name: as_numbers(name, u) for name, u in (("u1", u1), ("u2", u2))}
        for name, u in uniform.items():
            if not ((u >= 0) & (u <= 1)).all():
                raise GonioError(f"{name} leaves [0, 1]; give uniform random numbers")
        theta, phi, first, second = broadcast(theta_i=angles[0], phi_i=angles[1], **uniform)
        wi = Direction(*(c.ravel() for c in from_spherical(theta, phi, np)))
        try:
            directions = sampled_directions(self.brdf, wi, first.ravel(), second.ravel())
        except NotImplementedError:
            raise GonioError(f"{self.name} has no sampler; evaluate it with f") from None
        result = spherical_angles(*(np.asarray(c, np.float64).reshape(theta.shape) for c in directions))
        return (np.degrees(result[0]), np.degrees(result[1])) if degrees else result

    def pdf(
        self, theta_i: ArrayLike, phi_i: ArrayLike, theta_o: ArrayLike, phi_o: ArrayLike, degrees: bool = False
    ) -> np.ndarray:
        """Density of the directions that `sample` draws, per steradian.

        Args:
            theta_i, phi_i, theta_o, phi_o: angles of light and detector, as of `f`.
            degrees: whether they are degrees; else radians.

        Returns:
            Array of the angles' broadcast shape; all channels have one sampler.

        Raises:
            GonioError: as `f` does.
        """
        from gonio.models.evaluation import sampling_density

        wi, wo = _pair(radian_arrays(degrees, True, theta_i=theta_i, phi_i=phi_i, theta_o=theta_o, phi_o=phi_o))
        return np.asarray(sampling_density(self.brdf, wi, wo))

    def albedo(
        self, theta_i: ArrayLike, phi_i: ArrayLike = 0.0, degrees: bool = False, tolerance: float = 1e-6
    ) -> "Estimate":
        """Share of the light from (theta_i, phi_i) that is reflected, with a bound on the error of the integral.

        Args:
            theta_i: polar angle of incidence, [0, π/2), or (π/2, π] for light from behind a material that transmits.
            phi_i: its azimuth.
            degrees: whether the angles are degrees; else radians.
            tolerance: absolute error asked for; a larger `bound` says that it was not met.

        Returns:
            `value` and `bound` of the angles' broadcast shape + (channels,), and the `evaluations` of f.
        """
        from gonio.models.albedo import directional_albedo

        return self._share(directional_albedo, theta_i, phi_i, degrees, tolerance)

    def transmittance(
        self, theta_i: ArrayLike, phi_i: ArrayLike = 0.0, degrees: bool = False, tolerance: float = 1e-6
    ) -> "Estimate":
        """Share of the light from (theta_i, phi_i) that leaves on the other side, with a bound on the integral's error.

        Args:
            theta_i, phi_i, degrees, tolerance: as of `albedo`.

        Returns:
            `value`, `bound` and `evaluations` as of `albedo`.
        """
        from gonio.models.albedo import directional_transmittance

        return self._share(directional_transmittance, theta_i, phi_i, degrees, tolerance)

    @property
    def _transmits(self) -> bool:
        return Hemispheres.TRANSMISSION in self.brdf.hemispheres

    def _share(
        self,
        integral: "Callable[..., Estimate]",
        theta_i: ArrayLike,
        phi_i: ArrayLike,
        degrees: bool,
        tolerance: float,
    ) -> "Estimate":
        theta, phi = radian_arrays(degrees, self._transmits, theta_i=theta_i, phi_i=phi_i)
        above = np.abs(theta - math.pi / 2) > SLACK if self._transmits else theta < math.pi / 2
        if not above.all():
            raise GonioError("theta_i reaches the horizon, where no light arrives; give angles below 90 degrees")
        estimate = integral(self.brdf, theta, phi, tolerance)
        value, bound = (self._by_channel(a, theta.shape) for a in (estimate.value, estimate.bound))
        return estimate._replace(value=value, bound=bound)

    def gradient(
        self, theta_i: ArrayLike, phi_i: ArrayLike, theta_o: ArrayLike, phi_o: ArrayLike, degrees: bool = False
    ) -> dict[str, np.ndarray]:
        """Derivatives of f by the model's parameters.

        Args:
            theta_i, phi_i, theta_o, phi_o: angles of light and detector, as of `f`.
            degrees: whether they are degrees; else radians. No derivative is by an angle.

        Returns:
            Arrays of the shape of `f`, by the parameter's name, such as 'ggx.alpha'. Of a parameter with one value for
            each channel: each channel's derivative by its own value. Empty for an interpolated table.

        Raises:
            GonioError: as `f` does.
        """
        from gonio.models.expression.derivatives import parameter_derivatives

        wi, wo = _pair(radian_arrays(degrees, True, theta_i=theta_i, phi_i=phi_i, theta_o=theta_o, phi_o=phi_o))
        if self.expression is None:
            return {}
        shape = np.broadcast_shapes(*(np.shape(c) for c in (*wi, *wo)))
        return {k: self._by_channel(d, shape) for k, d in parameter_derivatives(self.brdf, wi, wo).items()}

    def save(self, path: str | os.PathLike[str], force: bool = False) -> Path:
        """Writes the material as TOML, whole or not at all, and returns the path.

        Raises GonioError where `path` exists (unless `force`) or cannot be written, and for a table's interpolant.
        """
        return importlib.import_module("gonio.data").write_material(path, self, force)

    def _by_channel(self, values: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
        array = np.asarray(values)
        array = array[..., None] if array.ndim == len(shape) else array
        return np.array(np.broadcast_to(array, (*shape, len(self.channels))))

    def facts(self) -> dict[str, str]:
        """Name, model, channels, source, and where the model is used beyond what it is made for."""
        return {
            "name": self.name,
            "model": self.expression or self.description or type(self.brdf).__name__,
            "channels": f"{len(self.channels)}: {listed(self.channels.names)}",
            "source": self.source,
            "note": "; ".join(self.brdf.validity_notes),
        }


def _pair(angles: list[np.ndarray]) -> tuple[Direction, Direction]:
    theta_i, phi_i, theta_o, phi_o = angles
    return from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)


def channels_of(brdf: "AbstractBRDF") -> Channels:
    """The channels of a model that does not name them: its wavelengths, where it has one each, else by their count."""
    from gonio.models.evaluation import channel_count
    from gonio.models.expression.wavelengths import wavelengths_of

    count, wavelengths = channel_count(brdf) or 1, wavelengths_of(brdf)
    if wavelengths is not None and len(set(wavelengths)) == count:
        return Channels.of_wavelengths(wavelengths)
    return Channels.of_count(count)


def material_of(brdf: "AbstractBRDF") -> Material:
    """A bare model as a material: its expression, where it has one, is its name."""
    from gonio.models.expression.builder import to_expression

    try:
        expression = to_expression(brdf)
    except GonioError:
        expression = None
    return Material(expression or type(brdf).__name__, brdf, expression, channels_of(brdf))
