"""Copies of readings: what stands how often, and the uncertainty of quantities that many copies make."""

import numpy as np

import gonio
from gonio.data.layouts import isotropic
from gonio.data.plausibility.copies import repeated
from gonio.data.table import Table, whole_table_of_values

NODES, AZIMUTHS = np.radians(np.arange(0, 81, 10)), np.radians(np.arange(0, 360, 15))
LAYOUT = isotropic(NODES, NODES, AZIMUTHS)
MIRROR = -np.arange(AZIMUTHS.size) % AZIMUTHS.size
F = gonio.material("lambert(rho=0.3) + 0.4 * ggx(alpha=0.3)").f(*LAYOUT.angles())[..., 0].reshape(LAYOUT.shape)


def table(seed: int, mirrored: bool) -> Table:
    """Readings with 5 % of noise, of all azimuths or of one side that was copied to the other."""
    y = F * (1 + 0.05 * np.random.default_rng(seed).standard_normal(F.shape))
    half = np.arange(AZIMUTHS.size) <= AZIMUTHS.size // 2
    y = np.where(half, y, y[..., MIRROR]) if mirrored else y
    return whole_table_of_values(LAYOUT, y, u_f=(0.05 * F)[..., None])


def test_readings_stand_as_often_as_they_were_copied() -> None:
    assert repeated(table(0, mirrored=False)) is None
    times = repeated(table(0, mirrored=True))
    assert times is not None
    in_plane = np.broadcast_to(np.isin(np.arange(AZIMUTHS.size), (0, AZIMUTHS.size // 2)), LAYOUT.shape).ravel()
    assert (times[~in_plane] == 2).all() and (times[in_plane] == 1).all()


def test_albedos_of_a_mirrored_table_scatter_as_they_say() -> None:
    """Forty draws: the standard deviation is known to 11 %, and four of these are allowed; 1.5 times without copies."""
    results = [gonio.quantities(table(seed, mirrored=True), only=["reflectance"]) for seed in range(40)]
    rows = [[q for q in r.quantities if q.name == "albedo"] for r in results]
    scatter = np.std([[q.value for q in row] for row in rows], axis=0, ddof=1)
    stated = np.mean([[q.u for q in row] for row in rows], axis=0)
    assert np.sqrt(np.mean((scatter / stated) ** 2)) < 1.2
    assert any("repeat others" in note for note in results[0].notes)
