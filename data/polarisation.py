"""What the names of channels say of polarisation: the states of light and detector, or a place in a Mueller matrix."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

ANY = "u"
"""Unpolarised light, or a detector that takes all of it."""
STATE = r"[spuhv]|\([-+.e\d ]+\)"
BOTH = re.compile(rf"(?:(.*)[ _])?({STATE})[ _]to[ _]({STATE})", re.IGNORECASE)
OF_LIGHT = re.compile(r"(?:(.*)[ _])?([sp])")
ELEMENT = re.compile(r"(?:(.*)[ _])?m_?([0-4])([0-4])", re.IGNORECASE)
STOKES = re.compile(r"(?:(.*)[ _])?[sS]_?([0-3])")
LETTERS = re.compile(r"(?:(.*)[ _])?([IQUV])")
FEWEST_STOKES = 3
"""Stokes parameters of one name, with the first, that are taken as such: S0 and S1 alone may be anything."""


class Polarised(NamedTuple):
    """A channel's name without its states, and the states of light and detector, letters or Stokes vectors."""

    rest: str
    light: str
    detector: str


class Element(NamedTuple):
    """A channel's name without its place in a Mueller matrix, and row and column there, from 0.

    Stokes parameters under unpolarised light are the first column.
    """

    rest: str
    row: int
    column: int


State = Polarised | Element | None


def states_of(names: Sequence[str]) -> list[State]:
    """What the names of channels say of polarisation; None for each that says nothing, or unpolarised light alone."""
    elements = _elements(names) or _stokes(names)
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


def _stokes(names: Sequence[str]) -> dict[str, Element]:
    """Stokes parameters, S0 to S3 or I, Q, U, V, of which three of one name are there with the first."""
    made: dict[str, Element] = {}
    for name in names:
        if (number := STOKES.fullmatch(name)) is not None:
            made[name] = Element(number[1] or "", int(number[2]), 0)
        elif (letter := LETTERS.fullmatch(name)) is not None:
            made[name] = Element(letter[1] or "", "IQUV".index(letter[2]), 0)
    rows = {rest: [e.row for e in made.values() if e.rest == rest] for rest in {e.rest for e in made.values()}}
    whole = {rest for rest, of_rest in rows.items() if 0 in of_rest and len({*of_rest}) >= FEWEST_STOKES}
    return {name: element for name, element in made.items() if element.rest in whole}


def is_polarised(names: Sequence[str]) -> bool:
    """Whether the names of channels tell of polarisations."""
    return any(state is not None for state in states_of(names))


def are_radiances(names: Sequence[str]) -> np.ndarray:
    """(channels,): whether none is negative, as of Mueller matrices the first element alone."""
    return np.array([not isinstance(s, Element) or s.row == s.column == 0 for s in states_of(names)])


def matrices_of(names: Sequence[str]) -> dict[str, dict[tuple[int, int], int]]:
    """The Mueller matrices with their first element: by the rest of the name the channel of each (row, column)."""
    made: dict[str, dict[tuple[int, int], int]] = {}
    for channel, state in enumerate(states_of(names)):
        if isinstance(state, Element):
            made.setdefault(state.rest, {})[state.row, state.column] = channel
    return {rest: elements for rest, elements in made.items() if (0, 0) in elements}


def are_their_own_exchange(names: Sequence[str]) -> bool:
    """Whether exchanged directions have the same reading in every channel, as of s to s, and not of s to p."""
    states = [state for state in states_of(names) if state is not None]
    return all(s.row == s.column if isinstance(s, Element) else s.light == s.detector for s in states)


def change_sign_mirrored(names: Sequence[str]) -> list[bool]:
    """Of each channel whether its mirror image at the plane of incidence is its negative: m02, m03, m12, ... are."""
    return [isinstance(s, Element) and (s.row >= 2) != (s.column >= 2) for s in states_of(names)]


def shown_channel(names: Sequence[str]) -> int:
    """Number of the channel that pictures show: the middle one of those that are radiances."""
    radiances = np.flatnonzero(are_radiances(names))
    return int(radiances[radiances.size // 2])
