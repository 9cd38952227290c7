"""Which polarised channels make an albedo together: what the surface does with light of one state."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.checks.albedos import Albedos
from gonio.checks.table.polarisations import OPPOSITE, Sum
from gonio.data.channels import Channels
from gonio.data.polarisation import ANY, Element, Polarised, matrices_of, states_of
from gonio.data.table import Table
from gonio.models.display import listed

BRIGHTEST = "{first} and the brightest state of light"


class LightOfState(NamedTuple):
    """The channels, with factors, that share out what becomes of light of one state, and whether they are all of it."""

    name: str
    channels: Sum
    whole: bool = True


def light_of_states(names: Sequence[str], columns: Sequence[int] = (1, 2, 3)) -> list[LightOfState]:
    """Sums of channels that are albedos of light of one state.

    Of a Mueller matrix unpolarised light, and light of each pair of opposite states of which its first row was read,
    of some columns.
    """
    states, made = states_of(names), list[LightOfState]()
    number = {state: k for k, state in enumerate(states) if state is not None}
    for k, state in enumerate(states):
        if state is None or (isinstance(state, Polarised) and state.detector == ANY):
            made.append(LightOfState(names[k], ((k, 1.0),)))
        elif isinstance(state, Polarised):
            other = number.get(state._replace(detector=OPPOSITE.get(state.detector, "")))
            if other is None:
                made.append(LightOfState(names[k], ((k, 1.0),), whole=False))
            elif other > k:
                made.append(LightOfState(f"{names[k]} and {names[other]} together", ((k, 1.0), (other, 1.0))))
        elif state.row == state.column == 0:
            made.append(LightOfState(names[k], ((k, 1.0),)))
            row = [number.get(Element(state.rest, 0, column)) for column in columns]
            made += [_opposite(names, k, other, sign) for other in row if other is not None for sign in (1, -1)]
    return made


def _opposite(names: Sequence[str], first: int, other: int, sign: int) -> LightOfState:
    return LightOfState(f"{names[first]} {'+' if sign > 0 else '−'} {names[other]}", ((first, 1.0), (other, sign)))


def lit_by_states(table: Table, groups: Sequence[LightOfState]) -> Table:
    """A table of polarised channels as one of what becomes of light of each state, however it is detected."""
    values = table.read_values()
    shape = (*table.layout.shape, len(groups))

    def summed(array: np.ndarray, power: int) -> np.ndarray:
        columns = [sum(c**power * array[:, k].astype(float) ** power for k, c in g.channels) for g in groups]
        return np.stack(columns, axis=-1).reshape(shape)

    flag = np.stack([np.max(values["flag"][:, [k for k, _ in g.channels]], axis=1) for g in groups], axis=-1)
    return dataclasses.replace(
        table,
        f=summed(values["f"], 1),
        u_f=None if table.u_f is None else np.sqrt(summed(values["u_f"], 2)),
        flag=flag.reshape(shape),
        channels=Channels(tuple(g.name for g in groups)),
    )


def with_brightest_states(albedos: Albedos, groups: Sequence[LightOfState], names: Sequence[str]) -> Albedos:
    """The albedos (n, groups) with those of the states of light that are reflected most, from Mueller matrices.

    A light of unit Stokes vector (1, s) is reflected by A₀ + A·s: at most by A₀ + |A|.
    """
    minus = [k for k, g in enumerate(groups) if g.channels[-1][1] < 0]
    for first in dict.fromkeys(groups[k].channels[0][0] for k in minus):
        plus = np.array([k - 1 for k in minus if groups[k].channels[0][0] == first])
        if plus.size > 1:
            alone = [g.channels for g in groups].index(((first, 1.0),))
            albedos = _with_brightest(albedos, alone, plus, BRIGHTEST.format(first=names[first]))
    return albedos


def _with_brightest(albedos: Albedos, first: int, plus: np.ndarray, name: str) -> Albedos:
    difference = (albedos.value[:, plus] - albedos.value[:, plus + 1]) / 2
    size = np.linalg.norm(difference, axis=1, keepdims=True)
    unit = difference / np.where(size > 0, size, 1.0)

    def bound(values: np.ndarray) -> np.ndarray:
        most = np.maximum(values[..., plus], values[..., plus + 1])
        return values[..., [first]] + np.linalg.norm(most, axis=-1, keepdims=True)

    def more(values: np.ndarray, added: np.ndarray) -> np.ndarray:
        return np.concatenate([values, added], axis=-1)

    def along(values: np.ndarray) -> np.ndarray:
        return values[:, [first]] + np.sum(unit * (values[:, plus] - values[:, plus + 1]) / 2, axis=1, keepdims=True)

    # No light is reflected more than twice as much as unpolarised light.
    value = along(albedos.value)
    above = np.minimum(bound(albedos.above), 2 * (albedos.value + albedos.above)[:, [first]] - value)
    below = np.minimum(bound(albedos.below), value - (albedos.value - albedos.below)[:, [first]])
    sums: dict[str, np.ndarray] = {"value": more(albedos.value, value), "above": more(albedos.above, above)}
    sums["below"] = more(albedos.below, below)
    sums["noise"] = more(albedos.noise, bound(albedos.noise)) if albedos.noise.size else albedos.noise
    sums["hidden"] = more(albedos.hidden, 2 * albedos.hidden[..., [first]]) if albedos.hidden.size else albedos.hidden
    shares = {key: more(share, along(share)) for key, share in albedos.shares.items()}
    return dataclasses.replace(albedos, **sums, shares=shares, channels=(*albedos.channels, name))


def not_all_of_the_light(names: Sequence[str]) -> str:
    """A sentence on channels that hold a part of the light; nothing where none does."""
    some = [g.name for g in light_of_states(names) if not g.whole]
    if not some:
        return ""
    return (
        f" What is detected in the other polarisation was not read beside {listed(some)}: the albedo is at least that."
    )


def states_not_looked_at(names: Sequence[str]) -> str:
    """A sentence on states of light of which Mueller matrices tell nothing; nothing where they tell of all."""
    unread = [
        f"polarised light beside {names[elements[0, 0]]}" if len(lacking) == 3 else f"light of m0{listed(lacking)}"
        for elements in matrices_of(names).values()
        if (lacking := [str(c) for c in (1, 2, 3) if (0, c) not in elements])
    ]
    return f" Not looked at: {listed(unread)}, of which more may be reflected." if unread else ""
