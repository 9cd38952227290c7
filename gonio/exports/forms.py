"""The forms that a renderer has for a surface: numbers with domains, and f of them; and the appearance sought."""

import dataclasses
import functools
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
from gonio.models.transmission.either_side import AbstractEitherSide
from gonio.models.transmission.rough_dielectric import RoughDielectric

NORMAL = Direction(*np.eye(3)[2])
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


THROUGH = Number("through", 0.0, 1.0, 0.4, coloured=True)


def diffusing(form: Form, describe: Callable[[Values], Any]) -> Form:
    """A form that spreads light through the surface evenly too: `through`/π behind it."""

    def f(v: Values, pairs: Pairs) -> np.ndarray:
        if np.all(pairs.wo.z > 0):
            return form.f(v, pairs)
        return np.ones((pairs.wo.z.size, 1)) * v["through"] / np.pi

    name, numbers = f"{form.name} + a diffuser in transmission", (*form.numbers, THROUGH)
    return dataclasses.replace(form, name=name, numbers=numbers, f=f, describe=describe, transmits=True)


def weighed(through: np.ndarray) -> tuple[float, np.ndarray]:
    """(weight, colour) whose product is a transmitted colour: the least weight, which leaves most to reflect."""
    weight = float(np.max(through))
    return weight, through / weight if weight > 0 else np.ones_like(through)


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

    @functools.cached_property
    def two_faced(self) -> bool:
        """Whether the back of a sheet reflects otherwise than its front."""
        if Hemispheres.BACK not in self.material.brdf.hemispheres or self.interface:
            return False
        pairs = self.pairs(4, 8, 4)
        wi, wo = (Direction(w.x, w.y, -w.z) for w in (pairs.wi, pairs.wo))
        return not np.allclose(self.f(pairs.wi, pairs.wo), self.f(wi, wo), rtol=1e-3)

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
        """The widths of the lobes that are known, the narrowest first."""
        known = [t.facet_widths for t in self._lobes]
        return sorted({float(np.mean(w)) for widths in known for w in widths or ()})

    @property
    def widths_known(self) -> bool:
        """Whether the width of every lobe is."""
        return all(t.facet_widths is not None for t in self._lobes if t.lobe)

    @property
    def _lobes(self) -> list[AbstractBRDF]:
        """The models of the terms, those of a sheet as they stand for light from in front."""
        each = [model for _, model in base_terms(self.material.brdf)]
        return [m.facing(NORMAL) if isinstance(m, AbstractEitherSide) else m for m in each]


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
    """(scale, model) of each term of a sum, of a composite each of its own; an interface is one."""
    split = [_scaled(part) for part in terms(brdf)]
    parts = [
        (scale * inner, base)
        for scale, model in split
        for inner, base in ([(1.0, model)] if isinstance(model, RoughDielectric) else map(_scaled, model.terms()))
    ]
    return [(np.asarray(scale), base) for scale, base in parts]


def _scaled(term: AbstractBRDF) -> tuple[np.ndarray, AbstractBRDF]:
    return (np.asarray(term.scale), term.base) if isinstance(term, Scaled) else (np.ones(()), term)


def plain(channels: Channels) -> bool:
    """Whether values of these channels are the renderer's own: grey, or red, green and blue."""
    return channels.wavelengths_nm is None or len(channels) == 1
