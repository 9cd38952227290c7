"""Regions too dark to be tested: bounded by the light of the sample, which a violation in them cannot exceed."""

import itertools

import numpy as np
import pytest

from gonio.checks.table.dark_regions import OpenLight, light_of_open_regions
from gonio.checks.table.equal_readings import table_reciprocity
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs.places import SIDE
from gonio.checks.table.statistics.region_sums import Region
from gonio.data.table import whole_table_of_values
from support.check_tables import SQUARE

THETA_I, _, THETA_O, TURN = (a.reshape(SQUARE.shape) for a in SQUARE.angles())
SEEN = np.cos(THETA_O) * np.sin(THETA_O) * np.radians(10) * np.radians(30)
"""Projected solid angle of a cell."""


def judged(noise, lie=0.0, seed=0):
    """(the check, the largest share of an incidence's light by which its readings break the law)."""
    lobe = 3 * np.exp(-((THETA_I - THETA_O) ** 2 + 0.3 * (1 + np.cos(TURN))) / 0.1)
    dark = np.where(lobe < 0.01, 3e-3, 0.0)
    wrong = lie * dark * np.sign(THETA_I - THETA_O)
    f = 0.02 * lobe**0.5 + lobe + dark + wrong
    reading = f + noise * np.random.default_rng(seed).standard_normal(f.shape)
    table = whole_table_of_values(SQUARE, reading, u_f=np.full((*f.shape, 1), noise))
    change, light = ((np.abs(v) * SEEN).sum(axis=(1, 2)) for v in (2 * wrong, f))
    return table_reciprocity(TableEvidence(table), 0.05), float(np.max(change / light))


@pytest.mark.parametrize(
    ("noise", "lie", "verdict"),
    [
        (1e-5, 0.0, "pass"),  # all of it is tested
        (1e-3, 0.0, "pass"),
        (1e-3, 0.05, "pass"),  # a violation that no test shows
        (0.1, 0.0, "undecided"),  # what noise hides is no small share of the light
        (1e-5, 0.2, "fail"),  # and one that is seen fails, however dark
    ],
)
def test_what_is_not_excluded_in_the_dark_is_held_against_the_light(noise, lie, verdict):
    for seed in range(2):
        check, change = judged(noise, lie, seed)
        assert check.verdict == verdict
        assert ("too noisy to tell" in check.detail) == (verdict == "pass" and noise == 1e-3)
        assert change <= check.facts.get("open_in_the_dark", 1.0) < 0.05 or verdict != "pass" or noise < 1e-3


def test_even_light_of_all_regions_is_the_albedo_at_every_incidence():
    front = [
        Region("square", high * SIDE + low, np.zeros(0), 12.0, 0.0, 1.0, 1.0, 12 * 0.3 / np.pi, 0.0)
        for high, low in itertools.product(range(9), range(9))
        if low <= high
    ]
    is_open = np.array([r.number == 8 * SIDE + 2 for r in front])
    of = light_of_open_regions(front, is_open, np.full(len(front), 0.1 / np.pi))
    np.testing.assert_allclose(of.light[:9], 0.3, rtol=1e-12)
    assert not of.light[9:].any() and set(np.flatnonzero(of.change)) == {2, 8}
    np.testing.assert_allclose(of.change[8], 0.1 * (np.sin(np.pi / 6) ** 2 - np.sin(np.pi / 9) ** 2), rtol=1e-12)


def test_an_incidence_without_light_is_held_against_the_brightest():
    light = np.array([0.5, 0.001] + [0.0] * (SIDE - 2))
    for change, within in ((0.004, True), (0.03, False)):
        share, of_light = OpenLight(light, np.full(SIDE, change) * (light < 0.1)).worst(0.05)
        assert (share <= 1) == within
        assert of_light == pytest.approx(change / 0.5)
