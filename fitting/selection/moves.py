"""From which model a selection starts, and to which larger and smaller ones it goes, by the sides that were read."""

import dataclasses
from collections.abc import Iterator

from gonio.fitting.problem.readings import BRIGHTER, Readings
from gonio.fitting.selection import term_spec
from gonio.fitting.selection.term_spec import (
    LAMBERT,
    NO_FRESNEL,
    SCHLICK,
    Terms,
    TermSpec,
    changed,
    families,
    simpler,
    steps,
)
from gonio.models.catalog import MODELS
from gonio.models.parameters import parameters_of

MOST_THROUGH = 2
"""Lobes about what goes straight through or is refracted."""


@dataclasses.dataclass(frozen=True)
class Moves:
    """Of readings of reflection in front."""

    @property
    def start(self) -> Terms:
        """The smallest model."""
        return (LAMBERT,)

    def references(self) -> list[list[Terms]]:
        """Models that leave the noise of most surfaces, each list grown out of the one before."""
        one: list[Terms] = [(LAMBERT, TermSpec("ggx", f)) for f in (NO_FRESNEL, SCHLICK)]
        two: list[Terms] = [(*terms, TermSpec("ggx", terms[1].fresnel)) for terms in one]
        return [one, two + [(*terms, TermSpec("retro")) for terms in one]]

    def steps(self, terms: Terms, anisotropic: bool, channels: int) -> Iterator[Terms]:
        """Candidates with one more lobe or freedom."""
        return steps(terms, anisotropic, channels)

    def families(self, terms: Terms) -> Iterator[Terms]:
        """Candidates of other families."""
        return families(terms)

    def simpler(self, terms: Terms, channels: int) -> Iterator[Terms]:
        """Candidates without a term, or with fewer free numbers."""
        return simpler(terms, channels)


THROUGH, SHEET = TermSpec("lambert_transmission"), TermSpec("thin_sheet")
STRAIGHT = TermSpec("transmitted", base="ggx")
POWER = TermSpec("cosine_power_transmission")
INTERFACE, SLAB = TermSpec("rough_dielectric", dyed=True), TermSpec("rough_slab", dyed=True)
CLEAR_LOBES = (INTERFACE, TermSpec("rough_dielectric", beckmann=True, dyed=True), SLAB)
CLEAR = ("rough_dielectric", "rough_slab")
TRANSMITTING = ("lambert_transmission", "thin_sheet", "transmitted", "cosine_power_transmission", *CLEAR)
BASES = ("beckmann", "phong", "harvey_shack")


@dataclasses.dataclass(frozen=True)
class TransmittingMoves(Moves):
    """Of readings behind the sample, with or without reflection in front, or from behind.

    What is reflected grows as it does without transmission, but for light from behind, which sheets and interfaces
    alone reflect.

    Attributes:
        reflects, from_behind: whether reflection in front was read, and from behind.
        bright: the sides of (light, detector) where the sample is not dark: candidates scatter there.
    """

    reflects: bool
    from_behind: bool
    bright: frozenset[tuple[int, int]]

    def covers(self, terms: Terms) -> bool:
        """Whether some terms scatter on all sides where the sample is not dark."""
        through = any(t.model in TRANSMITTING for t in terms)
        both = any(t.model in ("thin_sheet", *CLEAR) for t in terms)
        front = both or any(t.model not in TRANSMITTING for t in terms)
        known = {(1, 1): front, (-1, -1): both}
        return all(known.get(side, through) for side in self.bright)

    @property
    def start(self) -> Terms:
        if self.from_behind:
            return (SHEET,)
        return (LAMBERT, THROUGH) if self.reflects else (THROUGH,)

    def references(self) -> list[list[Terms]]:
        lobe = (TermSpec("ggx"),) if self.reflects else ()
        diffuse = self.start
        return [[(*diffuse, STRAIGHT), (*diffuse, INTERFACE)], [(*diffuse, *lobe, STRAIGHT), (*diffuse, SLAB)]]

    def steps(self, terms: Terms, anisotropic: bool, channels: int) -> Iterator[Terms]:
        return filter(self.covers, self._steps(terms, anisotropic, channels))

    def families(self, terms: Terms) -> Iterator[Terms]:
        return filter(self.covers, self._families(terms))

    def simpler(self, terms: Terms, channels: int) -> Iterator[Terms]:
        return filter(self.covers, self._simpler(terms, channels))

    def _steps(self, terms: Terms, anisotropic: bool, channels: int) -> Iterator[Terms]:
        back, through = _split(terms)
        if self.reflects:
            yield from ((*other, *through) for other in steps(back, anisotropic, channels))
        lobes = [k for k, t in enumerate(terms) if t.model in TRANSMITTING and t.is_lobe]
        clear = [k for k in lobes if terms[k].model in CLEAR]
        if len(lobes) < MOST_THROUGH:
            yield from ((*terms, lobe) for lobe in (STRAIGHT, POWER))
        if not clear:
            yield from ((lobe,) for lobe in CLEAR_LOBES)
            yield from ((*terms, lobe) for lobe in CLEAR_LOBES)
        for k in clear:
            if anisotropic and "alpha_x" in parameters_of(MODELS[terms[k].model]) and not terms[k].anisotropic:
                yield changed(terms, [k], anisotropic=True)

    def _families(self, terms: Terms) -> Iterator[Terms]:
        back, through = _split(terms)
        if self.reflects:
            yield from ((*other, *through) for other in families(back))
        for k, t in enumerate(terms):
            if t.model == "transmitted":
                yield from (changed(terms, [k], base=base) for base in ("ggx", *BASES) if base != t.base)
                yield changed(terms, [k], model="cosine_power_transmission", base="")
            if t.model == "cosine_power_transmission":
                yield changed(terms, [k], model="transmitted", base="ggx")
            if t.model == "rough_dielectric":
                yield changed(terms, [k], beckmann=not t.beckmann)
            if t.model in CLEAR:
                yield changed(terms, [k], model=next(m for m in CLEAR if m != t.model), beckmann=False)
        if not any(t.model in ("lambert_transmission", "thin_sheet") for t in terms):
            yield (THROUGH, *terms)

    def _simpler(self, terms: Terms, channels: int) -> Iterator[Terms]:
        back, through = _split(terms)
        if (self.reflects and len(back) > 1) or (through and back):
            yield from ((*other, *through) for other in _smaller(back, channels))
        for k, t in enumerate(through):
            rest = through[:k] + through[k + 1 :]
            if rest or back:
                yield (*back, *rest)
            if t.anisotropic:
                yield (*back, *changed(through, [k], anisotropic=False))
            if t.dyed:
                yield (*back, *changed(through, [k], dyed=False))
            linear = t.model in ("lambert_transmission", "thin_sheet", "cosine_power_transmission")
            if linear and channels > 1 and not t.shared:
                yield (*back, *changed(through, [k], shared=True))


def _smaller(back: Terms, channels: int) -> Iterator[Terms]:
    """Simpler reflection: also none."""
    yield from term_spec.simpler(back, channels)
    if len(back) == 1:
        yield ()


def _split(terms: Terms) -> tuple[Terms, Terms]:
    """The terms that reflect alone, and those that transmit."""
    return tuple(t for t in terms if t.model not in TRANSMITTING), tuple(t for t in terms if t.model in TRANSMITTING)


def moves_for(readings: Readings) -> Moves:
    """Those of readings, by the sides that were read."""
    sides = readings.sides
    if sides == [(1, 1)]:
        return Moves()
    bright = frozenset(s for s in sides if readings.brightness(*s) > BRIGHTER)
    return TransmittingMoves((1, 1) in sides, (-1, -1) in sides, bright)
