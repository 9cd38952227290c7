"""A profile's fit with a free index: what it is where the readings tell it, and that it is open where they do not."""

import dataclasses

import numpy as np
import pytest

import gonio
from gonio.data.channels import Channels
from gonio.fitting.subsurface.profile_fit import fit_profile
from gonio.instrument.instrument import Instrument

OFFSETS = np.linspace(0.05, 6, 24)


def profile_of(photons):
    instrument = Instrument(illuminated_radius=0.1, viewed_radius=0.1, photons=photons)
    return gonio.measure_profile("dipole(sigma_a=0.02, sigma_s=1.5, eta=1.4)", instrument, OFFSETS, seed=2)


@pytest.mark.thorough
def test_intervals_hold_what_a_free_index_leaves_open():
    """With few photons any index follows, which the fit names; intervals are wider than at one index, and hold the
    truth."""
    profile = profile_of(1e5)
    free, fixed = fit_profile(profile, "dipole(eta=?)"), fit_profile(profile, "dipole(eta=1.4)")
    numbers = {p.name.rpartition(".")[2]: p for p in free.parameters}
    truth = {"sigma_a": 0.02, "sigma_s": 1.5, "eta": 1.4}
    for name, p in numbers.items():
        assert p.interval95[0] <= truth[name] <= p.interval95[1]
    for p in fixed.parameters[:2]:
        wider = numbers[p.name.rpartition(".")[2]]
        assert np.ptp(wider.interval95) >= np.ptp(p.interval95)
        assert wider.standard_uncertainty >= p.standard_uncertainty
    assert free.cost <= fixed.cost * (1 + 1e-9)
    stored = np.array(free.covariance_by_channel[0]["covariance"])
    assert stored.shape == (3, 3) and free.covariance_by_channel[0]["numbers"] == [0, 1, 2]
    if numbers["eta"].status == "determined":
        assert np.sqrt(np.diag(stored)) == pytest.approx([p.standard_uncertainty for p in free.parameters], rel=0.5)
    opened = numbers["eta"].status == "undetermined"
    assert opened == any("eta is not determined" in sentence for sentence in free.undetermined)


def test_exact_readings_tell_the_index():
    free = fit_profile(profile_of(None), "dipole(eta=?)")
    eta = free.parameters[2]
    assert eta.value == pytest.approx(1.4, abs=2e-3) and eta.status == "determined"


@pytest.mark.thorough
def test_channels_that_err_together_tell_the_index_no_better_than_one():
    one = profile_of(1e7)
    three = dataclasses.replace(
        one, channels=Channels.of_count(3), **{k: np.repeat(getattr(one, k), 3, axis=1) for k in ("value", "u", "flag")}
    )
    alone, together = (
        next(p for p in fit_profile(profile, "dipole(eta=?)").parameters if p.name.endswith("eta"))
        for profile in (one, three)
    )
    assert together.interval95 == pytest.approx(alone.interval95, rel=1e-3)
