"""What polarised channels, told by their names, have to do with each other: exchange, and the light of one state.

Light of state a that is detected in state b goes back, from the detector to the light, as b that is detected in a: what
equals f(i → o) of "s to p" is f(o → i) of "p to s". Of a Mueller matrix the exchanged one is its transpose, up to the
signs of the elements of 45° and circular light, which depend on the frame [Sekera 1966].
"""

import dataclasses
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.checks.albedos import Albedos
from gonio.checks.table.pairs.pairs import Column, Pairs
from gonio.models.display import listed

ANY = "u"
"""Unpolarised light, or a detector that takes all of it."""
OPPOSITE = {"s": "p", "p": "s", "h": "v", "v": "h"}
STATE = r"[spuhv]|\([-+.e\d ]+\)"
BOTH = re.compile(rf"(?:(.*)[ _])?({STATE})[ _]to[ _]({STATE})", re.IGNORECASE)
OF_LIGHT = re.compile(r"(?:(.*)[ _])?([sp])")
ELEMENT = re.compile(r"(?:(.*)[ _])?m_?([0-4])([0-4])", re.IGNORECASE)

FIRST_FOUR = ((0, 0), (0, 1), (1, 0), (1, 1))
"""Row and column of the elements of a Mueller matrix that s and p light have."""


class Polarised(NamedTuple):
    """A channel's name without its states, and the states of light and detector, letters or Stokes vectors."""

    rest: str
    light: str
    detector: str


class Element(NamedTuple):
    """A channel's name without its place in a Mueller matrix, and row and column there, from 0."""

    rest: str
    row: int
    column: int


class Exchange(NamedTuple):
    """Sums of channels, (channel, factor) each, that should be equal: of readings, and of exchanged ones; or none."""

    readings: tuple[tuple[int, float], ...] = ()
    exchanged: tuple[tuple[int, float], ...] = ()


class LightOfState(NamedTuple):
    """The channels that share out what the surface does with light of one state, and whether they are all of it."""

    name: str
    channels: tuple[int, ...]
    whole: bool


def states_of(names: Sequence[str]) -> list[Polarised | Element | None]:
    """What the names of channels say of polarisation; None for each that says nothing, or unpolarised light alone."""
    elements = _elements(names)
    if elements:
        return [elements.get(name) for name in names]
    return [_polarised(name, names) for name in names]


def _polarised(name: str, names: Sequence[str]) -> Polarised | None:
    if (both := BOTH.fullmatch(name)) is not None:
        state = Polarised(both[1] or "", both[2].lower(), both[3].lower())
        return None if state.light == state.detector == ANY else state
    # A letter alone is a polarisation beside a wavelength, or beside the other one.
    if (one := OF_LIGHT.fullmatch(name)) is not None and (one[1] or {"s", "p"} <= {*names}):
        return Polarised(one[1] or "", one[2], ANY)
    return None


def _elements(names: Sequence[str]) -> dict[str, Element]:
    """Elements of Mueller matrices, where there are several with the first one; counted from 0 or from 1."""
    matches = {name: match for name in names if (match := ELEMENT.fullmatch(name)) is not None}
    first = min((int(m[k]) for m in matches.values() for k in (2, 3)), default=0)
    made = {name: Element(m[1] or "", int(m[2]) - first, int(m[3]) - first) for name, m in matches.items()}
    known = len(made) > 1 and first < 2 and all(e.row < 4 and e.column < 4 for e in made.values())
    return made if known and any(e.row == e.column == 0 for e in made.values()) else {}


def is_polarised(names: Sequence[str]) -> bool:
    """Whether the names of channels tell of polarisations."""
    return any(state is not None for state in states_of(names))


def are_radiances(names: Sequence[str]) -> np.ndarray:
    """(channels,): whether none is negative, as of Mueller matrices the first element alone."""
    return np.array([not isinstance(s, Element) or s.row == s.column == 0 for s in states_of(names)])


def exchanges_of(names: Sequence[str]) -> list[Exchange]:
    """For each channel what should be equal; of two channels that count together the second has none."""
    states = states_of(names)
    number = {state: k for k, state in enumerate(states) if state is not None}
    return [_exchange(k, state, number) for k, state in enumerate(states)]


def _exchange(k: int, state: Polarised | Element | None, number: dict[Polarised | Element, int]) -> Exchange:
    if state is None:
        return Exchange(((k, 1.0),), ((k, 1.0),))
    if isinstance(state, Element):
        return _of_element(k, state, number)
    if ANY not in (state.light, state.detector):
        other = number.get(Polarised(state.rest, state.detector, state.light))
        known = other is not None and {state.light, state.detector} <= {*OPPOSITE}
        return Exchange(((k, 1.0),), ((other, 1.0),)) if known and other is not None else Exchange()
    # One side is not polarised: both states of the other together are unpolarised light.
    light, detector = (OPPOSITE.get(s, s) for s in (state.light, state.detector))
    other = number.get(Polarised(state.rest, light, detector))
    mean = () if other is None or other < k else ((k, 0.5), (other, 0.5))
    return Exchange(mean, mean)


def _of_element(k: int, element: Element, number: dict[Polarised | Element, int]) -> Exchange:
    """The elements of s and p light as what is detected of each in each, none of which is negative or near 0."""
    four = [number.get(Element(element.rest, row, column)) for row, column in FIRST_FOUR]
    if (element.row, element.column) not in FIRST_FOUR or None in four:
        alone = element.row == element.column == 0
        return Exchange(((k, 1.0),), ((k, 1.0),)) if alone else Exchange()
    light, detector = 1 - 2 * element.column, 1 - 2 * element.row
    there = [(light if column else 1) * (detector if row else 1) / 2 for row, column in FIRST_FOUR]
    back = [(detector if column else 1) * (light if row else 1) / 2 for row, column in FIRST_FOUR]
    terms = [tuple((n, float(c)) for n, c in zip(four, cs, strict=True) if n is not None) for cs in (there, back)]
    return Exchange(terms[0], terms[1])


def unmatched(names: Sequence[str]) -> list[str]:
    """The channels that no comparison with exchanged readings takes in."""
    compared = {k for exchange in exchanges_of(names) for k, _ in (*exchange.readings, *exchange.exchanged)}
    return [name for k, name in enumerate(names) if k not in compared]


def with_exchanged_states(pairs: Pairs, names: Sequence[str]) -> Pairs:
    """Pairs of exchanged directions with the exchanged polarisations too; NaN where a channel has none."""
    if not is_polarised(names):
        return pairs
    exchanges, column = exchanges_of(names), pairs.column

    def of_channel(channel: int) -> Column:
        exchange = exchanges[channel]
        if not exchange.readings:
            nothing = np.full(len(pairs), np.nan)
            return Column(nothing, nothing, nothing, nothing)
        here, there = ([(column(k), c) for k, c in terms] for terms in exchange)
        a = np.sum([c * col.a for col, c in here], axis=0)
        b = np.sum([c * col.b for col, c in there], axis=0)
        u_a = np.sqrt(np.sum([(c * col.u_a) ** 2 for col, c in here], axis=0))
        u_b = np.sqrt(np.sum([(c * col.u_b) ** 2 for col, c in there], axis=0))
        absolute = np.sum([np.abs(c * col.b) * col.error for col, c in there], axis=0)
        return Column(a, b, u_a, u_b, absolute / np.maximum(np.abs(b), 1e-300))

    around = pairs.around
    if len(around):
        none = np.full(len(around), np.nan)
        numbers = [[k for k, _ in exchange.exchanged] for exchange in exchanges]
        around = np.stack([np.max(around[:, some], axis=1) if some else none for some in numbers], axis=1)
    return dataclasses.replace(pairs, column=of_channel, around=around)


def light_of_states(names: Sequence[str]) -> list[LightOfState]:
    """Which channels make an albedo together, by the state of the light; a Mueller matrix has that of its first."""
    states, made = states_of(names), list[LightOfState]()
    number = {state: k for k, state in enumerate(states) if state is not None}
    for k, state in enumerate(states):
        if state is None or (isinstance(state, Polarised) and state.detector == ANY):
            made.append(LightOfState(names[k], (k,), True))
        elif isinstance(state, Polarised):
            other = number.get(state._replace(detector=OPPOSITE.get(state.detector, "")))
            if other is None:
                made.append(LightOfState(names[k], (k,), False))
            elif other > k:
                made.append(LightOfState(f"{names[k]} and {names[other]} together", (k, other), True))
        elif state.row == state.column == 0:
            made.append(LightOfState(names[k], (k,), True))
    return made


def by_state_of_light(albedos: Albedos, groups: Sequence[LightOfState]) -> Albedos:
    """The albedos (n, groups) of light of each state, whatever the state in which it is detected."""

    def total(values: np.ndarray) -> np.ndarray:
        return np.stack([np.sum(values[..., list(g.channels)], axis=-1) for g in groups], axis=-1)

    alone = ("value", "above", "below", "noise", "hidden")
    sums = {name: total(array) for name in alone if (array := getattr(albedos, name)).size}
    shares = {name: total(share) for name, share in albedos.shares.items()}
    return dataclasses.replace(albedos, **sums, shares=shares, channels=tuple(g.name for g in groups))


def not_all_of_the_light(names: Sequence[str]) -> str:
    """A sentence on channels that hold a part of the light; nothing where none does."""
    some = [g.name for g in light_of_states(names) if not g.whole]
    if not some:
        return ""
    return (
        f" What is detected in the other polarisation was not read beside {listed(some)}: the albedo is at least that."
    )
