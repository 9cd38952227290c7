"""Quantities of polarised channels are of unpolarised light, or say of which."""

import numpy as np

import gonio
from support import mueller


def test_of_mueller_matrices_the_first_element_alone_has_quantities():
    f = mueller.on_grid(0)
    every = gonio.quantities(mueller.grid_of(f, mueller.NAMES))
    alone = gonio.quantities(mueller.grid_of(f[..., :1], ["m00"]))
    assert {q.channel for q in every.quantities} == {"m00"}
    assert [q.value for q in every.quantities] == [q.value for q in alone.quantities]
    assert any("no radiances" in note for note in every.notes) and not any("Mueller" in n for n in alone.notes)


def test_states_of_polarised_light_are_told():
    f = np.abs(mueller.on_grid(0)[..., :2]) + 0.01
    assert any("states of polarised light" in n for n in gonio.quantities(mueller.grid_of(f, ["s", "p"])).notes)
