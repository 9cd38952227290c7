"""The scan of offsets: what it reads, its noise, and the file that keeps it."""

import dataclasses

import h5py
import numpy as np
import pytest
import xarray

import gonio
from gonio.data.channels import Channels
from gonio.data.hdf5.reader import holds_profile, open_profile
from gonio.data.profile_files import profile_of, write_profile
from gonio.instrument.offsets_scan import measure_profile, parsed_offsets
from gonio.models.errors import GonioError
from gonio.models.fresnel import fresnel_dielectric
from gonio.models.subsurface.evaluation import evaluated

MATERIAL = "dipole(sigma_a=[0.02, 0.1], sigma_s=1.5, eta=1.3)"
OFFSETS = np.array([-2.0, 1.0, 5.0])


def test_points_read_the_profile_through_the_surface_twice():
    profile = measure_profile(MATERIAL, offsets=OFFSETS)
    passed = (1 - float(fresnel_dielectric(np.ones(()), 1.3))) ** 2
    exact = passed * evaluated(gonio.material(MATERIAL).brdf.bssrdf, "profile", np.abs(OFFSETS))
    assert profile.value == pytest.approx(exact, rel=1e-12) and not profile.u.any()


def test_noise_is_that_of_the_photons():
    device = gonio.Instrument(photons=1e6, illuminated_radius=0.5, viewed_radius=0.5)
    exact = measure_profile(MATERIAL, gonio.Instrument(illuminated_radius=0.5, viewed_radius=0.5), OFFSETS)
    area = np.pi * 0.25
    many = [measure_profile(MATERIAL, device, np.full(500, 1.0), seed=seed) for seed in range(2)]
    expected = np.sqrt(exact.value[1] * area / 1e6) / area  # counts of a white diffuser that fills the lit spot
    for profile in many:
        assert profile.u[0] == pytest.approx(expected, rel=1e-9)
        assert np.std(profile.value, axis=0) == pytest.approx(expected, rel=0.15)
    assert (many[0].value != many[1].value).any()


def test_a_profile_is_kept_in_a_file_that_netcdf_clients_open(tmp_path):
    path = tmp_path / "p.h5"
    device = gonio.Instrument(photons=1e6, illuminated_radius=0.5, viewed_radius=0.2)
    profile = measure_profile(MATERIAL, device, OFFSETS, output=path, seed=3)
    read = open_profile(path)
    for name in ("offsets", "value", "u", "flag"):
        assert (getattr(read, name) == getattr(profile, name)).all()
    assert (read.illuminated_radius, read.viewed_radius, read.channels) == (0.5, 0.2, profile.channels)
    assert read.provenance == profile.provenance and holds_profile(path) and not holds_profile(tmp_path)
    with xarray.open_dataset(path, engine="h5netcdf") as dataset:
        assert dataset["R"].dims == ("offset", "channel") and dataset["offset"].attrs["units"] == "mm"
    with pytest.raises(GonioError, match="profile of light below a surface, and no table"):
        gonio.open(path)
    with pytest.raises(GonioError, match="exists already"):
        measure_profile(MATERIAL, device, OFFSETS, output=path)


def test_a_profile_goes_through_csv(tmp_path):
    profile = measure_profile(MATERIAL, gonio.Instrument(illuminated_radius=0.5, viewed_radius=0.2), OFFSETS)
    measured = dataclasses.replace(profile, channels=Channels.of_wavelengths([450, 600.5]))
    path = write_profile(tmp_path / "p.csv", measured)
    read = profile_of(path)
    assert read.channels == measured.channels and read.viewed_radius == 0.2
    for name in ("offsets", "value", "u", "flag"):
        assert (getattr(read, name) == getattr(measured, name)).all()
    path.write_text("offset_mm,R\n1,0.5\n2,\n")
    assert profile_of(path).valid.tolist() == [[True], [False]]
    for text, why in (("1,x", "line 2"), ("1,2,3", "3 cells"), ("", "0 offsets")):
        path.write_text(f"offset_mm,R\n{text}\n")
        with pytest.raises(GonioError, match=why):
            profile_of(path)


@pytest.mark.parametrize("header", ["offset_cm,R", "offset_mm;R", "Offset [mm],R", "offset,R"])
def test_a_profile_in_another_hand_is_told_what_a_profile_is(tmp_path, header):
    """By its offsets, and not as a table of directions that lacks its angles."""
    path = tmp_path / "p.csv"
    path.write_text(f"# my own\n{header}\n1,0.5\n2,0.2\n")
    with pytest.raises(GonioError, match="offset_mm,R,u_R"):
        profile_of(path)


def test_wavelengths_of_a_profile_may_be_micrometres(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("\ufeffoffset_mm,R_450 nm,R_0.55um\n1,0.5,0.4\n")
    assert profile_of(path).channels == Channels.of_wavelengths([450, 550])


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda f: f.attrs.pop("viewed_radius_mm"), "radii"),
        (lambda f: f.attrs.__setitem__("viewed_radius_mm", -1.0), "viewed radius is -1"),
        (lambda f: f.__delitem__("u_R"), "u_R is missing"),
        (lambda f: f["offset"].attrs.__setitem__("units", "m"), "units"),
        (lambda f: f["R"].__setitem__((0, 0), np.nan), "no numbers"),
        (lambda f: f.attrs.__setitem__("layout", "isotropic"), "no profile"),
    ],
)
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path, damage, why):
    path = tmp_path / "p.h5"
    measure_profile(MATERIAL, offsets=OFFSETS, output=path)
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(GonioError, match=why):
        open_profile(path)


def test_what_cannot_be_read_is_refused():
    for offsets, device, why in (
        ([0.0], gonio.Instrument(), "between points"),
        ([1.0], gonio.Instrument(photons=1e6), "lit spot"),
        ([np.nan], gonio.Instrument(), "no number"),
        ([], gonio.Instrument(), "0 offsets"),
    ):
        with pytest.raises(GonioError, match=why):
            measure_profile(MATERIAL, device, offsets)
    with pytest.raises(GonioError, match="nothing says how far"):
        measure_profile("grey_card")
    assert parsed_offsets("-1:1:3") == [-1, 0, 1] and parsed_offsets("0,2.5") == [0, 2.5]
    with pytest.raises(GonioError, match="give mm"):
        parsed_offsets("near")
