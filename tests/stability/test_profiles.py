"""Light below the surface in the atlas: forms agree where they are easy, and a wrong profile is called so."""

import equinox as eqx
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

from gonio.models.subsurface.dipole import Dipole
from gonio.models.volume_scatter.chandrasekhar_h import half_space_albedo
from gonio.stability import profiles
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT

pytestmark = pytest.mark.quick_compilation


def test_profiles_are_right_towards_no_scattering():
    """In single precision; the total by an integral of another form, in double."""
    name = "normalised_diffusion"
    setting = profiles.settings(name)[0]
    assert {c.verdict for c in profiles.cells("value", name, setting, "float32")} == {RIGHT}
    assert {c.verdict for c in profiles.cells("integral", name, setting, "float64")} == {RIGHT}


@pytest.mark.thorough
def test_the_slope_by_the_index_is_finite_without_an_interface():
    cells = profiles.cells("gradient", "better_dipole", "better_dipole(albedo=0.9, mfp=1, eta=1)", "float32")
    assert {c.verdict for c in cells} == {RIGHT}


def test_a_profile_that_is_off_is_called_silently_wrong(monkeypatch):
    class Off(Dipole):
        def profile(self, r):
            return super().profile(r) * (1 + 1e-12)

        def cumulative(self, r):
            return super().cumulative(r) + 1e-8

    assert issubclass(Off, eqx.Module)
    monkeypatch.setitem(profiles.BSSRDFS, "dipole", Off)
    setting = profiles.settings("dipole")[2]
    assert SILENT in {c.verdict for c in profiles.cells("value", "dipole", setting, "float64")}
    within, total = profiles.cells("integral", "dipole", setting, "float64")
    assert (within.verdict, total.verdict) == (SILENT, RIGHT)


def test_a_fit_to_what_leaves_near_the_beam_says_what_it_leaves_open(monkeypatch):
    monkeypatch.setattr(profiles, "FITTED", {"near": profiles.FITTED["near"]})
    assert [c.verdict for c in profiles.fit_cells("dipole")] == [SAYS_SO]


def test_half_spaces_reflect_in_proportion_to_a_small_albedo():
    """1 − √(1 − w) H(1) by H's integral at thirty digits."""
    w = np.array([1e-9, 1e-3, 0.9])
    with mp.workdps(30):
        logs = [
            mp.quad(lambda t, a=a: mp.log(1 - mp.mpf(a) * t * mp.cot(t)), [0, 0.01, mp.pi / 4, mp.pi / 2]) for a in w
        ]
        exact = [float(1 - mp.sqrt(1 - mp.mpf(a)) * mp.exp(-k / mp.pi)) for a, k in zip(w, logs, strict=True)]
    np.testing.assert_allclose(half_space_albedo(jnp.ones(()), jnp.asarray(w)), exact, rtol=2e-14)
