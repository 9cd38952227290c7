"""Realisability of Mueller matrices, by random mixtures of Jones matrices and by what no mixture gives."""

import numpy as np
import pytest

from gonio.checks.certify import check, judged_property
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.realisability import least_eigenvalues, parts_of
from support import mueller

SUBSETS = {
    "all": range(16),
    "without circular light": [k for k in range(16) if k % 4 < 3 and k < 12],
    "first row": range(4),
    "first column": range(0, 16, 4),
    "s and p": [0, 1, 4, 5],
    "block diagonal": [0, 1, 4, 5, 10, 11, 14, 15],
    "odd": [0, 3, 5, 6, 12, 15],
}


def judged(f, some=range(16), u_f=None):
    names = [mueller.NAMES[k] for k in some]
    table = mueller.list_of(f[..., some], names, None if u_f is None else u_f[..., some])
    return judged_property("realisability", "table", TableEvidence(table))


@pytest.mark.parametrize("some", SUBSETS.values(), ids=SUBSETS)
def test_mixtures_of_jones_matrices_are_realisable_by_whatever_was_read(some):
    for seed in range(3):
        result = judged(mueller.on_grid(seed, 1 + seed), list(some))
        assert result.verdict == "pass" and result.residual < 1e-9
        assert bool(result.facts["not_looked_at"]) == (len(some) < 16) == ("Not looked at" in result.detail)


@pytest.mark.parametrize("some", SUBSETS.values(), ids=SUBSETS)
def test_a_part_is_realisable_with_nothing_in_place_of_the_others(some):
    made = mueller.mixtures(np.random.default_rng(0), 2000, terms=1)
    for part in parts_of(frozenset(divmod(k, 4) for k in some)):
        mask = np.array([divmod(k, 4) in part for k in range(16)])
        assert least_eigenvalues(np.where(mask, made, 0.0)).min() > -1e-9


def test_the_eigenvalues_are_those_that_are_known():
    """Depolarisers diag(1, a, b, c): (1 + a + b + c)/4, (1 + a − b − c)/4 and the like [Cloude 1986]."""
    a, b, c = np.random.default_rng(1).uniform(-1, 1, (3, 50))
    matrices = np.zeros((50, 16))
    matrices[:, [0, 5, 10, 15]] = np.stack([1 + 0 * a, a, b, c], axis=-1)
    every = np.stack([1 + a + b + c, 1 + a - b - c, 1 - a + b - c, 1 - a - b + c]) / 4
    assert np.allclose(least_eigenvalues(matrices), every.min(axis=0))


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        (lambda f: f * np.where(np.arange(16), 1.3, 1.0), ""),
        (lambda f: f * np.where(np.arange(16) >= 12, -1, 1), "With the other handedness"),
        (lambda f: f / np.where(np.arange(16), f[..., :1], 1.0), "multiply them by m00"),
    ],
    ids=["a depolarisation index above 1", "another handedness", "ratios"],
)
def test_what_no_optics_do_fails(change, hint):
    f = mueller.on_grid(5, terms=1)
    u = 0.01 * f[..., :1] + 0 * f
    noise = u * np.random.default_rng(2).normal(size=f.shape)
    result = judged(change(f) + noise, u_f=u)
    assert result.verdict == "fail" and hint in result.detail
    assert check(mueller.list_of(change(f), mueller.NAMES, u), name="any").overall == "fail"


def test_noise_of_honest_readings_does_not_fail():
    """Of pure matrices three eigenvalues are 0, and noise makes one negative in every reading."""
    rng = np.random.default_rng(3)
    for seed in range(6):
        f = mueller.on_grid(seed, terms=1)
        u = (0.003, 0.03, 0.1)[seed % 3] * f[..., :1] + 0 * f
        noisy = f + u * rng.normal(size=f.shape)
        assert judged(noisy, u_f=u).verdict != "fail" and judged(noisy).verdict != "fail"


def test_a_single_reading_fails_where_its_uncertainty_is_stated():
    f = mueller.on_grid(7)
    f[3, 4, 5, 1] = 1.5 * f[3, 4, 5, 0]
    u = 0.001 * f[..., :1] + 0 * f
    assert judged(f, u_f=u).verdict == "fail" and judged(f).verdict == "pass"
    assert judged(f).facts["not_as_read"] == 1


def test_tables_without_mueller_matrices_are_not_judged():
    names = ["550 nm s to p", "550 nm p to s"]
    assert "realisability" not in [
        p.name for p in check(mueller.list_of(mueller.on_grid(1)[..., :2], names)).properties
    ]
