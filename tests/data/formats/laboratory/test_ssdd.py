"""SSDD: made here by the specification from a closed form, in every coordinate system, and what gonio writes."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.formats.registry import read, write
from gonio.data.subject import resolve_subject
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError
from support.closed_form import anisotropic, isotropic, largest_error, vector


def rotated(w, tilt, turn):
    """Vectors tilted from z towards x, then turned about z."""
    x, y, z = w
    x, z = x * np.cos(tilt) + z * np.sin(tilt), z * np.cos(tilt) - x * np.sin(tilt)
    return np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z])


def spherical(p0, p1, p2, p3):
    return vector(p0, p1), vector(p2, p3)


def specular(p0, p1, p2, p3, offset=0.0):
    return vector(p0, p1), rotated(vector(p2, p3), -(p0 + offset), p1)


def half_difference(p0, p1, p2, p3):
    half, wi = vector(p0, p1), rotated(vector(p2, p3), p0, p1)
    return wi, 2 * (wi * half).sum(0) * half - wi


def distorted(p0, p1, p2, p3):
    """Straight lines on the equidistant disc, from the mirror direction to the rim."""
    r, d = 2 * p2 / np.pi, 2 * p0 / np.pi
    u, v = (r * f(p3) + (1 - r) * d * f(p1 + np.pi) for f in (np.cos, np.sin))
    return vector(p0, p1), vector(np.hypot(u, v) * np.pi / 2, np.arctan2(v, u))


SYSTEMS = {
    "spherical": (spherical, ([0, 20, 50], [0, 15, 70], [0, 90, 180, 270, 360])),
    "specular": (specular, ([0, 20, 50], [0, 5, 30, 90], [0, 60, 120, 180, 240, 300, 360])),
    "half_difference": (half_difference, ([0, 20, 50], [0, 15, 30], [0, 90, 180, 270, 360])),
    "distorted_spherical": (distorted, ([0, 20, 50], [0, 15, 60], [0, 90, 180, 270, 360])),
}


def block(system, brdf, azimuths, mode="ascii", kind="brdf", extra=(), lists=None):
    """The bytes of a block: the first parameter changes fastest, then the second."""
    directions, (p0, p2, p3) = SYSTEMS[system]
    p3 = p3 if lists is None else lists
    axes = np.meshgrid(*(np.radians(p) for p in (p3, p2, azimuths, p0)), indexing="ij")
    wi, wo = directions(*(a.ravel() for a in axes[::-1]))
    values = brdf(wi, wo * [[1], [1], [-1]] if kind == "btdf" else wo)
    words = [f"DATA_TYPE {kind}", "COLOR_MODEL monochrome", f"PARAM_TYPE {system}_coordinate_system", *extra]
    words += [f"PARAM{k}_LIST {' '.join(map(str, p))}" for k, p in ((0, p0), (1, azimuths), (2, p2), (3, p3)) if any(p)]
    words += ["NAME a tile", f"DATA {mode}"]
    body = values.astype("<f4").tobytes() if mode == "binary" else "\n".join(map(repr, values.tolist())).encode()
    return "\n".join(words).encode() + b"\n" + body + b"\n"


def written(path, *blocks):
    path.write_bytes(b"# made here\nVERSION 0.3\nDATE 2026-01-01\n\n# a comment\n" + b"\n".join(blocks))
    return path


@pytest.mark.parametrize("mode", ["ascii", "binary"])
@pytest.mark.parametrize("azimuths", [[0], [0, 90, 180, 270, 360]])
@pytest.mark.parametrize("system", SYSTEMS)
def test_every_coordinate_system_text_or_binary(tmp_path, system, azimuths, mode):
    brdf = isotropic if azimuths == [0] else anisotropic
    table = read(written(tmp_path / "a.ssdd", block(system, brdf, azimuths, mode)))
    assert table.name == "a tile" and largest_error(table, brdf) < (1e-6 if mode == "binary" else 1e-9)
    assert table.layout.gridded == (system != "distorted_spherical")


@pytest.mark.parametrize(
    ("reductions", "lists"),
    [
        ("bilateral_symmetry", [0, 45, 90, 135, 180]),
        ("reciprocity", [0, 60, 120, 180]),
        ("bilateral_symmetry reciprocity", [0, 30, 60, 90]),
    ],
)
def test_reduced_difference_azimuths_stand_for_the_rest(tmp_path, reductions, lists):
    def symmetric(wi, wo):
        return 0.3 + 0.1 * (wi * wo).sum(0) + 0.05 * wi[2] * wo[2]

    made = block("half_difference", symmetric, [0], "ascii", extra=[f"REDUCTION_TYPE {reductions}"], lists=lists)
    table = read(written(tmp_path / "a.ssdd", made))
    whole = 180 if "reciprocity" in reductions else 360
    assert np.degrees(table.layout.axes["phi_d"][-1]) > whole - 61 and largest_error(table, symmetric) < 1e-9


@pytest.mark.parametrize("system", ["spherical", "specular"])
def test_brdf_and_btdf_are_both_sides_and_deltas_are_told(tmp_path, system):
    delta = b"DATA_TYPE specular_reflectance\nCOLOR_MODEL monochrome\nPARAM0_LIST 0 90\nDATA ascii\n0.04\n1\n"
    blocks = block(system, isotropic, [0], "binary"), block(system, isotropic, [0], "ascii", "btdf"), delta
    table = read(written(tmp_path / "a.ssdd", *blocks))
    assert table.sides == {(1, 1), (1, -1)} and largest_error(table, isotropic) < 1e-6
    assert table.layout.gridded == (system == "spherical")
    assert any("specular_reflectance" in sentence for sentence in table.provenance["understood"])


def test_offsets_from_the_specular_direction_are_followed(tmp_path, monkeypatch):
    def offset(p0, p1, p2, p3):
        return specular(p0, p1, p2, p3, np.radians(np.interp(p0, np.radians([0, 20, 50]), [0, -4.5, -12])))

    monkeypatch.setitem(SYSTEMS, "offset", (offset, SYSTEMS["specular"][1]))
    made = block("offset", isotropic, [0]).replace(b"offset_", b"specular_")
    made = made.replace(b"NAME", b"PARAM4_LIST 0 -4.5 -12\nNAME")
    assert largest_error(read(written(tmp_path / "a.ssdd", made)), isotropic) < 1e-9


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda b: b.replace(b"monochrome", b"rgb"), "1 columns, expected 3"),
        (lambda b: b.replace(b"PARAM0_LIST 0 20 50", b"PARAM0_LIST 0 50 20"), "not in ascending order"),
        (lambda b: b.replace(b"PARAM0_LIST 0 20 50", b"PARAM0_LIST 0 20 500"), "expected 0 to 90°"),
        (lambda b: b.replace(b"spherical", b"cubic"), "PARAM_TYPE is 'cubic_coordinate_system'"),
        (lambda b: b[:-60], "of 45 rows of values"),
        (lambda b: b.replace(b"DATA ascii", b"DATA text"), "neither ascii nor binary"),
        (lambda b: b + b, "expected one brdf or btdf"),
        (
            lambda b: b.replace(b"PARAM2_LIST 0 15 70", b"PARAM2_LIST " + b" ".join(b"%d" % k for k in range(10**4))),
            "bytes for",
        ),
    ],
)
def test_damaged_files_are_refused_in_a_sentence(tmp_path, change, expected):
    with pytest.raises(GonioError, match=expected):
        read(written(tmp_path / "bad.ssdd", change(block("spherical", isotropic, [0]))))


GRIDS = {
    "isotropic": lambda: layouts.isotropic([0.1, 0.7], [0.0, 0.4, 1.5], np.radians([0, 90, 180, 270])),
    "mirrored": lambda: layouts.isotropic([0.1, 0.7], [0.0, 0.4, 1.5], np.radians([0, 90, 180])),
    "both sides": lambda: layouts.isotropic([0.1, 0.7], [0.0, 0.4, 1.5, 1.8, 3.0], np.radians([0, 90, 180, 270])),
    "in_plane": lambda: layouts.in_plane([0.1, 0.7], [-1.0, -0.3, 0.0, 0.3, 1.2]),
    "spherical": lambda: layouts.spherical([0.1, 0.7], [0.0, 2.0], [0.3, 0.6], [0.0, 1.0, 3.0]),
    "half_difference": lambda: layouts.half_difference([0.0, 0.4], [0.0, 0.5], [0.0, 1.0, 2.0]),
    "turning": lambda: layouts.half_difference([0.0, 0.4], [0.0, 0.5], [0.0, 1.0, 4.0], [0.0, 1.0]),
    "mirror": lambda: layouts.mirror([0.1, 0.7], [0.0, 0.4, 1.0], np.radians([0, 90, 180])),
    "straight": lambda: layouts.straight([0.1, 0.7], [0.0, 0.4, 1.0], np.radians([0, 90, 180, 270]), [0.0, 2.0]),
}


@settings(max_examples=40, deadline=None)
@given(name=st.sampled_from(sorted(GRIDS)), seed=st.integers(0, 2**32), ascii=st.booleans(), gaps=st.booleans())
def test_written_and_read_again_it_is_the_same(tmp_path_factory, name, seed, ascii, gaps):
    rng, path, layout = np.random.default_rng(seed), tmp_path_factory.mktemp("ssdd") / "t.ssdd", GRIDS[name]()
    channels = Channels.of_wavelengths([450, 550.5]) if seed % 2 else Channels.rgb()
    values = rng.normal(size=(*layout.shape, len(channels)))
    table = whole_table_of_values(layout, values if ascii else values.astype(np.float32), channels, name="any")
    if gaps and name not in ("half_difference", "turning"):
        flag = table.flag.copy()
        row = flag.reshape(-1, len(channels))[1]
        row[row == Flag.VALID] = Flag.SHADOWED
        table = dataclasses.replace(table, flag=flag, f=np.where(flag == Flag.VALID, table.f, np.nan))
    report = write(path, table, ascii=ascii)
    again = read(path)
    assert (report.max_absolute, report.lost) == (0, 0) and report.compared == table.counts()["valid"]
    assert again.channels == table.channels
    if name != "in_plane":
        assert again.layout.name == table.layout.name and again.layout.shape == table.layout.shape
        assert np.array_equal(again.flag, table.flag)


@pytest.mark.parametrize(("phi_i", "exact"), [([0, 90, 270], True), ([10, 100], True), (range(0, 360, 40), False)])
def test_azimuths_from_the_lights_become_those_of_the_sample(tmp_path, phi_i, exact):
    """Number by number where turning the light moves the grid onto itself; else resampled, as is said."""
    layout = layouts.turned([0.1, 1.4], np.radians(phi_i), [0.1, 0.6, 1.5], np.radians([0, 90, 180, 270]))
    values = np.random.default_rng(0).random((*layout.shape, 3)) + 0.1
    table = whole_table_of_values(layout, values, name="brushed")
    report, again = write(tmp_path / "t.ssdd", table, ascii=True), read(tmp_path / "t.ssdd")
    assert ("mirror direction" in report.note) != exact
    if exact:
        rows = []
        for t in (table, again):
            angles = np.round(np.degrees(t.layout.angles()), 6) % 360
            order = np.lexsort(angles)
            rows.append((angles[:, order], t.read_values()["f"][order]))
        np.testing.assert_allclose(rows[0][0], rows[1][0], atol=1e-6)
        np.testing.assert_array_equal(rows[0][1], rows[1][1])
        assert (report.max_absolute, report.lost) == (0, 0)


def test_a_model_is_written_about_the_mirror_direction_with_its_error(tmp_path):
    models = "lambert(rho=0.3) + 0.2 * phong(n=20)", "thin_sheet(rho=0.5, tau=0.5)"
    plastic, sheet = (resolve_subject(model).material for model in models)
    assert plastic is not None and sheet is not None
    report = write(tmp_path / "m.ssdd", plastic)
    assert report.rms_relative < 0.02 and "mirror direction" in report.note and report.lost == 0
    with pytest.raises(GonioError, match="transmits"):
        write(tmp_path / "s.ssdd", sheet)
