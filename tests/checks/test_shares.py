"""The check of a table in shares: any division gives the certificate of one check, to the bit."""

import itertools
import math

import numpy as np
import pytest

import gonio
from gonio.checks.certify import CheckSettings
from gonio.checks.shares import Share, do_share, is_ordinary, put_together, shares_of
from gonio.data.flags import Flag


def table(material, scan="isotropic", holes=0.0, **options):
    """A noisy table on a coarse grid, of which a share of the readings is missing."""
    measured = gonio.measure(material, gonio.Instrument(photons=1e5), gonio.scan(scan, **options), seed=1, log=None)
    lost = np.random.default_rng(2).random(measured.f.shape) < holes
    measured.f, measured.flag = np.where(lost, np.nan, measured.f), np.where(lost, Flag.NOT_MEASURED, measured.flag)
    measured.name = "a table"
    return measured


TABLES = {
    "isotropic": (lambda: table("lambert(rho=[0.4, 0.3]) + ggx(alpha=0.3, f0=0.04)", step=math.radians(15)), {}),
    "with holes": (lambda: table("lambert(rho=0.9)", holes=0.2, step=math.radians(15)), {"strict": True}),
    "no mirror": (
        lambda: table("lambert(rho=0.3)", step=math.radians(10), phi_step=math.radians(40)), {"feature_width": 0.1}
    ),
    "spherical": (lambda: table("lambert(rho=0.5)", "spherical", step=math.radians(30)), {"level": 0.05}),
    "half-difference": (lambda: table("lambert(rho=0.5)", "half-difference", step=math.radians(30)), {}),
    "in-plane": (lambda: table("lambert(rho=0.5)", "in-plane", step=math.radians(15)), {}),
    "behind": (
        lambda: table("lambert(rho=0.3) + lambert_transmission(tau=0.4)", hemisphere="both", step=math.radians(30)), {}
    ),
}  # fmt: skip


def divided(whole, share, rng):
    """A share of energy in shares of its own, cut anywhere."""
    if share.name != "energy":
        return [share]
    cuts = np.unique(rng.integers(share.start, share.stop, 3)).tolist()
    edges = sorted({share.start, *cuts, share.stop})
    return [Share("energy", a, b) for a, b in itertools.pairwise(edges)]


@pytest.mark.parametrize("name", TABLES)
def test_any_division_gives_the_bits_of_one_check(name, tmp_path):
    make, options = TABLES[name]
    whole, settings, rng = make(), CheckSettings(**options), np.random.default_rng(len(name))
    assert is_ordinary(whole)
    expected = gonio.check(whole, **options).to_json()
    for values in (1, 1500):
        shares = shares_of(whole.layout, len(whole.channels), settings, values)
        shares = [cut for share in shares for cut in divided(whole, share, rng)]
        done = {k: do_share(whole, shares[k], settings) for k in rng.permutation(len(shares)).tolist()}
        for k, arrays in done.items():  # by way of a file
            np.savez(tmp_path / f"{k}.npz", allow_pickle=False, **arrays)
            with np.load(tmp_path / f"{k}.npz", allow_pickle=False) as file:
                done[k] = {field: file[field] for field in file.files}
        assert put_together(whole, settings, [(s, done[k]) for k, s in enumerate(shares)]).to_json() == expected
    assert any(s.name == "energy" for s in shares) == (name not in ("half-difference", "in-plane", "behind"))
