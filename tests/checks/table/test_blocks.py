"""The check of a table in blocks and by channels: the verdicts and the numbers are those of the whole."""

import dataclasses
import itertools

import numpy as np
import pytest

from gonio.checks.certify import check
from gonio.checks.table.pairs import columns, equal_pairs, places
from gonio.checks.table.statistics import differences
from gonio.data.flags import Flag
from gonio.data.hdf5.reader import open_table
from gonio.data.hdf5.writer import write_table
from support.check_tables import LAYOUTS, model_table, property_of
from support.marks import thorough

RGB = "lambert(rho=[0.2, 0.5, 0.7]) + ggx(alpha=0.4, f0=0.04)"


def violated(f, theta_i, phi_i, theta_o, phi_o):
    return f * np.where(theta_i < theta_o, 1.04, 1.0)


def numbers_of(certificate):
    """Every number of a certificate, and every text but sentences, by its place."""

    def walk(value, place):
        if isinstance(value, dict):
            return itertools.chain.from_iterable(walk(v, (*place, k)) for k, v in value.items())
        if isinstance(value, list):
            return itertools.chain.from_iterable(walk(v, (*place, k)) for k, v in enumerate(value))
        return [(place, value)]

    return dict(walk(certificate.to_dict()["properties"], ()))


def in_blocks(monkeypatch):
    monkeypatch.setattr(columns, "HELD_BYTES", 1)
    for module, size in ((places, 50), (equal_pairs, 70), (differences, 11)):
        monkeypatch.setattr(module, "BLOCK", size)


@pytest.mark.parametrize(
    ("layout", "stated"),
    [("isotropic", None), ("spherical", 0.02), *thorough(("isotropic", 0.02), ("spherical", None))],
)
def test_blocks_change_nothing(layout, stated, monkeypatch, tmp_path):
    table = model_table(RGB, LAYOUTS[layout], violated, 0.02, stated)
    rng = np.random.default_rng(0)
    table.flag[rng.random(table.flag.shape) < 0.03] = Flag.SATURATED
    path = write_table(tmp_path / "t.h5", table)
    whole = numbers_of(check(open_table(path)))
    in_blocks(monkeypatch)
    some = numbers_of(check(open_table(path, lazy_bytes=0)))
    assert whole.keys() == some.keys()
    for place, value in whole.items():
        if isinstance(value, float):
            assert some[place] == pytest.approx(value, rel=1e-6, abs=1e-12), place
        else:
            assert some[place] == value, place


def test_columns_are_the_readings_of_the_cells(monkeypatch):
    table = model_table(RGB, noise=0.02, stated=0.02)
    table.flag[3, 2, 1, 0] = Flag.INVALID
    cells = np.sort(np.random.default_rng(1).choice(table.layout.size, 40, replace=False))
    f, u = columns.readings_of(table, cells)
    for held in (1, 1 << 20):
        for order in ((0, 1, 2), (2, 0, 1)):
            read = columns.ReadingColumns(table, cells, held)
            for channel in order:
                np.testing.assert_array_equal(read.of_channel(channel), (f[:, channel], u[:, channel]))
    unknown = columns.ReadingColumns(dataclasses.replace(table, u_f=None), cells)
    assert np.isnan(unknown.of_channel(0)[1]).all()


@pytest.mark.parametrize(("size", "most"), [(100, 99), (10**9, 1000), (50, 50)])
def test_some_of_many_are_different_and_in_order(size, most):
    some = equal_pairs.some_of(size, most)
    assert some.size == most and (np.diff(some) > 0).all() and some[0] >= 0 and some[-1] < size


def test_of_a_larger_table_some_pairs_are_enough_to_fail_it(monkeypatch):
    monkeypatch.setattr(equal_pairs, "MOST_CELLS", 600)
    table = model_table(RGB, LAYOUTS["isotropic"], violated, 0.002, 0.002)
    assert table.layout.size > 900
    reciprocity = property_of("reciprocity", table)
    assert reciprocity.verdict != "pass" and 150 < reciprocity.facts["pairs"] < 600
    assert f"of 600 of {table.layout.size:,} cells, chosen at random" in reciprocity.detail
    honest = model_table(RGB, LAYOUTS["isotropic"], None, 0.002, 0.002)
    assert property_of("reciprocity", honest).verdict == "pass"
