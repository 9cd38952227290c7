"""What a standard names: integrals of f, and the number that is made of them."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from gonio.metrology.standards.apertures import Rule

Combination = Callable[[np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True, eq=False)
class Aperture:
    """An integral of f over apertures of light and detector.

    Attributes:
        fine: the integral.
        coarse: the same by fewer nodes, whose difference from it bounds its error; None of single directions.
        images: polar angles of incidence, radians, and weights: what a mirrored image adds
            (`AbstractBRDF.mirror_reflectance`).
        mirror: whether the mirror direction, or what goes straight through, lies within, where narrow lobes are.
        moves: whether it is so near to the mirror direction that a lobe moves along with it.
        back: whether it is so near to the light's own direction that a lobe back to it may hide.
        around: whether the light comes from all azimuths, which a table lit from one reads by turning the surface.
        angles: of single directions their polar angles and azimuth difference, radians.
    """

    fine: Rule
    coarse: Rule | None = None
    images: tuple[tuple[float, float], ...] = ()
    mirror: bool = False
    moves: bool = False
    back: bool = False
    around: bool = False
    angles: tuple[float, float, float] | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Hemisphere:
    """∫ f |cosθo| dωo over the hemisphere in front of the sample, or behind it, of light at a polar angle, radians."""

    theta_i: float
    behind: bool = False


Integral = Aperture | Hemisphere


@dataclasses.dataclass(frozen=True, eq=False)
class StandardQuantity:
    """A number that a standard names.

    Attributes:
        name, standard: what it is called, and by whom.
        geometry: what is integrated here, in words.
        group: see `gonio.metrology.standards.catalog.GROUPS`.
        integrals: J of them.
        combine: from their values (J, C) to that of each channel (C,), or to one number () of them all.
        rough: the same made with less care, whose difference bounds its error; None where it is exact.
        whole: whether `combine` gives one number.
        least: the size of the number below which an uncertainty of that size leaves it known.
        other: standard uncertainty, by the integrals' values, of what is no integral of this subject.
        unit, place: of the number; the place tells it from others of its name.
    """

    name: str
    standard: str
    geometry: str
    group: str
    integrals: tuple[Integral, ...]
    combine: Combination = lambda values: values[0]
    rough: Combination | None = None
    whole: bool = False
    least: float = 0.0
    unit: str = "1"
    place: str = ""
    other: Callable[[np.ndarray], float] | None = None

    @property
    def angles(self) -> dict[str, float]:
        """Of a single pair of directions its angles in degrees."""
        only = self.integrals[0] if len(self.integrals) == 1 else None
        if not isinstance(only, Aperture) or only.angles is None:
            return {}
        names = ("theta_i", "theta_o", "delta_phi")
        return {n: round(math.degrees(a), 9) for n, a in zip(names, only.angles, strict=True)}
