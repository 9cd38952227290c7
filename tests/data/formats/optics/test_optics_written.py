"""Files written for optics programs are read again: the same directions, values, flags and channels; models as well."""

import re

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.formats.registry import read, write
from gonio.data.interpolation.scattering_blocks import BLOCKS
from gonio.data.interpolation.sheets import sheet_of
from gonio.data.material import Material, material_of
from gonio.data.subject import resolve_subject
from gonio.data.table import whole_table_of_values
from gonio.models.diffuse.lambert import Lambert
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from support import radiance
from support.window_xml import QUARTER, document, numbers, scattering

QUICK = settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))


@st.composite
def degrees(draw, low, high, size):
    """Increasing angles with a few decimals, radians."""
    scale = draw(st.sampled_from([1, 10, 1000]))
    whole = st.integers(int(low * scale), int(high * scale) - 1)
    return np.radians(sorted(draw(st.lists(whole, min_size=size, max_size=size, unique=True)))) / scale


def wavelengths(draw, count):
    return draw(st.lists(st.integers(300, 900), min_size=count, max_size=count, unique=True).map(sorted))


def table_of(draw, layout, channels):
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    return whole_table_of_values(layout, rng.lognormal(0, 2, (*layout.shape, len(channels))), channels, name="sample")


def assert_same_cells(again, table, rtol):
    assert again.layout.name == table.layout.name and again.channels.wavelengths_nm == table.channels.wavelengths_nm
    for name, axis in table.layout.axes.items():
        np.testing.assert_allclose(again.layout.axes[name], axis, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(again.flag, table.flag)
    np.testing.assert_allclose(again.f, table.f, rtol=rtol)


@QUICK
@given(data=st.data())
def test_zemax_keeps_every_value_of_a_grid_about_the_mirror_direction(tmp_path, data):
    draw, make = data.draw, data.draw(st.sampled_from([layouts.mirror, layouts.straight]))
    turn = np.sort(draw(degrees(0, 360, 2))) if draw(st.booleans()) else None
    layout = make(draw(degrees(0, 90, 2)), draw(degrees(0, 180, 3)), draw(degrees(0, 360, 3)), turn)
    channels = draw(st.sampled_from([Channels.grey(), Channels(("X", "Y", "Z")), Channels.of_wavelengths([632.8])]))
    table = table_of(draw, layout, channels)
    assume((table.flag == Flag.VALID).any())
    trip = write(tmp_path / "t.bsdf", table, force=True, to="zemax")
    assert_same_cells(read(tmp_path / "t.bsdf"), table, 0)
    assert trip.max_absolute == 0 and trip.lost == 0 and trip.compared == table.counts()["valid"]


@QUICK
@given(data=st.data())
def test_speos_keeps_every_value_of_a_grid_about_the_normal(tmp_path, data):
    draw, theta_i, turned = data.draw, data.draw(degrees(0, 90, 2)), data.draw(st.booleans())
    polar = [draw(degrees(0, 89, 2)), np.radians([90.0]), np.pi - draw(degrees(0, 89, 2))[::-1]]
    kinds = {"reflection": polar[:2], "transmission": polar[1:], "both": polar}
    theta_o = np.concatenate(kinds[draw(st.sampled_from(sorted(kinds)))])
    delta = np.append(draw(degrees(0, 180, 2)), np.radians(270.0))
    layout = layouts.isotropic(theta_i, theta_o, delta)
    suffix = ".anisotropicbsdf" if turned else draw(st.sampled_from([".anisotropicbsdf", ".brdf"]))
    if turned:
        layout = layouts.turned(theta_i, np.radians([0.0, 30.0, 200.0]), theta_o, delta)
    count = draw(st.integers(1, 3))
    channels = Channels.of_wavelengths(wavelengths(draw, count)) if count > 1 or suffix == ".brdf" else Channels.grey()
    table = table_of(draw, layout, channels)
    if suffix != ".brdf":  # one distribution for all wavelengths
        table.f = table.f[..., :1] * np.arange(1, count + 1)
    trip = write(tmp_path / f"t{suffix}", table, force=True)
    assert_same_cells(read(tmp_path / f"t{suffix}"), table, 1e-12)
    assert trip.max_relative < 1e-12 and trip.lost == 0


def test_klems_keeps_the_matrices_of_a_file_and_says_what_is_lacking(tmp_path):
    blocks = {name: numbers(scattering(k, 0.3)) for k, name in enumerate(BLOCKS[:3])}
    (tmp_path / "a.xml").write_text(document(blocks))
    trip = write(tmp_path / "b.xml", read(tmp_path / "a.xml"), basis="quarter")
    first, second = (sheet_of(read(tmp_path / f"{name}.xml")) for name in "ab")
    for name in BLOCKS[:3]:
        np.testing.assert_array_equal(first.blocks[name][0].values, second.blocks[name][0].values)
    assert second.blocks["reflection back"] == (None,)
    assert trip.max_absolute == 0 and "not known, left out: reflection back" in trip.note


@pytest.mark.parametrize("bands", [("Visible", "Solar"), ("Solar", "Visible", "NIR"), ("Solar",)])
def test_klems_keeps_the_bands_of_a_file(tmp_path, bands):
    """Each under its own name; one that is chosen too."""
    texts = [document({BLOCKS[0]: numbers(scattering(k, 0.3))}, wavelength=band) for k, band in enumerate(bands)]
    data = [text[text.index("<WavelengthData>") : text.index("</Layer>")] for text in texts]
    (tmp_path / "a.xml").write_text(texts[0].replace("</Layer>", "".join(data[1:]) + "</Layer>"))
    first = read(tmp_path / "a.xml")
    trip = write(tmp_path / "b.xml", first, basis="quarter")
    write(tmp_path / "c.xml", first, basis="quarter", channel=bands[-1])
    second, last = read(tmp_path / "b.xml"), read(tmp_path / "c.xml")
    assert second.channels.names == first.channels.names == bands and last.channels.names == bands[-1:]
    assert trip.max_absolute == 0 and ("Radiance reads 'Visible' alone" in trip.note) == (bands[0] != "Visible")
    np.testing.assert_array_equal(second.f, first.f)
    np.testing.assert_array_equal(np.ravel(last.f), np.ravel(np.asarray(first.f)[:, -1]))


@QUICK
@given(st.sets(st.sampled_from(BLOCKS), min_size=1), st.sampled_from(["Columns", "Rows"]), st.integers(0, 2**32))
def test_klems_keeps_whichever_blocks_there_are(tmp_path, names, structure, seed):
    blocks = {name: scattering(seed + k, 0.1 + 0.2 * k) for k, name in enumerate(sorted(names))}
    order = {"Columns": lambda m: m, "Rows": np.transpose}[structure]
    (tmp_path / "a.xml").write_text(document({n.title(): numbers(order(m)) for n, m in blocks.items()}, structure))
    first = read(tmp_path / "a.xml")
    trip = write(tmp_path / "b.xml", first, force=True, basis="quarter")
    second = read(tmp_path / "b.xml")
    for name in BLOCKS:
        expected = blocks.get(name)
        for table in (first, second):
            block = sheet_of(table).blocks[name][0]
            assert (block is None) == (expected is None)
            if expected is not None:
                np.testing.assert_array_equal(block.values, expected)
    assert second.sides == first.sides and trip.max_absolute == 0 and trip.lost == 0


GREY = material_of(build("0.25 * lambert(rho=0.8) + 0.5 * lambert_transmission(tau=0.6)"))
"""f is 0.2/π on the side of the light and 0.3/π on the other, everywhere."""


@pytest.mark.parametrize(
    ("name", "options"),
    [("t.bsdf", {"to": "zemax", "part": "transmission", "step": 30}), ("s.anisotropicbsdf", {"step": 30})],
)
def test_a_model_of_two_sides_is_sampled(tmp_path, name, options):
    write(tmp_path / name, GREY, **options)
    for (light, detector), part in read(tmp_path / name).parts().items():
        f = part.f[part.flag == Flag.VALID]
        np.testing.assert_allclose(f * np.pi, 0.2 if light == detector else 0.3, rtol=1e-9)


def test_radiance_reads_the_klems_file_of_a_model_as_it_was_meant(tmp_path):
    trip = write(tmp_path / "k.xml", GREY, basis="quarter")
    assert "R + T up to 0.5" in trip.note and "left out: reflection back" in trip.note
    sheet = sheet_of(read(tmp_path / "k.xml"))
    for name in BLOCKS[:3]:
        f = sheet.blocks[name][0].values
        np.testing.assert_allclose(f * np.pi, 0.2 if "reflection" in name else 0.3, rtol=1e-9)
    if not radiance.installed():
        pytest.skip("Radiance's own reader is not installed")
    theirs = radiance.ask(tmp_path / "k.xml", [(160.0, 30.0, "reflection"), (20.0, 30.0, "transmission")])
    np.testing.assert_allclose(theirs.shares, [0.2, 0.3], rtol=4e-4)  # the mark that it leaves on values


def test_the_narrower_a_lobe_the_nearer_the_incidences_of_a_speos_file(tmp_path):
    steps = []
    for alpha in (0.4, 0.1, 0.05):
        write(tmp_path / "t.brdf", material_of(build(f"1 * ggx(alpha={alpha}, f0=1)")), force=True, step=30)
        steps.append(np.degrees(np.diff(read(tmp_path / "t.brdf").layout.axes["theta_i"])[0]))
    np.testing.assert_allclose(steps, [5, 2.5, 1.25])


def test_a_speos_file_that_would_be_too_large_is_refused_before_it_is_computed(tmp_path):
    with pytest.raises(GonioError, match=r"--step above 0\.5"):
        write(tmp_path / "x.anisotropicbsdf", material_of(build("ggx(alpha_x=0.05, alpha_y=0.3)")), step=0.5)


@pytest.mark.parametrize("channels", [Channels.rgb(), Channels.of_wavelengths([700.0, 550.0, 450.0])])
@pytest.mark.parametrize("alike", [False, True])
def test_the_error_of_a_file_is_that_of_each_channel_wherever_it_stands(tmp_path, channels, alike):
    """Wavelengths ascend in the file; channels that are alike are one there."""
    nodes = np.radians(np.arange(0, 81, 20))
    layout = layouts.isotropic(nodes, nodes, np.radians(np.arange(0, 360, 45)))
    f = np.broadcast_to(0.1 if alike else np.array([0.3, 0.2, 0.05]), (*layout.shape, 3))
    table = whole_table_of_values(layout, f.copy(), channels, name="t")
    for name in ("x.brdf", "x.anisotropicbsdf"):
        assert write(tmp_path / name, table).rms_relative < 1e-12


def test_channels_of_a_model_that_are_alike_are_one_in_a_speos_file(tmp_path):
    material = resolve_subject("lambert(rho=[0.3, 0.3, 0.3])").material
    assert material is not None
    assert write(tmp_path / "x.anisotropicbsdf", material, step=15.0).max_relative < 1e-12


def test_an_rgl_file_of_descending_wavelengths_is_compared_channel_by_channel(tmp_path):
    spectrum = Channels.of_wavelengths([700.0, 550.0, 450.0])
    material = Material("m", build("lambert(rho=[0.9, 0.6, 0.2])"), "", spectrum)
    assert write(tmp_path / "x.bsdf", material, channel_bytes=1024).rms_relative < 0.1


def test_channels_of_their_own_shapes_are_no_one_distribution(tmp_path):
    """A grid whose channels differ by shape is off by what is said; of one shape it is not, and nothing is said."""
    layout = layouts.isotropic(np.radians([0.0, 40]), np.radians([0.0, 30, 60, 90]), np.radians([0.0, 90, 180, 270]))
    rng, names = np.random.default_rng(0), Channels.of_wavelengths([450.0, 650.0])
    for f, said in (
        (rng.uniform(0.1, 1, (*layout.shape, 2)), True),
        (rng.uniform(0.1, 1, (*layout.shape, 1)) * [1, 2], False),
    ):
        trip = write(tmp_path / "t.anisotropicbsdf", whole_table_of_values(layout, f, names), force=True)
        assert ("one angular distribution" in trip.note and "a .brdf file has one for each" in trip.note) == said
        assert (trip.rms_relative > 0.1) == said
        if said:  # the rms of the file as it is read
            again = read(tmp_path / "t.anisotropicbsdf")
            there = again.flag == Flag.VALID
            off = np.linalg.norm((again.f - f)[there]) / np.linalg.norm(f[there])
            assert float(re.search(r"rms ([\d.]+)", trip.note)[1]) == pytest.approx(off, rel=0.02)
        assert write(tmp_path / "t.brdf", whole_table_of_values(layout, f, names), force=True).rms_relative < 1e-12


def test_the_matrix_of_a_lobe_holds_its_light_and_is_reciprocal(tmp_path):
    write(tmp_path / "k.xml", material_of(build("1 * ggx(alpha=0.3, f0=1)")), basis="quarter")
    block = sheet_of(read(tmp_path / "k.xml")).blocks["reflection front"][0]
    share = block.share(block.incidences())
    material = material_of(build("1 * ggx(alpha=0.3, f0=1)"))
    theta = np.radians([0.0, 18.0, 36.0, 54.0])
    expected = material.albedo(theta, tolerance=1e-4).value[:, 0]
    ours = [share[k] for k in (0, 1, 9, 21)]
    np.testing.assert_allclose(ours, expected, atol=0.01)
    turned = QUARTER.patch(QUARTER.centres()[0], (QUARTER.centres()[1] + np.pi) % (2 * np.pi))
    np.testing.assert_allclose(np.asarray(block.values).T[turned][:, turned], block.values, rtol=1e-12)


@pytest.mark.parametrize("name", ["x.xml", "x.brdf", "x.ssdd", "x.bin", "x.binary", "x.bsdf"])
def test_a_few_readings_are_not_made_up_to_a_hemisphere(tmp_path, name):
    theta_i, theta_o, phi_o = np.random.default_rng(0).uniform(0, 1.0, (3, 12))
    listed = layouts.scattered(theta_i, 0 * theta_i, theta_o, phi_o)
    table = whole_table_of_values(listed, np.ones((12, 3)), Channels(("R", "G", "B")), name="few")
    with pytest.raises(GonioError, match=r"readings (about|for)"):
        write(tmp_path / name, table)
    assert not list(tmp_path.iterdir())


def test_what_a_file_cannot_hold_is_refused(tmp_path):
    rgb = whole_table_of_values(layouts.isotropic([0.1], [0.1, 0.5], [0.0, 3.0]), np.ones((1, 2, 2, 3)), name="paint")
    wide = whole_table_of_values(layouts.in_plane([0.1], [-0.5, 0.5]), np.ones((1, 2, 1)), name="plane")
    turned = whole_table_of_values(
        layouts.turned([0.1], [0.0, 1.0], [0.1, 0.5], [0.0, 3.0, 5.0]), np.ones((1, 2, 2, 3))
    )
    bright = material_of(build("1 * lambert(rho=1) + 1 * lambert(rho=1)"))
    for name, source, options, said in (
        ("a.bsdf", rgb, {"to": "zemax"}, "a Zemax file holds one channel, or X, Y, Z"),
        ("a.bsdf", rgb, {"to": "zemax", "channel": "Q"}, "paint has no channel 'Q'"),
        ("a.bsdf", material_of(Lambert(0.5)), {"to": "zemax", "part": "transmission"}, "has no transmission of light"),
        ("a.bsdf", material_of(Lambert(0.5)), {"to": "zemax", "step": 90}, "a step of 90 degrees; give one from 0.25"),
        ("a.anisotropicbsdf", wide, {}, "has readings about"),
        ("a.brdf", turned, {}, "a .brdf file holds isotropic surfaces"),
        ("a.xml", material_of(Lambert(0.5)), {"basis": "third"}, "basis 'third' is unknown"),
        ("a.xml", bright, {"basis": "quarter"}, "and no Klems file may exceed 1"),
        ("a.xml", material_of(Lambert(0.5)), {"step": 3}, "has no option 'step'"),
    ):
        with pytest.raises(GonioError) as error:
            write(tmp_path / name, source, **options)
        assert said in str(error.value) and not (tmp_path / name).exists()
