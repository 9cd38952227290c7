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


def test_copies_and_other_states_at_the_normal_are_no_repeats():
    """Paint, whose readings at the normal are copies, and s to p, which turns there with the azimuth."""
    theta = np.radians([0.0, 20, 40, 60])
    theta_i, theta_o, phi = (a.ravel() for a in np.meshgrid(theta, theta, mueller.PHI, indexing="ij"))
    turned = 0.1 + 0.05 * np.cos(2 * phi) * (theta_o == 0)
    for name, f in (("550 nm s to p", turned), ("550 nm", 0.1 + 1e-17 * phi)):
        table = gonio.Table.from_arrays(theta_i, 0, theta_o, phi, f[:, None], channels=[name])
        made = gonio.quantities(table, budget=True)
        assert made.budget is not None and "repeatability" not in [row.name for row in made.budget.contributions]
