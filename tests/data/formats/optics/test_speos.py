"""Speos files: the scale by the stated totals, the sides, the rotation of the sample, and what is refused."""

import numpy as np
import pytest

from gonio.data.flags import Flag
from gonio.data.formats.registry import read, sniff
from gonio.models.errors import GonioError
from support.optics_files import speos_anisotropic, speos_isotropic

FRONT, BEHIND = np.arange(0.0, 91.0, 15.0), np.arange(90.0, 181.0, 15.0)
PHI = np.arange(0.0, 361.0, 45.0)
FLAT = [(350, 40.0), (850, 40.0)]


def written(folder, text, name="t.anisotropicbsdf"):
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def uniform(theta, scale=1.0):
    return theta, PHI, np.full((len(theta), len(PHI)), scale)


def lobes(seed):
    """Values that differ in every direction but at the poles and at a whole turn."""
    values = np.random.default_rng(seed).uniform(0.1, 1, (len(FRONT), len(PHI)))
    values[0], values[:, -1] = values[0, 0], values[:, 0]
    return values


@pytest.mark.parametrize("bsdf", [1, 0], ids=["BSDF", "intensity"])
@pytest.mark.parametrize("theta", [FRONT, BEHIND], ids=["reflection", "transmission"])
def test_the_total_scales_a_uniform_block_to_its_closed_form(tmp_path, theta, bsdf):
    """A white surface with the albedo 0.4: f = 0.4/π, whatever the values are multiples of."""
    values = 7.0 * (np.ones(len(theta)) if bsdf else np.abs(np.cos(np.radians(theta))))[:, None] * np.ones(len(PHI))
    parts = (1, 0) if theta is FRONT else (0, 1)
    text = speos_anisotropic(parts, [0.0], [10.0, 50.0], [((10.0, 0.0), FLAT)], [(theta, PHI, values)] * 2, bsdf)
    table = read(written(tmp_path, text))
    valid = table.flag == Flag.VALID
    np.testing.assert_allclose(table.f[valid], 0.4 / np.pi, rtol=1e-9)
    on_horizon = np.abs(table.layout.axes["theta_o"] - np.pi / 2) < 1e-9
    assert valid[:, ~on_horizon].all() and (table.flag[:, on_horizon] == Flag.BELOW_HORIZON).all()
    assert table.sides == {(1, 1 if theta is FRONT else -1)} and table.channels.names == ("grey",)


def test_both_sides_in_one_file_have_totals_of_their_own(tmp_path):
    spectra = [((10.0, 0.0), [(350, 40.0), (850, 40.0)]), ((10.0, 0.0), [(350, 20.0), (850, 20.0)])]
    table = read(
        written(tmp_path, speos_anisotropic((1, 1), [0.0], [10.0], spectra, [uniform(FRONT), uniform(BEHIND)]))
    )
    parts = table.parts()
    assert set(parts) == {(1, 1), (1, -1)}
    for sides, share in (((1, 1), 0.4), ((1, -1), 0.2)):
        f = parts[sides].f[parts[sides].flag == Flag.VALID]
        np.testing.assert_allclose(f, share / np.pi, rtol=1e-9)


def test_azimuth_zero_is_the_mirror_side_and_the_rotation_turns_the_light_back(tmp_path):
    values, turned = lobes(1), lobes(2)
    rotation = [0.0, 30.0]
    blocks = [(FRONT, PHI, values), (FRONT, PHI, turned)]
    table = read(written(tmp_path, speos_anisotropic((1, 0), rotation, [40.0], [((40.0, 0.0), FLAT)], blocks)))
    block = table.read()
    for angle, of_rotation in zip(rotation, (values, turned), strict=True):
        t, p = 2, 1
        azimuth = np.radians(PHI[p] - angle + 180)  # of a light at +x where the sample was not turned
        wo = np.array([np.sin(np.radians(FRONT[t])) * np.cos(azimuth), np.sin(np.radians(FRONT[t])) * np.sin(azimuth)])
        light = np.sin(np.radians(40.0)) * np.array([np.cos(np.radians(-angle)), np.sin(np.radians(-angle))])
        offset = np.abs(
            np.stack([block.wo.x - wo[0], block.wo.y - wo[1], block.wi.x - light[0], block.wi.y - light[1]])
        )
        here = np.flatnonzero(offset.max(axis=0) < 1e-9)
        assert here.size == 1
        scale = block.f[here, 0] / of_rotation[t, p]
        assert scale == pytest.approx(float(np.nanmax(table.f)) / max(values[:-1].max(), turned[:-1].max()), rel=1e-9)


def test_a_spectrum_is_one_distribution_times_its_totals(tmp_path):
    totals = [(650, 30.0), (450, 10.0), (550, 20.0)]
    table = read(written(tmp_path, speos_anisotropic((1, 0), [0.0], [0.0], [((0.0, 0.0), totals)], [uniform(FRONT)])))
    assert table.channels.wavelengths_nm == (450.0, 550.0, 650.0)
    np.testing.assert_allclose(table.f[0, 1, 1], np.array([0.1, 0.2, 0.3]) / np.pi, rtol=1e-9)


@pytest.mark.parametrize(("reference", "expected"), [(10.0, 1.0), (30.0, 2 / 3), (0.0, 1.0), (90.0, 0.5)])
def test_between_two_incidences_the_scale_is_interpolated_and_beyond_them_held(tmp_path, reference, expected):
    """Totals of 40 % with blocks whose integrals are 1 and 2 at 10° and 50°: the factors are 0.4 and 0.2."""
    blocks = [uniform(FRONT), uniform(FRONT, 2.0)]
    table = read(written(tmp_path, speos_anisotropic((1, 0), [0.0], [10.0, 50.0], [((reference, 0.0), FLAT)], blocks)))
    expected = {10.0: 0.4, 0.0: 0.4, 30.0: 0.3, 90.0: 0.2}[reference]
    np.testing.assert_allclose(table.f[:, 1, 1, 0], np.array([1, 2]) * expected / np.pi, rtol=1e-9)


def test_a_brdf_file_has_a_total_for_each_incidence_and_wavelength(tmp_path):
    percent = [10.0, 20.0, 30.0, 40.0]
    blocks = [(p, *uniform(FRONT, 1 + k)) for k, p in enumerate(percent)]
    table = read(written(tmp_path, speos_isotropic((1, 0), [10.0, 50.0], [450.0, 550.0], blocks), "t.brdf"))
    np.testing.assert_allclose(table.f[:, 1, 1] * np.pi, np.reshape(percent, (2, 2)) / 100, rtol=1e-9)
    assert sniff(tmp_path / "t.brdf").name == "Speos" and table.layout.name == "isotropic"


def test_azimuths_of_one_side_stand_for_both(tmp_path):
    phi, values = PHI[:5], lobes(3)[:, :5]
    whole = np.concatenate([values, values[:, 3::-1]], axis=1)
    half = read(written(tmp_path, speos_isotropic((1, 0), [20.0], [550.0], [(30.0, FRONT, phi, values)]), "h.brdf"))
    full = read(written(tmp_path, speos_isotropic((1, 0), [20.0], [550.0], [(30.0, FRONT, PHI, whole)]), "f.brdf"))
    assert half.layout.mirrored_axes == ("delta_phi",) and not full.layout.mirrored_axes
    np.testing.assert_allclose(half.f[:, :-1, 1:], full.f[:, :-1, 1:5], rtol=1e-12)


def test_blocks_with_angles_of_their_own_keep_their_nodes(tmp_path):
    fine = np.arange(0.0, 91.0, 7.5)
    linear = [
        (30.0, FRONT, PHI, np.add.outer(FRONT, 0 * PHI) + 10),
        (30.0, fine, PHI, np.add.outer(fine, 0 * PHI) + 10),
    ]
    table = read(written(tmp_path, speos_isotropic((1, 0), [10.0, 50.0], [550.0], linear), "t.brdf"))
    np.testing.assert_allclose(table.f[0, :-1], table.f[1, :-1], rtol=1e-3)
    assert any("values of the common grid lie between their nodes" in line for line in table.provenance["understood"])


GOOD = speos_anisotropic((1, 0), [0.0], [10.0], [((10.0, 0.0), FLAT)], [uniform(FRONT)])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("v8.0\n0", "v8.0\n1", "is a binary Speos BSDF file; save it as text"),
        ("v8.0", "v6.0", "of version 6.0, and gonio reads 8.0"),
        ("OPTIS - Anisotropic BSDF surface file v8.0", "OPTIS - BSDF180 file v1", "of the kind 'BSDF180 file v1'"),
        ("1\t0\n1\n", "0\t0\n1\n", "neither reflection nor transmission"),
        ("7 9\n", "7 99999999\n", "expected a whole number from 1 to 20,000"),
        ("7 9\n", "20000 9\n", "more than the file holds"),
        ("7 9\n", "7 8\n", "the azimuths of a block has 9 numbers, expected 8"),
        ("350\t40.0", "350\t40,0", "has decimal commas"),
        ("350\t40.0", "350\t-4", "a total is -4 per cent"),
        ("350\t40.0", "850\t40.0", "wavelengths are not all different"),
        ("1\n10.0", "1\n100.0", "the list of incidences has the angle 100"),
        ("90.0\t1.0", "95.0\t1.0", "of reflection is outside of 0 to 90 degrees"),
        ("End of file", "", ""),
    ],
)
def test_what_is_damaged_or_of_another_kind_is_refused_by_its_name(tmp_path, old, new, said):
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new, 1))
    if not said:
        assert read(path).layout.size
        return
    with pytest.raises(GonioError) as error:
        read(path)
    assert said in str(error.value) and "\n" not in str(error.value) and "t.anisotropicbsdf" in str(error.value)
