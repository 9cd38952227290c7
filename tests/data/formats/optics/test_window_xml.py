"""XML files of windows: matrices and trees, read as written, by their own rule, and refused where they are damaged."""

import itertools
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.data import read
from gonio.data.interpolation.angle_basis import EARLIER_BASES, KLEMS_BASES
from gonio.data.interpolation.scattering_blocks import BLOCKS
from gonio.data.interpolation.tree_text import parse_tree
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from support import radiance
from support.window_xml import QUARTER, document, numbers, scattering

NEEDS_RADIANCE = pytest.mark.skipif(not radiance.installed(), reason="Radiance's own reader is not installed")


def written(tmp_path, text, name="sheet.xml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def four(seed=0):
    return {name: scattering(seed + k, 0.2 + 0.1 * k) for k, name in enumerate(BLOCKS)}


def test_bases_cover_the_hemisphere():
    for basis in KLEMS_BASES:
        assert basis.projected_solid_angles().sum() == pytest.approx(np.pi, rel=1e-14)
        np.testing.assert_array_equal(basis.patch(*basis.centres()), np.arange(basis.size))
    assert [basis.size for basis in KLEMS_BASES] == [145, 77, 41]


@pytest.mark.parametrize("structure", ["Columns", "Rows"])
def test_a_matrix_is_read_as_written(tmp_path, structure):
    """Each reading stands at the middle of its patches, on the sides that its block names."""
    blocks = four()
    order = {"Columns": lambda m: m, "Rows": np.transpose}[structure]
    text = document({name.title(): numbers(order(m)) for name, m in blocks.items()}, structure)
    table = read(written(tmp_path, text))
    theta_i, phi_i, theta_o, phi_o = table.layout.angles()
    assert table.layout.size == 4 * QUARTER.size**2 and table.channels.names == ("Visible",)
    front_i, front_o = theta_i < np.pi / 2, theta_o < np.pi / 2
    sides = {"reflection front": front_i & front_o, "transmission front": front_i & ~front_o}
    sides |= {"transmission back": ~front_i & front_o, "reflection back": ~front_i & ~front_o}
    for name, matrix in blocks.items():
        k = sides[name]
        # The direction in which the light travels
        arriving = QUARTER.patch(np.minimum(theta_i, np.pi - theta_i)[k], (phi_i[k] + np.pi) % (2 * np.pi))
        leaving = QUARTER.patch(np.minimum(theta_o, np.pi - theta_o)[k], phi_o[k])
        np.testing.assert_array_equal(np.asarray(table.f)[k, 0], matrix[leaving, arriving])
    # Between the middles the file's own rule holds
    wi, wo = table.layout.directions()
    np.testing.assert_allclose(np.asarray(evaluate(table.interpolant(), wi, wo)), table.f, rtol=1e-14)


def test_straight_through_and_mirrored_are_the_diagonal(tmp_path):
    diagonal = np.diag(np.arange(1.0, 42.0))
    table = read(
        written(tmp_path, document({name: numbers(diagonal) for name in ("Transmission Front", "Reflection Front")}))
    )
    rng = np.random.default_rng(0)
    z, phi = rng.uniform(0.05, 1, 200), rng.uniform(0, 2 * np.pi, 200)
    x, y = np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi)
    patch = QUARTER.patch(np.arccos(z), (phi + np.pi) % (2 * np.pi))
    for out in (z, -z):
        f = evaluate(table.interpolant(), Direction(x, y, z), Direction(-x, -y, out))
        np.testing.assert_array_equal(np.ravel(f), patch + 1.0)
    # Nothing is known of the back, and nothing is said of it
    assert np.isnan(evaluate(table.interpolant(), Direction(x, y, -z), Direction(-x, -y, z))).all()


def tree_text(draw_leaf, dimensions, depth, rng):
    """(text, lookup): a random tree, and a plain recursive reading of it."""
    if depth and rng.random() < 0.6:
        branches = [tree_text(draw_leaf, dimensions, depth - 1, rng) for _ in range(2**dimensions)]

        def below(place):
            half = [int(p >= 0.5) for p in place]
            inside = [2 * p - h for p, h in zip(place, half, strict=True)]
            return branches[sum(h << k for k, h in enumerate(half))][1](inside)

        return "{" + " ".join(text for text, _ in branches) + "}", below
    side = 2 ** int(rng.integers(0, 2))
    grid = draw_leaf(side**dimensions)

    def at(place):
        index = 0
        for p in place:
            index = index * side + int(p * side)
        return grid[index]

    return "{" + ", ".join(repr(float(v)) for v in grid) + "}", at


@pytest.mark.parametrize("dimensions", [3, 4])
def test_a_tree_is_read_as_a_plain_walk_reads_it(dimensions):
    rng = np.random.default_rng(dimensions)
    text, lookup = tree_text(rng.random, dimensions, 3, rng)
    tree = parse_tree(text, dimensions, "a tree")
    cells = np.asarray(tree.low) + np.asarray(tree.size)[:, None] / 2
    np.testing.assert_array_equal([lookup(place) for place in cells], tree.values)
    assert float(np.sum(np.asarray(tree.size) ** dimensions)) == pytest.approx(1, rel=1e-12)
    # The share that leaves is the mean over the square, times π
    arriving = tree.incidences()
    sin_i = np.sin(arriving[:, 0])
    if dimensions == 3:
        axes = [0.5 - 0.5 * sin_i]
        middle = (np.arange(64) + 0.5) / 64
        for k in range(0, len(sin_i), 3):
            mean = np.mean([lookup([axes[0][k], u, v]) for u, v in itertools.product(middle, middle)])
            assert tree.share(arriving[k : k + 1])[0] == pytest.approx(np.pi * mean, rel=1e-12)
    shares = tree.share(arriving)
    weight = np.full(len(shares), 1 / len(shares)) if dimensions == 4 else sin_i / np.sum(sin_i)
    if dimensions == 4:
        total = np.sum(np.asarray(tree.values) * np.asarray(tree.size) ** 4)
        assert np.sum(weight * shares) == pytest.approx(np.pi * total, rel=1e-12)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([3, 4]), st.integers(0, 400), st.sampled_from("{},x 1-"))
def test_a_damaged_tree_is_refused_or_a_tree(seed, dimensions, place, character):
    rng = np.random.default_rng(seed)
    text, _ = tree_text(rng.random, dimensions, 1, rng)
    place %= len(text)
    try:
        tree = parse_tree(text[:place] + character + text[place + 1 :], dimensions, "a tree")
    except GonioError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(tree.values).all()


def test_a_tree_of_a_file_is_read_along_the_light(tmp_path):
    """Three dimensions: the surface looks the same all round, and mirror reflection of a grazing beam goes on ahead."""
    ahead = np.zeros((2, 4, 4))
    ahead[0, 3] = 1.0  # travelling along +x leaves along +x
    fine = np.repeat(ahead, 2, axis=0)
    table = read(written(tmp_path, document({"Reflection Front": "{" + numbers(fine) + "}"}, "TensorTree3")))
    assert table.provenance["isotropic"]
    z = 0.2
    for phi in (0.0, 1.0, 4.0):
        wi = Direction(
            *(np.full(2, c) for c in (-np.sqrt(1 - z**2) * np.cos(phi), -np.sqrt(1 - z**2) * np.sin(phi), z))
        )
        out = np.array([1.0, -1.0])
        wo = Direction(-wi.x * out, -wi.y * out, wi.z)
        np.testing.assert_array_equal(np.ravel(evaluate(table.interpolant(), wi, wo)), [1.0, 0.0])


GOOD = numbers(scattering(0, 0.5))
BAD = {
    "entities": ('<?xml version="1.0"?><!DOCTYPE w [<!ENTITY a "aaaa">]>', GOOD, "Columns", "document type"),
    "too few": (None, GOOD.rpartition(",")[0], "Columns", "1,680 values, expected 41 × 41"),
    "no numbers": (None, "one, two", "Columns", "no list of numbers"),
    "not finite": (None, GOOD.replace(GOOD.split(",")[3], " nan", 1), "Columns", "not finite"),
    "another structure": (None, GOOD, "Matrix", "data structure is 'Matrix'"),
    "open brace": (None, "{{1}", "TensorTree3", "stays open|branches"),
    "beside a node": (None, "{" + "7 {1}" * 8 + "}", "TensorTree3", "beside the branches"),
    "no grid": (None, "{1 2 3}", "TensorTree3", "powers of 2"),
}


@pytest.mark.parametrize("kind", BAD)
def test_damage_is_said_in_one_sentence(tmp_path, kind):
    head, data, structure, says = BAD[kind]
    text = document({"Reflection Front": data}, structure, **({} if head is None else {"head": head}))
    with pytest.raises(GonioError, match=says) as error:
        read(written(tmp_path, text))
    assert "\n" not in str(error.value) and "export it again" in str(error.value)


def test_other_refusals(tmp_path):
    whole = document({"Reflection Front": GOOD})
    basis = "<AngleBasis><AngleBasisName>own</AngleBasisName>{}</AngleBasis>"
    bounds = "<ThetaBounds><LowerTheta>{}</LowerTheta><UpperTheta>{}</UpperTheta></ThetaBounds>"
    ring = f"<AngleBasisBlock>{bounds}<nPhis>{{}}</nPhis></AngleBasisBlock>"
    cases = {
        "damaged": whole[: len(whole) // 2],
        "in the direction": whole.replace("Reflection Front", "Emission Front"),
        "is not defined": whole.replace(f"<RowAngleBasis>{QUARTER.name}", "<RowAngleBasis>own"),
        "no block": document({}),
        "must reach 90": document({"Reflection Front": GOOD}, more=basis.format(ring.format(0, 60, 8))),
        "do not join": document(
            {"Reflection Front": GOOD}, more=basis.format(ring.format(0, 30, 8) + ring.format(45, 90, 8))
        ),
        "no numbers": document({"Reflection Front": GOOD}, more=basis.format(ring.format("x", 90, 8))),
        "elements": document({"Reflection Front": GOOD}, more="<a/>" * 70000),
    }
    for says, text in cases.items():
        with pytest.raises(GonioError, match=says):
            read(written(tmp_path, text))


def test_a_wavelength_of_odd_characters_is_a_name(tmp_path):
    table = read(written(tmp_path, document({"Reflection Front": GOOD}, wavelength="a\u202eb" + "x" * 300)))
    assert table.channels.names[0].startswith("a") and len(table.channels.names[0]) <= 200
    assert np.isfinite(table.f).all()


def test_a_basis_that_is_only_named_is_chosen_by_its_size(tmp_path):
    """Two bases have been called Half: of 77 patches by WINDOW, of 73 by Radiance's programs before 2024."""
    for basis in (KLEMS_BASES[1], EARLIER_BASES[0]):
        text = document({"Reflection Front": numbers(np.full(basis.size**2, 0.1))}).replace(QUARTER.name, basis.name)
        table = read(written(tmp_path, text))
        edges = np.radians(basis.edges)
        np.testing.assert_allclose(np.unique(table.layout.axes["theta_i"])[1:], (edges[1:-1] + edges[2:]) / 2)
        assert any("does not define its basis" in a for a in table.provenance["assumptions"])


def test_channels_of_wavelengths_and_chromaticities(tmp_path):
    text = document({"Reflection Front": GOOD}, wavelength="0.55").replace('unit="Integral"', 'unit="Micrometer"')
    assert read(written(tmp_path, text)).channels.wavelengths_nm == (550.0,)
    both = document({"Reflection Front": GOOD}) + document({"Reflection Front": GOOD}, wavelength="CIE-u")
    inner = both.split("</DataDefinition>")[2].split("</Layer>")[0]
    table = read(written(tmp_path, document({"Reflection Front": GOOD}).replace("</Layer>", inner + "</Layer>")))
    assert table.channels.names == ("Visible",)
    assert any("chromaticity" in a for a in table.provenance["assumptions"])


@NEEDS_RADIANCE
def test_radiance_agrees(tmp_path):
    """Hemispherical values, and f to the ±0.03 % by which Radiance's program marks the place of a value."""
    rng = np.random.default_rng(3)
    grid = np.cumsum(rng.random((2, 8, 8)), axis=1)
    trees = {name: "{" + numbers(np.repeat(0.02 * grid * (k + 1), 4, axis=0)) + "}" for k, name in enumerate(BLOCKS)}
    matrices = {name: numbers(m) for name, m in four(5).items()}
    theta, phi = rng.uniform(0.02, np.pi - 0.02, (2, 300)), rng.uniform(0, 2 * np.pi, (2, 300))
    wi, wo = (
        Direction(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)) for t, p in zip(theta, phi, strict=True)
    )
    degrees = np.degrees(np.stack([np.pi - theta[0], phi[0], np.pi - theta[1], phi[1]], axis=-1))
    for structure, blocks in (("Columns", matrices), ("TensorTree3", trees)):
        path = written(tmp_path, document({n.title(): t for n, t in blocks.items()}, structure), f"{structure}.xml")
        ours, questions, shares = read(path).interpolant(), [], []
        for name in BLOCKS:
            block = ours.blocks[name][0]
            for arriving in block.incidences()[::7]:
                # Its back is the front
                polar = np.degrees(np.pi - arriving[0] if name.endswith("front") else arriving[0])
                questions.append((polar, np.degrees(arriving[1]) + 180, name.split()[0]))
                shares.append(block.share(arriving[None])[0])
        theirs = radiance.ask(path, questions, degrees)
        np.testing.assert_allclose(shares, theirs.shares, rtol=0, atol=1e-6)
        np.testing.assert_allclose(np.ravel(evaluate(ours, wi, wo)), theirs.values, rtol=4e-4, atol=1e-7)


@NEEDS_RADIANCE
def test_a_client_that_refuses_or_crashes_fails_one_test(tmp_path, monkeypatch):
    with pytest.raises(RuntimeError, match=r"(?s)status 1 on .*it cannot read the file"):
        radiance.ask(tmp_path / "absent.xml")
    monkeypatch.setattr(radiance, "COMMAND", [sys.executable, "-c", "import os; os.kill(os.getpid(), 11)"])
    with pytest.raises(RuntimeError, match="ended with signal SIGSEGV on"):
        radiance.ask(tmp_path / "absent.xml")
