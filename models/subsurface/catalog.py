"""The models of light below the surface by the names that people and files spell them with."""

from gonio.models.subsurface.base import AbstractBSSRDF
from gonio.models.subsurface.better_dipole import BetterDipole
from gonio.models.subsurface.dipole import Dipole
from gonio.models.subsurface.normalised_diffusion import NormalisedDiffusion

BSSRDFS: dict[str, type[AbstractBSSRDF]] = {
    "dipole": Dipole,
    "better_dipole": BetterDipole,
    "normalised_diffusion": NormalisedDiffusion,
}
