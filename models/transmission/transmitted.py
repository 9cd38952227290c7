"""Lobes about the direction straight through a sheet."""

from collections.abc import Mapping

import equinox as eqx

from gonio.models.brdf import AbstractBRDF, Channels, Direction, parameter
from gonio.models.empirical.phong import EXPONENT, Phong
from gonio.models.errors import GonioError
from gonio.models.geometry.horizon import Hemispheres
from gonio.models.transmission.either_side import AbstractEitherSide
from gonio.models.transmission.lambert_transmission import TRANSMITTANCE


class CosinePowerTransmission(AbstractEitherSide):
    """f_t = τ (n + 2)/(2π) cosⁿα, α the angle from straight through: a diffuser that transmits τ at normal incidence.

    There α is the angle of the detector, the textbook's cosⁿθ; at other incidences it is counted from the direction of
    the light, which is reciprocal, as cosⁿθ would not be. Narrow lobes then transmit τ cosθi.
    """

    tau: Channels = parameter(TRANSMITTANCE)
    n: Channels = parameter(EXPONENT)

    @property
    def through(self) -> bool:
        return True

    @property
    def isotropic(self) -> bool:
        return True

    def facing(self, wi: Direction) -> AbstractBRDF:
        return self.tau * Phong(n=self.n)


class Transmitted(AbstractEitherSide):
    """f_t(i→o) = f_base(i, o mirrored at the sheet): the lobe of any model that reflects, sent straight through.

    `0.85 * transmitted(base=beckmann(alpha=0.2))` is a ground glass, `transmitted(base=abg(...))` the scatter of a
    window. The same from either side, and reciprocal where the base is; the base's albedo is its transmittance.
    """

    base: AbstractBRDF = eqx.field(metadata={"model": True})

    def __check_init__(self) -> None:
        if self.base.hemispheres != Hemispheres.REFLECTION:
            raise GonioError("the base of transmitted(...) transmits already; give a model that only reflects")

    @property
    def through(self) -> bool:
        return True

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic

    @property
    def symmetric(self) -> bool:
        return self.base.symmetric

    @property
    def violates(self) -> Mapping[str, str]:
        return self.base.violates

    @property
    def loses_energy(self) -> str:
        return self.base.loses_energy

    @property
    def accuracy(self) -> float:
        return self.base.accuracy

    def terms(self) -> tuple[AbstractBRDF, ...]:
        return tuple(Transmitted(base=part) for part in self.base.terms())

    def facing(self, wi: Direction) -> AbstractBRDF:
        return self.base
