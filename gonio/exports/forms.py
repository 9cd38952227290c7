"""The forms that a renderer has for a surface: numbers with domains, and f of them; and the appearance sought."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gonio.data.channels import Channels
from gonio.data.material import Material
from gonio.exports.pairs import Pairs, polar_pairs
from gonio.figures.spectral_colour import channel_colour
from gonio.models.brdf import AbstractBRDF, Scaled, terms
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.horizon import Hemispheres
from gonio.models.transmission.rough_dielectric import RoughDielectric

Values = Mapping[str, np.ndarray]
"""The numbers of a form by their names, of shape () or (C,)."""


@dataclasses.dataclass(frozen=True)
class Number:
    """A number of a form."""

    name: str
    low: float
    high: float
    start: float
    coloured: bool = False
    """Whether it has one value for each of red, green and blue."""
    log: bool = False
    width: bool = False
    """Whether it is the width α of a lobe, or √α of one, whose start is sought."""


@dataclasses.dataclass(frozen=True)
class Form:
    """One way in which a renderer can say a surface."""

    name: str
    numbers: tuple[Number, ...]
    f: Callable[[Values, Pairs], np.ndarray]
    """f (n, 1) or (n, C), 1/sr, of the numbers at pairs of directions."""
    describe: Callable[[Values], Any]
    """The renderer's own description of the numbers."""
    colours_mix: bool = False
    """Whether a colour's number changes other channels too."""
    transmits: bool = False
    """Whether `f` is that of pairs through the surface too; else nothing goes through."""


def fixed(form: Form, name: str, values: dict[str, float]) -> Form:
    """A form of which some numbers are given."""
    given = {key: np.asarray(value) for key, value in values.items()}
    return dataclasses.replace(
        form,
        name=name,
        numbers=tuple(n for n in form.numbers if n.name not in given),
        f=lambda v, pairs: form.f({**given, **v}, pairs),
        describe=lambda v: form.describe({**given, **v}),
    )


@dataclasses.dataclass(frozen=True)
class Appearance:
    """What a renderer is to show: the surface in linear sRGB, or grey (one channel)."""

    material: Material
    to_rgb: np.ndarray
    """(3, channels), or (1, 1) of a grey surface."""
    remarks: tuple[str, ...]
    """What became of the channels."""

    @property
    def colours(self) -> int:
        return len(self.to_rgb)

    @property
    def isotropic(self) -> bool:
        return self.material.brdf.isotropic

    @property
    def interface(self) -> bool:
        """Whether it is a rough interface between two media, which refracts."""
        return isinstance(self.material.brdf, RoughDielectric)

    @property
    def transmits(self) -> bool:
        return Hemispheres.TRANSMISSION in self.material.brdf.hemispheres

    def f(self, wi: Direction, wo: Direction) -> np.ndarray:
        """f of pairs of directions (n,) in the colours of the renderer, (n, C)."""
        values = evaluate_in_blocks(self.material.brdf, wi, wo)
        if values.shape[1] != self.to_rgb.shape[1]:
            values = np.broadcast_to(values, (len(values), self.to_rgb.shape[1]))
        return values @ self.to_rgb.T

    def pairs(self, lights: int, tilts: int, azimuths: int) -> Pairs:
        """A grid of pairs, with azimuths of the light for what is not isotropic."""
        if self.isotropic:
            return polar_pairs(lights, tilts, azimuths)
        return polar_pairs(lights // 2, tilts, azimuths, turns=4)

    @property
    def widths(self) -> list[float]:
        """The widths of the lobes, the narrowest first."""
        known = [t.facet_widths for t in self.material.brdf.terms()]
        return sorted({float(np.mean(w)) for widths in known for w in widths or ()})


def appearance_of(material: Material) -> Appearance:
    """The surface as renderers take colours. Raises GonioError for channels that have none."""
    channels = material.channels
    if len(channels) == 1:
        remarks = () if channels.wavelengths_nm is None else (f"grey: one channel, {channels.names[0]}",)
        return Appearance(material, np.eye(1), remarks)
    matrix, words = channel_colour(channels)
    if matrix is None:
        raise GonioError(f"{material.name} has no colour ({words}), and a renderer shows red, green and blue")
    remarks = () if channels.wavelengths_nm is None else (f"a spectrum became red, green and blue: {words}",)
    return Appearance(material, matrix, remarks)


def base_terms(brdf: AbstractBRDF) -> list[tuple[np.ndarray, AbstractBRDF]]:
    """(scale, model) of each term of a sum."""
    return [(np.asarray(t.scale), t.base) if isinstance(t, Scaled) else (np.ones(()), t) for t in terms(brdf)]


def plain(channels: Channels) -> bool:
    """Whether values of these channels are the renderer's own: grey, or red, green and blue."""
    return channels.wavelengths_nm is None or len(channels) == 1
