"""The signal chain: readings vary as their stored uncertainty says, and depend on the seed and the cell alone."""

import itertools
import math

import numpy as np
import pytest

from gonio.instrument.instrument import Instrument
from gonio.instrument.noise import read, standard_uncertainty

CELLS, CHANNELS = 40_000, 3  # 120,000 readings
GAIN = 1.03
RNG = np.random.default_rng(8)
COS = RNG.uniform(0.05, 1.0, CELLS)
BRIGHT = 10 ** RNG.uniform(-3, 1, (CELLS, CHANNELS))
BLACK = np.zeros((CELLS, CHANNELS))

SOURCES = {
    "shot": (Instrument(photons=1e4), BRIGHT),
    "few photons": (Instrument(photons=20), BRIGHT),
    "negative": (Instrument(photons=300), -BRIGHT),
    "ambient": (Instrument(photons=1e4, ambient=0.02), BLACK),
    "dark": (Instrument(photons=1e4, dark=7.0), BLACK),
    "reading out": (Instrument(photons=1e4, read_noise=12.0), BLACK),
    "source": (Instrument(noise=0.05), BRIGHT),
    "unsteady source": (Instrument(noise=0.8, photons=50), BRIGHT),
    "all": (Instrument(photons=1e3, ambient=0.1, dark=5.0, read_noise=3.0, noise=0.02), BRIGHT),
}


@pytest.mark.parametrize("source", SOURCES)
def test_readings_vary_as_their_uncertainty_states(source):
    instrument, expected = SOURCES[source]
    readings, full = read(instrument, 11, 0, expected, COS, GAIN)
    u_f = standard_uncertainty(instrument, expected, COS, GAIN)
    z = (readings - expected) / u_f
    n = z.size
    # The sampling error of a mean square is set by its own fourth moment, which Poisson's law makes large.
    chi2, spread = np.mean(z**2), np.std(z**2) / math.sqrt(n)
    assert abs(z.mean()) < 4 / math.sqrt(n)
    assert abs(chi2 - 1) < 4 * spread and spread < 0.02
    assert not full.any()
    assert np.abs(np.corrcoef(z.T) - np.eye(CHANNELS)).max() < 4.5 / math.sqrt(CELLS)


def test_an_ideal_reading_is_its_expectation_and_exact():
    readings, full = read(Instrument(), 1, 0, BRIGHT, COS)
    assert readings is BRIGHT and not full.any()
    assert not standard_uncertainty(Instrument(), BRIGHT, COS).any()


def test_where_no_count_is_expected_the_uncertainty_is_that_of_one_in_many_readings():
    """1e-153 was stated; an ideal reading stays exact, and a source's own noise is a share of f."""
    dark = 10.0 ** np.arange(-300, -5)[:, None]
    lit = np.ones(dark.shape[0])
    counts = 1e4 * math.pi
    u_f = standard_uncertainty(Instrument(photons=1e4), dark, lit)
    assert u_f == pytest.approx(np.maximum(0.01, np.sqrt(counts * dark)) / counts)
    assert standard_uncertainty(Instrument(noise=0.1), dark, lit) == pytest.approx(0.1 * dark)


@pytest.mark.parametrize("source", ["all", "source"])
def test_the_cut_into_blocks_changes_no_bit_and_the_seed_every_reading(source):
    instrument, expected = SOURCES[source]
    whole, _ = read(instrument, 5, 1000, expected, COS, GAIN)
    cuts = [0, 1, 17, 30_000, 30_001, CELLS]
    parts = [read(instrument, 5, 1000 + a, expected[a:b], COS[a:b], GAIN)[0] for a, b in itertools.pairwise(cuts)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    for seed in (6, 5 + (1 << 32)):
        other, _ = read(instrument, seed, 1000, expected, COS, GAIN)
        assert np.mean(other == whole) < 0.01
    beyond, _ = read(instrument, 5, 1000 + (1 << 32), expected, COS, GAIN)
    assert np.mean(beyond == whole) < 0.01


def test_a_full_detector_is_flagged():
    instrument = Instrument(photons=1000, saturation=500)
    expected = np.full((CELLS, 1), 1 / math.pi)
    _, full = read(instrument, 2, 0, expected, COS)
    counts = 1000 * COS
    assert full[counts > 620].all() and not full[counts < 400].any()
    assert 0.4 < full[np.abs(counts - 500) < 5].mean() < 0.6


def test_ambient_light_is_subtracted_and_only_adds_noise():
    expected = np.full((CELLS, 1), 0.1)
    calm = standard_uncertainty(Instrument(photons=1e4), expected, COS)
    lit = Instrument(photons=1e4, ambient=3.0)
    readings, _ = read(lit, 4, 0, expected, COS)
    u_f = standard_uncertainty(lit, expected, COS)
    assert (u_f > 3 * calm).all()
    assert abs(np.mean((readings - expected) / u_f)) < 4 / math.sqrt(CELLS)
