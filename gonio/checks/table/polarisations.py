"""Which sums of polarised channels should be equal, where single channels are not, or differ about 0.

Light of state a that is detected in state b goes back, from the detector to the light, as b that is detected in a: what
equals f(i → o) of "s to p" is f(o → i) of "p to s". Of a Mueller matrix the exchanged one is its transpose, up to the
signs of the elements of 45° and circular light, which depend on the frames [Sekera 1966]; mirrored at the plane of
incidence these elements change their sign. Elements are compared in units of the first one, as they may be 0.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gonio.checks.table.pairs.pairs import Column, Pairs
from gonio.data.polarisation import ANY, Element, Polarised, State, is_polarised, states_of

OPPOSITE = {"s": "p", "p": "s", "h": "v", "v": "h"}

Signs = tuple[int, int, int, int]
"""Of the four Stokes parameters, in the readings that should be equal."""
SAME: Signs = (1, 1, 1, 1)
MIRRORED: Signs = (1, 1, -1, -1)

Sum = tuple[tuple[int, float], ...]
"""Channels with their factors."""


class Equal(NamedTuple):
    """Sums of channels that should be equal: of readings, and of those that they are compared with; or none."""

    readings: Sum = ()
    others: Sum = ()


NONE = Equal()


def exchanged_sums(names: Sequence[str], signs: Signs = SAME) -> list[Equal]:
    """For each channel what equals readings of exchanged directions; of two that count together the second has none.

    `signs`: of the Stokes parameters when light goes back.
    """
    states = states_of(names)
    number = {state: k for k, state in enumerate(states) if state is not None}
    return [_exchanged(k, state, number, signs) for k, state in enumerate(states)]


def _exchanged(k: int, state: State, number: dict[Polarised | Element, int], signs: Signs) -> Equal:
    if state is None:
        return _alone(k)
    if isinstance(state, Element):
        return _of_element(state, number, signs, transposed=True)
    if ANY not in (state.light, state.detector):
        other = number.get(Polarised(state.rest, state.detector, state.light))
        known = other is not None and {state.light, state.detector} <= {*OPPOSITE}
        return Equal(((k, 1.0),), ((other, 1.0),)) if known and other is not None else NONE
    # One side is not polarised: both states of the other together are unpolarised light.
    light, detector = (OPPOSITE.get(s, s) for s in (state.light, state.detector))
    other = number.get(Polarised(state.rest, light, detector))
    mean = () if other is None or other < k else ((k, 0.5), (other, 0.5))
    return Equal(mean, mean)


def _alone(k: int) -> Equal:
    return Equal(((k, 1.0),), ((k, 1.0),))


def _of_element(
    element: Element, number: Mapping[Polarised | Element, int], signs: Signs, *, transposed: bool
) -> Equal:
    """An element and twice the first one of its matrix: never dark, as no element is larger than the first."""
    row, column = element.row, element.column
    first, k = number.get(Element(element.rest, 0, 0)), number[element]
    other = number.get(Element(element.rest, *((column, row) if transposed else (row, column))))
    if row == column == 0:
        return _alone(k)
    if first is None or other is None:
        return NONE
    sign = float(signs[row] * signs[column])
    return Equal(((first, 2.0), (k, 1.0)), ((first, 2.0), (other, sign)))


def unmatched(names: Sequence[str]) -> list[str]:
    """The channels that no comparison with exchanged readings takes in."""
    compared = {k for equal in exchanged_sums(names) for k, _ in (*equal.readings, *equal.others)}
    return [name for k, name in enumerate(names) if k not in compared]


def with_exchanged_states(pairs: Pairs, names: Sequence[str]) -> Pairs:
    """Pairs of exchanged directions with the exchanged polarisations too; NaN where a channel has none."""
    return _summed(pairs, exchanged_sums(names, signs_of(pairs, names))) if is_polarised(names) else pairs


def signs_of(pairs: Pairs, names: Sequence[str]) -> Signs:
    """The signs of 45° and circular light when it goes back that fit the exchanged readings best."""
    elements = {state: k for k, state in enumerate(states_of(names)) if isinstance(state, Element)}
    misfit = dict.fromkeys(itertools.product((1, -1), (1, -1)), 0.0)
    for element, k in elements.items():
        other = elements.get(Element(element.rest, element.column, element.row))
        if max(element.row, element.column) < 2 or element.row == element.column or other is None:
            continue
        a, b = pairs.column(k).a, pairs.column(other).b
        for signs in misfit:
            whole = (1, 1, *signs)
            misfit[signs] += float(np.nansum(np.abs(a - whole[element.row] * whole[element.column] * b)))
    return (1, 1, *min(misfit, key=lambda signs: misfit[signs]))


def signs_in_words(pairs: Pairs, names: Sequence[str]) -> str:
    """Which signs of 45° and circular light the comparison takes; nothing where no element has one."""
    elements = {state for state in states_of(names) if isinstance(state, Element)}
    signed = {
        k
        for e in elements
        if Element(e.rest, e.column, e.row) in elements and e.row != e.column
        for k in (e.row, e.column)
    } & {2, 3}
    if not signed:
        return ""
    signs = signs_of(pairs, names)
    words = [
        f"{'45°' if k == 2 else 'circular'} light {'keeps' if signs[k] > 0 else 'changes'} its sign" for k in signed
    ]
    return f" What fits best is that {' and '.join(words)} on the way back: the file does not say it."


def mirrored_states(pairs: Pairs, names: Sequence[str]) -> Pairs:
    """Pairs of mirrored directions with the mirrored polarisations; NaN where a channel has none."""
    return _alike(pairs, names, MIRRORED) if is_polarised(names) else pairs


def same_states(pairs: Pairs, names: Sequence[str], *, of_light: bool = True, of_detector: bool = True) -> Pairs:
    """Pairs of one geometry, or turned ones, by what is not negative; NaN for states of which the frame may turn.

    `of_light`, `of_detector`: whether the state of that side means the same in both readings. At the normal s and p
    are those of the azimuth that is written there.
    """
    if not is_polarised(names):
        return pairs
    states = states_of(names)
    turns = [(_turns(state, light=True), _turns(state, light=False)) for state in states]
    known = [(of_light or not light) and (of_detector or not detector) for light, detector in turns]
    return _alike(pairs, names, SAME, known)


def _turns(state: State, *, light: bool) -> bool:
    """Whether the state of the light, or of the detector, depends on the plane of incidence."""
    if state is None:
        return False
    if isinstance(state, Element):
        return (state.column if light else state.row) in (1, 2)
    return (state.light if light else state.detector) != ANY


def _alike(pairs: Pairs, names: Sequence[str], signs: Signs, known: Sequence[bool] | None = None) -> Pairs:
    states = states_of(names)
    number = {state: k for k, state in enumerate(states) if state is not None}
    equal = [
        _of_element(state, number, signs, transposed=False)
        if isinstance(state, Element)
        else _alone(k) if signs == SAME or not _handed(state) else NONE
        for k, state in enumerate(states)
    ]  # fmt: skip
    return _summed(pairs, equal if known is None else [e if of else NONE for e, of in zip(equal, known, strict=True)])


def _handed(state: State) -> bool:
    """Whether light or detector are of Stokes vectors, whose mirror image may be another one."""
    return isinstance(state, Polarised) and "(" in state.light + state.detector


def _summed(pairs: Pairs, equal: Sequence[Equal]) -> Pairs:
    """Pairs whose readings are sums of channels; NaN where there is none."""
    column = pairs.column

    def of_channel(channel: int) -> Column:
        if not equal[channel].readings:
            nothing = np.full(len(pairs), np.nan)
            return Column(nothing, nothing, nothing, nothing)
        here, there = ([(column(k), c) for k, c in terms] for terms in equal[channel])
        a = np.sum([c * col.a for col, c in here], axis=0)
        b = np.sum([c * col.b for col, c in there], axis=0)
        u_a = np.sqrt(np.sum([(c * col.u_a) ** 2 for col, c in here], axis=0))
        u_b = np.sqrt(np.sum([(c * col.u_b) ** 2 for col, c in there], axis=0))
        absolute = np.sum([np.abs(c * col.b) * col.error for col, c in there], axis=0)
        return Column(a, b, u_a, u_b, absolute / np.maximum(np.abs(b), 1e-300))

    around = pairs.around
    if len(around):
        none = np.full(len(around), np.nan)
        numbers = [[k for k, _ in e.others] for e in equal]
        around = np.stack([np.max(around[:, some], axis=1) if some else none for some in numbers], axis=1)
    return dataclasses.replace(pairs, column=of_channel, around=around)
