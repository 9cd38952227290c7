"""How files are to be taken, of several subjects of a command."""

import argparse
import math

import pytest

from gonio.cli.arguments import as_stated, beside_stated
from gonio.data.layouts import in_plane
from gonio.instrument import measure
from gonio.models.errors import GonioError


def test_what_is_stated_goes_to_the_files_whose_formats_know_of_it(tmp_path):
    """A CSV whose azimuths differ by 0 at the mirror side, beside a table of gonio's own and a model."""
    csv, h5 = tmp_path / "lab.csv", tmp_path / "t.h5"
    csv.write_text("theta_i,theta_o,phi_o,f\n30,30,0,2\n30,30,180,0.1\n", encoding="utf-8")
    measure("lambert(rho=0.4)", None, in_plane([0.3], [-0.3, 0.3])).save(h5)
    args = argparse.Namespace(mirror_azimuth=0)
    table = beside_stated(str(csv), args).table
    cells, (_, phi_i, _, phi_o) = table.valid_cells(), table.layout.angles()
    turn = (phi_o - phi_i)[cells][table.read_values()["f"][cells, 0].argmax()]
    assert math.cos(turn) == pytest.approx(-1)
    assert beside_stated(str(h5), args) == str(h5) and beside_stated("gold", args) == "gold"
    for subject, sentence in ((str(h5), "has no option 'mirror_azimuth'"), ("gold", "is no file")):
        with pytest.raises(GonioError, match=sentence):
            as_stated(subject, args)
