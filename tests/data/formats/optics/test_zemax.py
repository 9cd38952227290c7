"""Zemax files: directions by turning vectors, values as they stand, lists in any order, and what is refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gonio.data.flags import Flag
from gonio.data.formats.registry import read, sniff
from gonio.models.errors import GonioError
from support.optics_files import zemax

ROTATION, INCIDENCE, RADIAL = [0.0, 90.0], [0.0, 20.0, 70.0], [0.0, 5.0, 40.0]
RADIAL_BY_AZIMUTH = 9
HALF, WHOLE = [0.0, 60.0, 180.0], [0.0, 60.0, 200.0]


def numbers(*shape, seed=0):
    return np.random.default_rng(seed).uniform(0.1, 1, shape).round(4)


def written(folder, text, encoding="utf-8"):
    path = folder / "t.bsdf"
    path.write_bytes(text.encode(encoding) if isinstance(text, str) else text)
    return path


def direction(incidence, radial, azimuth):
    """The detector's, by turning the mirror direction to the normal and then counter-clockwise about itself."""
    mirror = np.array([-np.sin(np.radians(incidence)), 0.0, np.cos(np.radians(incidence))])
    tilted = Rotation.from_rotvec([0, radial, 0], degrees=True).apply(mirror)
    return Rotation.from_rotvec(azimuth * mirror, degrees=True).apply(tilted)


@pytest.mark.parametrize("kind", ["BRDF", "BTDF"])
@pytest.mark.parametrize(("rotation", "azimuth"), [([0.0], HALF), ([0.0], WHOLE), (ROTATION, WHOLE)])
def test_every_value_stands_in_its_direction(tmp_path, kind, rotation, azimuth):
    values = numbers(1, len(rotation), 3, 3, 3)
    table = read(written(tmp_path, zemax(rotation, INCIDENCE, azimuth, RADIAL, values, ScatterType=kind)))
    block = table.read()
    wi, wo = np.transpose(block.wi), np.transpose(block.wo)
    for r, i, a, m in np.ndindex(values.shape[1:]):
        # The light comes from +x where the sample was not turned
        back = Rotation.from_rotvec([0, 0, -rotation[r]], degrees=True)
        light = back.apply([np.sin(np.radians(INCIDENCE[i])), 0, np.cos(np.radians(INCIDENCE[i]))])
        detector = direction(INCIDENCE[i], RADIAL[m], azimuth[a])
        above = detector[2] > 1e-9
        detector = back.apply(detector * [1, 1, 1 if kind == "BRDF" else -1])
        here = (np.abs(wi - light).max(1) < 1e-9) & (np.abs(wo - detector).max(1) < 1e-9)
        assert here.any()
        expected = Flag.VALID if above else Flag.BELOW_HORIZON
        assert (block.flag[here] == expected).all()
        if INCIDENCE[i] > 0 and RADIAL[m] > 0 and above:
            np.testing.assert_array_equal(block.f[here, 0], values[0, r, i, a, m])
    assert table.sides == {(1, 1 if kind == "BRDF" else -1)}
    assert table.layout.mirrored_axes == (("phi_m",) if azimuth == HALF else ())


@pytest.mark.parametrize("rotation", [[0.0], ROTATION])
def test_each_incidence_may_be_scaled_to_its_total(tmp_path, rotation):
    """A white surface of 0.2 / π whose file says a total of 0.25, and one whose values are all three times as large."""
    radial, azimuth = np.arange(0, 91, 2.0), np.arange(0, 360, 15.0)
    values = np.full((1, len(rotation), 1, azimuth.size, radial.size), 0.2 / np.pi)
    white = written(tmp_path, zemax(rotation, [0.0], azimuth, radial, values))
    np.testing.assert_allclose(np.nanmax(read(white).f), 0.2 / np.pi)
    np.testing.assert_allclose(np.nanmax(read(white, scale="tis").f) * np.pi, 0.25, rtol=2e-3)
    values = numbers(3, len(rotation), 3, 3, 3)
    texts = [zemax(rotation, INCIDENCE, WHOLE, RADIAL, k * values) for k in (1, 3)]
    once, thrice = (read(written(tmp_path, text), scale="tis") for text in texts)
    np.testing.assert_allclose(once.f, thrice.f, rtol=1e-12)
    ratio = once.f / read(written(tmp_path, texts[0])).f
    for of_incidence in ratio:  # one factor for each incidence, rotation and channel
        factors = of_incidence.reshape(RADIAL_BY_AZIMUTH, -1)
        np.testing.assert_allclose(np.nanmin(factors, axis=0), np.nanmax(factors, axis=0), rtol=1e-12)
    with pytest.raises(GonioError, match="does not state a TIS"):
        read(written(tmp_path, zemax(rotation, INCIDENCE, WHOLE, RADIAL, values, TIS="nan")), scale="tis")
    with pytest.raises(GonioError, match="or --scale tis"):
        read(white, scale=2.0)


def test_the_order_and_the_sign_of_angles_do_not_matter(tmp_path):
    values = numbers(1, 2, 3, 2, 3)
    values[..., 0] = 0.5
    azimuth = np.array([30.0, 210.0])
    plain = read(written(tmp_path, zemax(ROTATION, INCIDENCE, azimuth, RADIAL, values)))
    others = {
        "descending": zemax(
            ROTATION[::-1], INCIDENCE[::-1], azimuth[::-1], RADIAL[::-1], np.flip(values, (1, 2, 3, 4))
        ),
        "whole turns": zemax([360.0, 90.0, 0.0], INCIDENCE, [390.0, -150.0], RADIAL, values[:, [0, 1, 0]]),
        "twice": zemax(ROTATION, INCIDENCE, [30.0, 210.0, 390.0], RADIAL, values[..., [0, 1, 0], :]),
        "signed": zemax(
            ROTATION, INCIDENCE, [30.0], [-40.0, -5.0, 0.0, 5.0, 40.0],
            np.concatenate([values[..., 1:, :0:-1], values[..., :1, :]], axis=-1),
        ),
    }  # fmt: skip
    for name, text in others.items():
        table = read(written(tmp_path, text))
        assert table.layout == plain.layout, name
        np.testing.assert_array_equal(table.f, plain.f, err_msg=name)
        np.testing.assert_array_equal(table.flag, plain.flag, err_msg=name)


def test_repeated_directions_that_disagree_are_averaged_aloud(tmp_path):
    values = numbers(1, 1, 3, 3, 3)
    table = read(written(tmp_path, zemax([0.0], INCIDENCE, [0.0, 120.0, 360.0], RADIAL, values)))
    np.testing.assert_allclose(table.f[0, :, 0, 0], values[0, 0, 0, [0, 2]].mean(axis=0))
    assert any("have other values, whose mean is taken" in line for line in table.provenance["understood"])


def test_channels_comments_and_encodings(tmp_path):
    values = numbers(3, 1, 1, 3, 3)
    text = zemax([0.0], [10.0], HALF, RADIAL, values)
    table = read(written(tmp_path, text))
    assert table.channels.names == ("X", "Y", "Z") and table.provenance["comments"] == ["a comment"]
    np.testing.assert_array_equal(table.f[0, ..., 1], values[1, 0, 0].T)
    for encoding, changed in (("utf-16", text), ("utf-8-sig", text), ("utf-8", text.replace("\n", "\r\n"))):
        path = written(tmp_path, changed, encoding)
        assert sniff(path).name == "Zemax"
        np.testing.assert_array_equal(read(path).f, table.f)
    comments = ["# Wavelength (nm) = 632.8"]
    single = read(written(tmp_path, zemax([0.0], [10.0], HALF, RADIAL, values[:1], comments=comments)))
    assert single.channels.wavelengths_nm == (632.8,)


def test_totals_are_told_beside_our_integral(tmp_path):
    radial = np.arange(0.0, 91.0, 2.5)
    values = np.full((1, 1, 1, 3, radial.size), 1 / np.pi)
    table = read(written(tmp_path, zemax([0.0], [0.0], HALF, radial, values, TIS=0.9)))
    assert table.provenance["totals"] == ["TIS at θi 0°: 0.9, the integral of the values 1"]
    assert table.provenance["one_reading_for_all_azimuths"]


def test_values_that_are_none_and_incidences_that_are_dark(tmp_path):
    values = numbers(1, 1, 3, 3, 3)
    values[0, 0, 1, 1, 1] = np.nan
    values[0, 0, 2] = 0.0
    table = read(written(tmp_path, zemax([0.0], INCIDENCE, HALF, RADIAL, values)))
    assert table.flag[1, 1, 1, 0] == Flag.INVALID and (table.flag == Flag.INVALID).sum() == 1
    assert (table.f[2][table.flag[2] == Flag.VALID] == 0).all()
    assert "all values are 0 with the light at θi 70°" in table.provenance["warnings"][0]


GOOD = zemax([0.0], [10.0], HALF, RADIAL, numbers(1, 1, 1, 3, 3))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "AngleOfIncidence 1\n10.0",
            "AngleOfIncidence 1\n10,5",
            "has decimal commas; write the file with decimal points",
        ),
        ("SampleRotation 1", "SampleRotation 999999999", "'999999999'; expected a whole number from 1 to 20,000"),
        ("SampleRotation 1", "SampleRotation 20000", "numbers by the counts, which the file does not hold"),
        ("ScatterRadial 3", "ScatterRadial 2", "ScatterRadial has 3 numbers, expected 2"),
        ("ScatterRadial 3", "ScatterRadial 4", "stands where ScatterRadial is expected"),
        ("AngleOfIncidence 1\n10.0", "AngleOfIncidence 1\n95", "AngleOfIncidence has the angle 95; expected degrees"),
        ("AngleOfIncidence 1\n10.0", "AngleOfIncidence 1\nnan", "AngleOfIncidence has the angle nan"),
        ("ScatterType\tBRDF", "ScatterType\tBSDF", "ScatterType is 'BSDF'; did you mean"),
        ("ScatterType\tBRDF\n", "", "does not say ScatterType BRDF or BTDF"),
        ("DataEnd", "0.1 0.2 0.3\nDataEnd", "it has more values than its lists of angles make"),
        ("DataEnd\n", "", "expected DataEnd"),
        ("TIS 0.25", "TIS", "TIS is ''; expected one number"),
        ("Source\tMeasured", "Saurce\tMeasured", "'saurce' is no word of a Zemax BSDF file"),
        ("Monochrome\nDataBegin", "TristimulusX\nDataBegin", "stands where the values of grey are expected"),
        ("SpectralContent\tMonochrome", "SpectralContent\tXYZ", "stands where the values of X, Y, Z are expected"),
    ],
)
def test_what_is_damaged_is_refused_in_one_sentence(tmp_path, old, new, said):
    assert old in GOOD
    with pytest.raises(GonioError) as error:
        read(written(tmp_path, GOOD.replace(old, new, 1)))
    assert said in str(error.value) and "\n" not in str(error.value)


def test_a_file_that_is_cut_is_refused_wherever_it_is_cut(tmp_path):
    for stop in range(GOOD.index("SampleRotation") + 30, len(GOOD) - 9, 7):
        with pytest.raises(GonioError):
            read(written(tmp_path, GOOD[:stop]))
