"""Verdicts on light below the surface: models, profiles, and profiles with a mistake."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import gonio
from gonio.instrument.offsets_scan import measure_profile
from gonio.models.errors import GonioError
from gonio.models.subsurface.dipole import Dipole
from gonio.models.subsurface.wide_spots import WideSpots

MATERIAL = "dipole(sigma_a=[0.02, 0.2], sigma_s=1.5)"
SIDE = np.geomspace(0.2, 15, 16)
OFFSETS = np.concatenate([-SIDE[::-1], [0.0], SIDE])
SPOTS = {"illuminated_radius": 0.3, "viewed_radius": 0.3}


class Brighter(Dipole):
    """With a factor above 1 a liar: it gives back more than it received."""

    factor: jax.Array = eqx.field(converter=jnp.asarray, default=1.0)

    def hankel(self, k):
        return self.factor * super().hankel(k)

    def cumulative(self, r):
        return self.factor * super().cumulative(r)

    def profile(self, r):
        return self.factor * super().profile(r)


@pytest.fixture(scope="module")
def profile():
    exact = measure_profile(MATERIAL, gonio.Instrument(**SPOTS), OFFSETS)
    return dataclasses.replace(exact, u=1e-3 * exact.value)


def test_a_model_conserves_energy_and_is_reciprocal():
    certificate = gonio.check(WideSpots(Brighter(albedo=0.99, mfp=1.0)))
    assert certificate.overall == "pass" and certificate["positivity"].verdict == "pass"
    assert certificate["energy"].bound < 1e-9
    liar = gonio.check(WideSpots(Brighter(albedo=0.99, mfp=1.0, factor=1.5)))
    assert liar["energy"].verdict == "fail" and liar.exit_status == 1


def test_an_honest_profile_passes_and_says_what_was_not_read(profile):
    certificate = gonio.check(profile)
    assert certificate.overall == "pass" and "nothing was read beyond" in certificate["energy"].detail
    total = float(np.max(np.asarray(gonio.material(MATERIAL).brdf.bssrdf.total())))
    energy = certificate["energy"]
    assert abs(energy.residual + 1 - total) < energy.bound


def test_mistakes_are_caught(profile):
    brighter = dataclasses.replace(profile, value=3 * profile.value, u=3 * profile.u)
    assert gonio.check(brighter)["energy"].verdict == "fail"
    one_sided = dataclasses.replace(profile, value=np.where(OFFSETS[:, None] > 0, 1.2, 1.0) * profile.value)
    assert gonio.check(one_sided)["reciprocity"].verdict == "fail"
    negative = dataclasses.replace(profile, value=np.where(OFFSETS[:, None] == 0, -1.0, 1.0) * profile.value)
    assert gonio.check(negative)["positivity"].verdict == "fail"


@pytest.mark.parametrize("farthest", [0.3, 0.5, 8.0])
def test_what_leaves_beyond_the_last_offset_is_within_the_bound(farthest):
    """A milky material whose light goes far: near readings alone do not say that it gives back less than it got."""
    milky = "normalised_diffusion(albedo=0.9, mfp=1.3)"
    offsets = farthest * np.linspace(0, 1, 15)
    read = measure_profile(milky, gonio.Instrument(illuminated_radius=0.05, viewed_radius=0.1), offsets)
    total = float(np.max(np.asarray(gonio.material(milky).brdf.bssrdf.total())))
    honest = gonio.check(read)["energy"]
    assert abs(honest.residual + 1 - total) < honest.bound and honest.verdict != "fail"
    liar = gonio.check(dataclasses.replace(read, value=1.3 / total * read.value))["energy"]
    assert liar.verdict != "pass"


def test_what_was_read_on_one_side_is_not_testable(profile):
    side = OFFSETS >= 0
    parts = {n: getattr(profile, n)[side] for n in ("offsets", "value", "u", "flag")}
    certificate = gonio.check(dataclasses.replace(profile, **parts))
    assert certificate["reciprocity"].verdict == "not testable" and certificate.overall == "undecided"
    few = {n: getattr(profile, n)[-2:] for n in parts}
    assert gonio.check(dataclasses.replace(profile, **few))["energy"].verdict == "not testable"


def test_a_profile_takes_no_options_of_tables(profile):
    with pytest.raises(GonioError, match="leave model, against, further readings and instrument out"):
        gonio.check(profile, against="marble")
