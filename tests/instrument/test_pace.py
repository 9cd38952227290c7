"""The pace of an instrument: the seconds of a scan, of any size, against sums by hand and all of its way at once."""

import math
import tracemalloc

import numpy as np
import pytest

from gonio.data.subject import load_material
from gonio.instrument.instrument import Instrument
from gonio.instrument.pace import Pace, scan_order
from gonio.instrument.reader import Reader
from gonio.instrument.scans import scan

PACE = Pace(axis_speed=math.radians(10), settling=0.25)


@pytest.mark.parametrize(
    ("name", "options"),
    [("isotropic", {"step": math.radians(1.5)}), ("half-difference", {"step": math.radians(1.5)})],
)
def test_the_parts_of_a_scan_take_the_time_of_the_whole(name, options):
    layout = scan(name, **options)
    order, counting = scan_order(layout), np.random.default_rng(1).uniform(0.5, 2.0, layout.size)
    takes = PACE.scan_time(layout, counting)
    assert takes.readings == order.size
    assert takes.moving == pytest.approx(PACE.path_seconds([a[order] for a in layout.angles()], 0.0), rel=1e-9)
    assert takes.counting == pytest.approx(counting[order].sum(), rel=1e-9)


def test_the_time_of_a_large_scan_needs_no_memory_that_grows_with_it():
    peaks = []
    for step in (1.0, 0.2):
        layout = scan("isotropic", step=math.radians(step))
        tracemalloc.start()
        takes = PACE.scan_time(layout, 0.5)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        # Every move is one step of one axis.
        assert takes.moving == pytest.approx((layout.size - 1) * step / 10 + layout.size * 0.25, rel=1e-5)
        assert takes.readings == layout.size and takes.counting == pytest.approx(0.5 * layout.size)
    assert layout.size > 3e8 and max(peaks) < 80e6 and peaks[1] < 1.1 * peaks[0]


@pytest.mark.parametrize("channels", [1, 3, 16])
def test_blocks_of_many_channels_hold_no_more_readings(channels):
    layout, albedos = scan("isotropic", step=math.radians(1)), ",".join(["0.5"] * channels)
    material = load_material(f"lambert(rho=[{albedos}])" if channels > 1 else "lambert(rho=0.5)")
    reader = Reader(material, Instrument(), layout, 0)
    assert reader.block_cells % layout.row_size == 0
    assert reader.block_cells * channels <= 1 << 20
