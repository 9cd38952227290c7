"""What a search for a renderer's numbers makes small: differences of f, and of what a lit surface shows of them.

Differences of f itself, weighted as the error that every export prints, are those of highlights alone where there are
any. Beside them stand differences of cube roots of π f cosθi, as a fit of a table has, over directions of which half
are spread as a diffuser reflects and half as the surface itself does; and of cube roots of each incidence's albedo.
"""

import dataclasses

import numpy as np

from gonio.exports.forms import Appearance, Form, Values
from gonio.exports.pairs import LOWEST, Pairs, joined

DARK = 1e-4
"""Of π f cosθi: what is darker counts by its difference."""
ROOT = 3.0
"""By how much smaller a relative difference is in a cube root."""
SHOWN = 0.3
"""Weight of the relative differences of roots, where those of f have 1."""
GAIN = 10.0
"""Weight of what is reflected beyond all light, and beyond what the surface reflects."""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A surface at pairs of directions, to which others are compared.

    `sides`: pairs in front of the surface and, where light goes through it, behind; `pairs`: those of all sides.
    """

    sides: tuple[Pairs, ...]
    pairs: Pairs
    wanted: np.ndarray
    """f (n, C)."""
    weight: np.ndarray
    """Of the differences of f, (n, 1): their squares sum to the square of the relative rms."""
    root_weight: np.ndarray
    albedo_weight: np.ndarray

    def values(self, form: Form, numbers: Values) -> np.ndarray:
        """f (n, C) of a form; nothing behind where it only reflects."""
        shape, values = (self.sides[0].flux.size, self.wanted.shape[1]), []
        for side in self.sides:
            silent = side is not self.sides[0] and not form.transmits
            values.append(np.zeros(shape) if silent else np.broadcast_to(form.f(numbers, side), shape))
        return np.concatenate(values)

    def residuals(self, f: np.ndarray) -> np.ndarray:
        """(residuals, C): the squares sum to those of `relative_rms`, of weighted `shown` and of light made."""
        made = GAIN * np.sqrt(self.sides[0].share)[:, None] * self._made(f)
        return np.concatenate([self.weight * (f - self.wanted), SHOWN * self._roots(f), made])

    def light_made(self, f: np.ndarray) -> float:
        """By how much more than all light, and than the surface scatters, a light up to 86° is scattered at most."""
        return float(self._made(f)[self.sides[0].cosines >= LOWEST].max(initial=0.0))

    def relative_rms(self, f: np.ndarray) -> float:
        """√(∫∫ (f − wanted)² cosθi cosθo dωi dωo / ∫∫ wanted² cosθi cosθo dωi dωo)."""
        return float(np.sqrt(np.sum((self.weight * (f - self.wanted)) ** 2)))

    def shown(self, f: np.ndarray) -> float:
        """The relative distance of the roots."""
        return float(np.sqrt(np.sum(self._roots(f) ** 2)))

    @property
    def scattered(self) -> float:
        """Share of diffuse light that the surface reflects or transmits, by these pairs, of the channels' mean."""
        return float(np.pi * np.sum(self.pairs.weight * self.wanted.mean(axis=1)))

    def _made(self, f: np.ndarray) -> np.ndarray:
        ours, wanted = (
            self.pairs.albedo(v).reshape(len(self.sides), -1, self.wanted.shape[1]).sum(axis=0)
            for v in (f, self.wanted)
        )
        return np.maximum(ours - np.maximum(wanted, 1.0), 0.0)

    def _roots(self, f: np.ndarray) -> np.ndarray:
        exposure = np.pi * self.pairs.wi.z[:, None]
        points = _root(f * exposure) - _root(self.wanted * exposure)
        albedos = _root(self.pairs.albedo(f)) - _root(self.pairs.albedo(self.wanted))
        return np.concatenate([self.root_weight * points, self.albedo_weight * albedos])


def comparison(sought: Appearance, grid: tuple[int, int, int]) -> Comparison:
    """A surface at (lights, tilts, azimuths), in front and, where it transmits, behind."""
    front = sought.pairs(*grid)
    sides = (front, front.through()) if sought.transmits else (front,)
    pairs = joined(*sides) if sought.transmits else front
    wanted = sought.f(pairs.wi, pairs.wo)
    mean = np.maximum(wanted.mean(axis=1), 0.0)
    reflected = pairs.albedo(mean[:, None])[:, 0]
    share = pairs.flux / np.pi + pairs.flux * mean / np.maximum(reflected, 1e-30)[pairs.incidence]
    weight = np.sqrt(pairs.weight)[:, None]
    root_weight, albedo_weight = np.sqrt(0.5 * pairs.share[pairs.incidence] * share)[:, None], np.sqrt(pairs.share)
    size = np.sqrt(np.sum((weight * wanted) ** 2))
    points = np.sqrt(np.sum((root_weight * _root(wanted * np.pi * pairs.wi.z[:, None])) ** 2))
    albedos = np.sqrt(np.sum((albedo_weight[:, None] * _root(pairs.albedo(wanted))) ** 2))
    root_weight, albedo_weight = ROOT * root_weight / points, ROOT * albedo_weight[:, None] / albedos
    return Comparison(sides, pairs, wanted, weight / max(size, 1e-30), root_weight, albedo_weight)


def _root(v: np.ndarray) -> np.ndarray:
    return np.cbrt(np.maximum(v, 0.0) + DARK)
