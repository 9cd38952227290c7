"""Laws of scatter of tables: exact ones come out whatever the layout, and what a law misses is in its uncertainties."""

import dataclasses

import numpy as np
import pytest

from gonio.data.channels import Channels
from gonio.data.layouts import Layout, isotropic, spherical
from gonio.data.table import Table, whole_table_of_values
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.scatter_law import of_table, scatter_laws

B0, L, S = 8.0, 0.03, -1.7
POLAR = np.radians([0, 2, 5, 10, 20, 30, 45, 60, 75])
TURNS = np.radians(np.arange(0, 360, 30))
LAYOUTS = {"isotropic": isotropic(POLAR[::2], POLAR, TURNS), "spherical": spherical(POLAR[::3], TURNS, POLAR, TURNS)}


def table(layout: Layout, misfit: float = 0.0) -> Table:
    theta_i, phi_i, theta_o, phi_o = layout.angles()
    offset = np.abs(np.sin(theta_i) * np.exp(1j * phi_i) + np.sin(theta_o) * np.exp(1j * phi_o))
    f = B0 * (1 + (offset / L) ** 2) ** (S / 2) * np.exp(misfit * np.sin(3 * np.log(offset + 0.01)))
    return whole_table_of_values(layout, f.reshape(layout.shape))


def law(layout: Layout, misfit: float = 0.0) -> dict[str, Quantity]:
    rows, _ = scatter_laws(of_table(table(layout, misfit)), Channels.grey())
    return {q.name.split()[1]: q for q in rows if q.name.startswith("Harvey")}


@pytest.mark.parametrize("name", LAYOUTS)
def test_an_exact_law_comes_out_although_all_azimuths_are_read_at_normal_incidence(name: str) -> None:
    numbers = law(LAYOUTS[name])
    assert [numbers[n].value for n in ("b0", "l", "s")] == pytest.approx([B0, L, S], rel=1e-6)


def test_what_a_law_misses_together_is_in_its_uncertainties() -> None:
    """A ripple along the offset; of independent residuals l would be known to 5 %."""
    numbers = law(LAYOUTS["isotropic"], misfit=0.2)
    assert abs(numbers["l"].value - L) < 2 * numbers["l"].u and abs(numbers["s"].value - S) < 2 * numbers["s"].u
    assert numbers["l"].u > 0.08 * L


def test_an_exact_diffuser_follows_no_law_whatever_its_level() -> None:
    """Numbers that change nothing leave the normal matrix singular by rounding, of about one level in forty."""
    polar = np.radians(np.arange(0, 81, 20.0))
    layout = isotropic(polar, polar, np.radians(np.arange(0, 360, 45.0)))
    for wavelength in range(400, 701, 20):
        level = (0.5 + 0.3 * np.sin(wavelength / 50)) / np.pi
        profile = of_table(whole_table_of_values(layout, np.full((*layout.shape, 1), level)))
        rows, undecided = scatter_laws(profile, Channels.grey())
        assert [q.name for q in rows] == ["difference of incidences"] and rows[0].value == 0
        assert {u.name for u in undecided} == {"ABg", "Harvey–Shack"}


def test_the_difference_of_incidences_knows_no_order_of_readings_and_no_rounding_of_angles() -> None:
    """Light at the normal has two readings at each offset: their mean stands for them, and the largest counts."""
    rng = np.random.default_rng(1)
    layout = isotropic(POLAR[::2], POLAR, TURNS)
    noise = np.exp(0.1 * rng.normal(size=layout.shape))
    profile = of_table(dataclasses.replace(table(layout), f=table(layout).f * noise[..., None]))

    def spread(order: np.ndarray, by: float) -> float:
        theta, offset = profile.theta_i[order], profile.offset[order] + by * rng.normal(size=order.size)
        rows, _ = scatter_laws(profile._replace(theta_i=theta, offset=offset, f=profile.f[order]), Channels.grey())
        return next(q.value for q in rows if q.name == "difference of incidences")

    ordered = np.arange(profile.offset.size)
    for by in (0.0, 1e-12):
        assert spread(rng.permutation(ordered), by) == pytest.approx(spread(ordered, 0.0), rel=1e-9)


def test_the_difference_of_incidences_scatters_as_it_says_and_holds_what_noise_and_interpolation_make() -> None:
    """A law that changes by 40 % to 60°, an exact one, and their readings with 5 % of noise; it stated no error."""

    def spread(change: float, noise: float, seed: int) -> Quantity:
        rng, exact = np.random.default_rng(seed), table(LAYOUTS["isotropic"])
        theta_i = LAYOUTS["isotropic"].angles()[0].reshape(exact.shape)
        f = exact.f * np.exp(change * theta_i) * (1 + noise * rng.standard_normal(exact.shape))
        rows, _ = scatter_laws(of_table(dataclasses.replace(exact, f=f, u_f=noise * exact.f)), Channels.grey())
        return next(q for q in rows if q.name == "difference of incidences")

    exact, equal = spread(0.4, 0.0, 0), spread(0.0, 0.0, 0)
    assert equal.value <= equal.bound and exact.u == equal.u == 0 and exact.place == "shift invariance does not hold"
    drawn = [spread(0.4, 0.05, seed) for seed in range(30)]
    off = [(q.value - exact.value) / q.u for q in drawn]
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5  # four standard errors
    assert all(q.value - q.bound - 2 * q.u < exact.value for q in drawn)
    assert all(spread(0.0, 0.05, seed).place != "shift invariance does not hold" for seed in range(10))
