"""RGL files: held against Mitsuba, against the files' own mask, against a file whose warp is known; damaged ones."""

import random
import struct

import numpy as np
import pytest

from gonio.data.flags import Flag
from gonio.data.formats.rgl_file import DTYPES, parse_tensors, read_rgl, read_rgl_data, read_tensors
from gonio.data.interpolation.multilinear import coarsened
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from support import helpers
from support.marks import thorough

CODES = {np.dtype(name): code for code, name in DTYPES.items()}
FILES = ("acrylic_felt_pink_rgb", "acrylic_felt_white_rgb", "cardboard_rgb", "cc_ibiza_sunset_rgb")


def tensor_bytes(fields: dict[str, np.ndarray]) -> bytes:
    size = 18 + sum(2 + len(name) + 11 + 8 * a.ndim for name, a in fields.items())
    head, body = b"tensor_file\0" + struct.pack("<BBI", 1, 0, len(fields)), b""
    for name, a in fields.items():
        offset = -(-(size + len(body)) // 8) * 8
        body += b"\0" * (offset - size - len(body)) + a.tobytes()
        head += struct.pack("<H", len(name)) + name.encode()
        head += struct.pack(f"<HBQ{a.ndim}Q", a.ndim, CODES[a.dtype], offset, *a.shape)
    return head + body


def material(phi_i=(0.0,), channels=3, seed=0) -> dict[str, np.ndarray]:
    """A file with an even warp: a sample lies where its half vector is."""
    rng = np.random.default_rng(seed)
    theta_i = np.array([0.0, 0.7, 1.4], np.float32)
    phi_i = np.array(phi_i, np.float32)
    spectra = rng.random((phi_i.size, 3, channels, 5, 5)).astype(np.float32)
    fields = {
        "description": np.frombuffer(b"made up", np.uint8),
        "theta_i": theta_i,
        "phi_i": phi_i,
        "ndf": np.full((2, 4), 3.0, np.float32),
        "sigma": np.full((2, 4), 0.5, np.float32),
        "vndf": np.ones((phi_i.size, 3, 6, 6), np.float32),
        "jacobian": np.ones(1, np.uint8),
    }
    if channels == 3:
        return {**fields, "rgb": spectra}
    return {**fields, "spectra": spectra, "wavelengths": np.linspace(400, 700, channels).astype(np.float32)}


def written(path, fields):
    path.write_bytes(tensor_bytes(fields))
    return path


def random_directions(n, seed=1):
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(0.15, 0.99, n), rng.uniform(0, 2 * np.pi, n)
    s = np.sqrt(1 - z**2)
    return Direction(s * np.cos(phi), s * np.sin(phi), z)


@pytest.mark.parametrize("name", FILES)
def test_values_are_mitsubas(name):
    path = helpers.shared("data", "rgl", f"{name}.bsdf")
    with np.load(helpers.shared("oracle", "mitsuba.npz")) as oracle:
        wi, wo, f_cos = (oracle[f"measured_{name}/{part}"].astype(float) for part in ("wi", "wo", "f_cos"))
    mine = np.asarray(evaluate(read_rgl(path).interpolant(), Direction(*wi.T), Direction(*wo.T)))
    mine = mine * np.maximum(wo[:, 2:], 0.0)
    assert np.all(mine[f_cos == 0] == 0)
    # Darker than this, all by grazing light, single precision itself errs by more: the same code in float32 does too.
    bright = np.abs(f_cos) > 1e-3 * f_cos.max()
    assert bright.sum() > 900
    np.testing.assert_allclose(mine[bright], f_cos[bright], rtol=1e-4)
    np.testing.assert_allclose(mine, f_cos, rtol=1e-4, atol=1e-7 * f_cos.max() + 1e-6)


@pytest.mark.parametrize("name", FILES)
def test_the_tables_samples_are_the_materials_values_and_the_files_mask(name):
    path = helpers.shared("data", "rgl", f"{name}.bsdf")
    table = read_rgl(path)
    block = table.read()
    theta, y, x = np.unravel_index(np.arange(table.layout.size), (8, 32, 32))
    above = block.flag[:, 0] == Flag.VALID
    mask = np.unpackbits(read_tensors(path)["valid"]).astype(bool)
    np.testing.assert_array_equal(above[theta < 7], mask[theta < 7])
    assert not above[theta == 7].any()
    # At the pole of the half vectors and on the seam of their azimuth several samples share a direction.
    single = above & (x > 0) & (y > 0) & (y < 31)
    values = np.asarray(evaluate(table.interpolant(), block.wi, block.wo))
    np.testing.assert_allclose(values[single], block.f[single], rtol=1e-8, atol=1e-10)
    assert table.counts()["negative"] == np.sum(block.f[above] < 0)
    assert (table.counts()["negative"] > 0) == (name == "cc_ibiza_sunset_rgb")


def test_a_mask_that_leaves_nothing_means_the_reverse(tmp_path):
    fields, tables = material(), []
    plain = read_rgl(written(tmp_path / "plain.bsdf", fields))
    above = (plain.read().flag[:, 0] == Flag.VALID).reshape(3, 5, 5)
    excluded = above & (np.arange(75).reshape(3, 5, 5) % 7 == 0)
    for valid in (above & ~excluded, above, ~above):
        mask = np.packbits(valid.ravel())
        tables.append(read_rgl(written(tmp_path / f"{len(tables)}.bsdf", fields | {"valid": mask})))
    some, every, reverse = (table.read().flag for table in tables)
    np.testing.assert_array_equal(some[:, 0] == Flag.NOT_MEASURED, excluded.ravel())
    np.testing.assert_array_equal(reverse, every)


def test_an_even_warp_gives_the_closed_form(tmp_path):
    fields = material(channels=7)
    fields["spectra"][:] = np.arange(1, 8, dtype=np.float32)[:, None, None]
    table = read_rgl(written(tmp_path / "m.bsdf", fields))
    wi, wo = random_directions(50), random_directions(50, 2)
    values = np.asarray(evaluate(table.interpolant(), wi, wo))
    expected = np.arange(1, 8) * 3.0 / (4 * 0.5) / wo.z[:, None]
    np.testing.assert_allclose(values, expected, rtol=1e-6)
    np.testing.assert_allclose(table.channels.wavelengths_nm, np.linspace(400, 700, 7), rtol=1e-6)
    block = table.samples()
    np.testing.assert_allclose(block.f * block.wo.z[:, None], np.arange(1, 8) * 1.5 + 0 * block.f, rtol=1e-6)


@pytest.mark.parametrize("coarse", [False, True])
def test_some_channels_are_read_by_the_files_own_rule(tmp_path, coarse):
    """In the order in which they are named, as among all of them."""
    table = read_rgl(written(tmp_path / "m.bsdf", material(channels=7)))
    wi, wo = random_directions(50), random_directions(50, 2)
    some = table.only([table.channels.names[k] for k in (5, 2)])
    made = [np.asarray(evaluate((coarsened(t) if coarse else t).interpolant(), wi, wo)) for t in (table, some)]
    np.testing.assert_array_equal(made[1], made[0][:, [5, 2]])


def test_without_jacobian_the_spectra_stand_alone(tmp_path):
    fields = material()
    fields["jacobian"][:] = 0
    fields["rgb"] = np.full_like(fields["rgb"], -0.25)
    table = read_rgl(written(tmp_path / "m.bsdf", fields))
    block = table.samples()
    np.testing.assert_allclose(block.f * block.wo.z[:, None], -0.25 + 0 * block.f, rtol=1e-12)
    assert table.counts()["negative"] == block.f.size


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [("sigma", 0.0, "sigma, by which f is divided, is 0"), ("rgb", 3e38, "numbers beyond"), ("ndf", -1.0, "negative")],
)
def test_maps_that_make_no_value_are_refused(tmp_path, name, value, said):
    fields = material()
    fields[name] = np.full_like(fields[name], value)
    with pytest.raises(GonioError, match=said):
        read_rgl(written(tmp_path / "m.bsdf", fields))


@pytest.mark.parametrize("span", [np.pi / 2, *thorough(2 * np.pi)])
def test_an_anisotropic_file_stands_for_all_its_sectors(tmp_path, span):
    table = read_rgl(written(tmp_path / "m.bsdf", material(np.linspace(-np.pi, -np.pi + span, 4))))
    wi, wo = random_directions(60), random_directions(60, 2)
    turned = [Direction(-w.x, -w.y, w.z) for w in (wi, wo)]
    mirrored = [Direction(w.x, -w.y, w.z) for w in (wi, wo)]
    block = table.samples()
    pairs = [(wi, wo), turned, mirrored, (block.wi, block.wo)]
    joined = [Direction(*(np.concatenate(c) for c in zip(*ws, strict=True))) for ws in zip(*pairs, strict=True)]
    values = np.asarray(evaluate(table.interpolant(), *joined))
    value, value_turned, value_mirrored, again = np.split(values, [60, 120, 180])
    assert np.allclose(value_turned, value) == (span < 6)
    assert np.allclose(value_mirrored, value) == (span < 3)
    # At normal incidence the light has no azimuth, and a sector's edges are mirrored onto each other.
    inner = (block.wi.z < 1) & (np.arctan2(block.wi.y, block.wi.x) > -np.pi + 0.1) & (block.wi.y < -1e-6)
    if span < 3:
        inner &= block.wi.x < -1e-6
    half = np.arctan2(block.wi.y + block.wo.y, block.wi.x + block.wo.x)
    inner &= (np.hypot(block.wi.x + block.wo.x, block.wi.y + block.wo.y) > 1e-6) & (np.abs(half) < np.pi - 1e-6)
    assert inner.sum() > 10
    np.testing.assert_allclose(again[inner], block.f[inner], rtol=1e-7)


def changed(name, value):
    def change(fields):
        if value is None:
            del fields[name]
        else:
            fields[name] = np.asarray(value)

    return change


BAD_FIELDS = {
    "'sigma' is missing": changed("sigma", None),
    "'ndf' has shape": changed("ndf", np.ones(4, np.float32)),
    "not finite": changed("sigma", np.full((2, 4), np.nan, np.float32)),
    "vndf has shape": changed("vndf", np.ones((1, 2, 6, 6), np.float32)),
    "not square": changed("rgb", np.ones((1, 3, 3, 5, 4), np.float32)),
    "fewer than two": changed("ndf", np.ones((1, 4), np.float32)),
    "do not increase": changed("theta_i", np.array([0.0, 0.7, 0.6], np.float32)),
    "no densities": changed("vndf", np.zeros((1, 3, 6, 6), np.float32)),
    "type uint8": changed("theta_i", np.zeros(3, np.uint8)),
}


@pytest.mark.parametrize("said", BAD_FIELDS)
def test_fields_that_do_not_fit_are_refused(tmp_path, said):
    fields = material()
    BAD_FIELDS[said](fields)
    with pytest.raises(GonioError, match=said):
        read_rgl_data(written(tmp_path / "m.bsdf", fields))


def one_field(name=b"theta_i", dimensions=1, code=10, offset=64, shape=(4,), count=1):
    head = b"tensor_file\0" + struct.pack("<BBI", 1, 0, count) + struct.pack("<H", len(name)) + name
    return head + struct.pack(f"<HBQ{len(shape)}Q", dimensions, code, offset, *shape) + bytes(64)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"tensor_fil", "ends inside its header"),
        (b"tensor_fool\0" + bytes(20), "does not start with"),
        (b"tensor_file\0\2\0" + bytes(9), "version 2.0, expected 1.0"),
        (one_field(offset=1 << 63), "outside its"),
        (one_field(offset=(1 << 64) - 8, shape=(2,)), "outside its"),
        (one_field(dimensions=2, shape=(1 << 32, 1 << 32)), "outside its"),
        (one_field(dimensions=2, shape=(1 << 63, 2)), "outside its"),
        (one_field(shape=(1 << 40,)), "outside its"),
        (one_field(dimensions=2, shape=(1 << 63, 0)), "outside its"),
        (one_field(dimensions=65535), "65535 dimensions"),
        (one_field(code=12), "of type 12"),
        (one_field(name=b"\xff\xfe"), "no text"),
        (one_field(count=(1 << 32) - 1), "damaged"),
        (one_field(name=b"a", count=2)[:-64] + one_field(name=b"a")[18:], "twice"),
    ],
)
def test_a_header_that_lies_is_refused_before_anything_is_allocated(data, said):
    with pytest.raises(GonioError, match=said):
        parse_tensors(data, "lie.bsdf")


def test_damaged_files_never_raise_anything_but_a_gonio_error(tmp_path):
    whole = tensor_bytes(material())
    rng = random.Random(0)
    for k in range(200):
        hurt = bytearray(whole[: rng.randrange(len(whole))] if k % 4 == 0 else whole)
        for _ in range(4):
            if len(hurt) > 400:
                hurt[rng.randrange(400)] = rng.randrange(256)
        (tmp_path / "hurt.bsdf").write_bytes(hurt or b"x")
        try:
            read_rgl(tmp_path / "hurt.bsdf")
        except GonioError as error:
            assert "\n" not in str(error)
