"""A folder to work in, with a table and directions, as a user has it."""

import pytest

from gonio.data.hdf5.writer import write_table
from support.tables import grey_table


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "d.csv").write_text("theta_i,phi_i,theta_o,phi_o\n30,0,30,180\n0,0,45,10\n")
    write_table(tmp_path / "t.h5", grey_table(name="t"))
    (tmp_path / "campaign.toml").write_text('gonio_campaign = 1\ntables = ["t.h5"]\nfit = "lambert"\n')
    return tmp_path
