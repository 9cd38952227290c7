"""Bootstrap: agrees with theory for independent noise, and keeps what neighbours share together."""

import dataclasses

import numpy as np
import pytest

from gonio.data.flags import Flag
from gonio.fitting.fit_table import fit
from gonio.fitting.uncertainty.bootstrap import block_cells
from gonio.models.errors import GonioError
from support.fit_tables import ISOTROPIC, table_of

REFITS = 120


def linear_table(noise):
    table = table_of("lambert(rho=0.5)")
    return dataclasses.replace(table, f=np.where(table.flag == Flag.VALID, table.f + noise, np.nan))


@pytest.mark.parametrize("kind", ["wild", "block_pairs"])
def test_independent_noise_gives_the_standard_error_of_a_mean(kind):
    noise = 0.01 * np.random.default_rng(0).standard_normal((*ISOTROPIC.shape, 1))
    result = fit(linear_table(noise), "lambert", loss="linear", bootstrap=REFITS, bootstrap_kind=kind)
    (number,) = result.bootstrap["numbers"]
    expected = np.pi * 0.01 / np.sqrt(result.samples)
    assert number["standard_uncertainty"] == pytest.approx(expected, rel=0.25)  # 4 of its own deviations
    assert number["name"] == "lambert.rho" and result.bootstrap["failed"] == 0
    low, high = number["interval95"]
    assert (
        low < 0.5 + 3 * expected and high > 0.5 - 3 * expected and high - low == pytest.approx(3.9 * expected, rel=0.3)
    )


def test_shared_errors_are_not_averaged_away():
    """An error that is one for each incidence: the uncertainty is that of 18 readings, not of thousands."""
    rng = np.random.default_rng(3)
    wi = ISOTROPIC.directions()[0]
    row = np.unique(np.round(wi.x, 6), return_inverse=True)[1].reshape(*ISOTROPIC.shape, 1)
    of_row = 0.02 * rng.standard_normal(18)
    result = fit(linear_table(of_row[row]), "lambert", loss="linear", bootstrap=REFITS)
    (p,) = [p for p in result.parameters if p.status != "fixed"]
    (number,) = result.bootstrap["numbers"]
    expected = np.pi * of_row.std() / np.sqrt(18)
    assert number["standard_uncertainty"] == pytest.approx(expected, rel=0.4)
    assert p.standard_uncertainty == pytest.approx(expected, rel=0.4)  # what is printed without a bootstrap too
    assert result.bootstrap["block_cells"][0] > 50
    assert result.residuals.noisiness.verdict == "structure"


def test_blocks_are_as_long_as_what_neighbours_share():
    rng = np.random.default_rng(4)
    white = rng.standard_normal((20_000, 1))
    assert block_cells(white) == 2
    smooth = np.repeat(rng.standard_normal((200, 1)), 100, axis=0)
    assert 100 <= block_cells(smooth) <= 250


def test_the_same_seed_gives_the_same_numbers():
    table = table_of("lambert(rho=[.1,.2,.4])+[.6,.5,.4]*ggx(alpha=0.3)", noise=0.03)
    first, again = (fit(table, "lambert + ggx", starts=0, bootstrap=10, seed=5).bootstrap for _ in range(2))
    assert first["numbers"] == again["numbers"] and len(first["numbers"]) == 7
    ratio = [
        n["standard_uncertainty"] / p.standard_uncertainty
        for n, p in zip(first["numbers"], fit(table, "lambert + ggx", starts=0).parameters, strict=False)
    ]
    assert 0.4 < np.median(ratio) < 2


def test_what_cannot_be_drawn_is_one_sentence():
    table = table_of("lambert(rho=0.5)")
    with pytest.raises(GonioError, match="from 2 to"):
        fit(table, "lambert", bootstrap=1)
    with pytest.raises(GonioError, match="wild"):
        fit(table, "lambert", bootstrap=20, bootstrap_kind="wlid")
