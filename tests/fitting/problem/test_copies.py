"""Readings that repeat others tell no more than one of them: fits of copied tables beside fits of what was read."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import gonio
from gonio.data.layouts import isotropic
from gonio.data.table import Table, whole_table_of_values

MODEL = "lambert + ggx"
TRUTH = "lambert(rho=0.3) + 0.4 * ggx(alpha=0.3)"
Angles = tuple[np.ndarray, ...]


def mirrored(i: np.ndarray, pi: np.ndarray, o: np.ndarray, po: np.ndarray) -> Angles:
    return i, pi, o, 2 * pi - po


def turned(i: np.ndarray, pi: np.ndarray, o: np.ndarray, po: np.ndarray) -> Angles:
    return i, pi + 1.0, o, po + 1.0


def exchanged(i: np.ndarray, pi: np.ndarray, o: np.ndarray, po: np.ndarray) -> Angles:
    return o, po, i, pi


def again(i: np.ndarray, pi: np.ndarray, o: np.ndarray, po: np.ndarray) -> Angles:
    return i, pi, o, po


COPIES: list[Callable[..., Angles]] = [mirrored, turned, exchanged, again]


def read(seed: int = 0, number: int = 300) -> tuple[Angles, np.ndarray, np.ndarray]:
    """Directions, values and uncertainties of readings with 2 % of noise."""
    rng = np.random.default_rng(seed)
    angles = (*rng.uniform(0.05, 1.2, (1, number)), *rng.uniform(-3, 3, (1, number)))
    angles = (*angles, *rng.uniform(0.05, 1.2, (1, number)), *rng.uniform(-3, 3, (1, number)))
    f = gonio.material(TRUTH).f(*angles)[..., 0]
    return angles, f * (1 + 0.02 * rng.standard_normal(number)), 0.02 * f


def listed(angles: Angles, f: np.ndarray, u: np.ndarray | None) -> Table:
    return gonio.Table.from_arrays(*angles, f, u_f=u)


def with_copies(copy: Callable[..., Angles], noise_known: bool) -> tuple[Table, Table]:
    """A table as it was read, and with each of its readings twice."""
    angles, f, u = read()
    both = tuple(np.concatenate(pair) for pair in zip(angles, copy(*angles), strict=True))
    stated = u if noise_known else None
    return listed(angles, f, stated), listed(both, np.tile(f, 2), np.tile(u, 2) if noise_known else None)


@pytest.mark.parametrize("noise_known", [True, False])
@pytest.mark.parametrize("copy", COPIES)
def test_copies_change_neither_numbers_nor_uncertainties(copy: Callable[..., Angles], noise_known: bool) -> None:
    once, twice = (gonio.fit(t, MODEL, starts=2) for t in with_copies(copy, noise_known))
    for a, b in zip(once.parameters, twice.parameters, strict=True):
        assert b.value == pytest.approx(a.value, abs=1e-3 * a.standard_uncertainty)
        assert b.standard_uncertainty == pytest.approx(a.standard_uncertainty, rel=1e-3)
    assert twice.counts["copies"] == once.counts["used"] == twice.counts["used"] // 2 and once.counts["copies"] == 0
    assert any("repeat others" in note for note in twice.notes)


def test_readings_taken_twice_are_no_copies() -> None:
    (angles, f, u), (_, g, _) = read(0), read(0)
    noise = 1 + 0.02 * np.random.default_rng(5).standard_normal(g.size)
    twice = listed(tuple(np.tile(a, 2) for a in angles), np.concatenate([f, g * noise]), np.tile(u, 2))
    result = gonio.fit(twice, MODEL, starts=2)
    assert result.counts["copies"] == 0 and result.counts["used"] == 2 * f.size


def test_what_a_model_tells_apart_is_no_copy() -> None:
    _, twice = with_copies(mirrored, noise_known=True)
    assert gonio.fit(twice, "lambert + ggx(alpha_x=?, alpha_y=?)", starts=0).counts["copies"] == 0


def test_a_repair_tells_no_more_than_the_readings_that_it_was_made_of() -> None:
    nodes = np.radians(np.arange(0, 81, 10))
    layout = isotropic(nodes, nodes, np.radians(np.arange(0, 360, 30)))
    f = gonio.material(TRUTH).f(*layout.angles())[..., 0]
    noisy = f * (1 + 0.02 * np.random.default_rng(3).standard_normal(f.shape))
    table = whole_table_of_values(layout, noisy.reshape(layout.shape), u_f=(0.02 * f).reshape(*layout.shape, 1))
    before, after = (gonio.fit(t, MODEL, starts=2) for t in (table, gonio.repair(table).table))
    for a, b in zip(before.parameters, after.parameters, strict=True):
        assert b.standard_uncertainty == pytest.approx(a.standard_uncertainty, rel=0.05)


def test_numbers_of_an_exact_table_are_those_that_all_its_readings_give() -> None:
    """Without noise each of a table's cells counts, and copies make them no fewer."""
    nodes = np.radians(np.arange(0, 81, 10))
    layout = isotropic(nodes, nodes, np.radians(np.arange(0, 360, 30)))
    f = gonio.material("beckmann(alpha=0.3, f0=0.9)").f(*layout.angles())[..., 0].reshape(layout.shape)
    plain = whole_table_of_values(layout, f)
    # As many readings whose last digits differ: none is a copy of another.
    apart = dataclasses.replace(plain, f=plain.f * (1 + 1e-5 * np.random.default_rng(0).uniform(-1, 1, plain.f.shape)))
    a, b = (gonio.fit(t, "ggx", loss="linear", starts=2) for t in (plain, apart))
    assert a.counts["copies"] > b.counts["copies"] == 0
    assert [p.value for p in a.parameters] == pytest.approx([p.value for p in b.parameters], rel=1e-4)
