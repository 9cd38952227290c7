"""`gonio eval` at the prompt: angles that are typed, channels by their names, standard input and output."""

import io
import json
import math
import sys

import numpy as np
import pytest

import gonio
from gonio.__main__ import main

COLOURED = "lambert(rho=[0.3, 0.6, 0.9])"


def test_typed_angles_are_combined_and_read_back(here, capsys):
    """The table that eval writes holds every combination, in the plane where no azimuth is given."""
    assert main(["eval", COLOURED, "--theta-i", "0,30", "--theta-o", "-20:20:10", "-o", "out.csv"]) == 0
    table = gonio.open("out.csv")
    assert table.channels.names == ("R", "G", "B") and table.layout.size == 10
    np.testing.assert_allclose(np.asarray(table.f).reshape(-1, 3), [[r / np.pi for r in (0.3, 0.6, 0.9)]] * 10)
    theta_i, _, theta_o, delta_phi = np.degrees(table.layout.angles())
    signed = np.where(np.cos(np.radians(delta_phi)) < 0, theta_o, -theta_o)
    assert sorted(zip(theta_i.round(), signed.round(), strict=True)) == [
        (i, o) for i in (0, 30) for o in range(-20, 21, 10)
    ]


@pytest.mark.parametrize(
    ("typed", "phi_o"),
    [
        (["--theta-o", "-40"], 0.0),
        (["--theta-o", "40"], 180.0),
        (["--theta-o", "-40", "--delta-phi", "90"], 270.0),
        (["--theta-o", "40", "--phi-i", "20", "--delta-phi=-30"], 350.0),
        (["--theta-o", "40", "--phi-o", "15"], 15.0),
    ],
)
def test_signed_angles_are_turned_as_in_a_file(capsys, typed, phi_o):
    assert main(["eval", "lambert(rho=0.5)", "--theta-i", "30", *typed, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["theta_o_deg"] == [40] and facts["phi_o_deg"] == [phi_o]
    assert facts["f"] == [[pytest.approx(0.5 / math.pi)]] and facts["unit"] == "1/sr"


def test_names_of_channels_are_columns_and_come_back(here, capsys):
    """Wavelengths in the header; names that no header tells in a comment, with numbered columns."""
    assert main(["eval", "gold", "--theta-o", "10", "-o", "-"]) == 0
    (here / "gold.csv").write_text(capsys.readouterr().out)
    assert (here / "gold.csv").read_text().startswith("theta_i,phi_i,theta_o,phi_o,f_413.3nm,")
    assert gonio.open("gold.csv").channels == gonio.material("gold").channels
    (here / "m.toml").write_text(
        'gonio_material = 1\nname = "m"\nmodel = "lambert(rho=[0.1, 0.2])"\nchannels = ["wet", "dry"]\n'
    )
    assert main(["eval", "m.toml", "--theta-o", "10", "-o", "m.csv"]) == 0
    assert gonio.open("m.csv").channels.names == ("wet", "dry")


def test_what_was_not_read_is_flagged_and_is_no_reading_when_it_comes_back(here, capsys):
    """Of readings up to 60°; values are written all the same, as f is continued there."""
    polar = np.arange(0.0, 61.0, 20.0)
    angles = np.meshgrid(polar, [0.0], polar, np.arange(0.0, 360.0, 45.0), indexing="ij")
    f = np.full(angles[0].size, 0.1)
    table = gonio.Table.from_arrays(*(a.ravel() for a in angles), f, u_f=0.01 * f, degrees=True)
    table.save("part.h5")
    assert main(["eval", "part.h5", "--theta-i", "30,70", "--theta-o", "50,65", "-o", "out.csv"]) == 0
    assert "3 of 4 directions are beyond what was read of part" in capsys.readouterr().err
    back = gonio.open("out.csv")
    assert (back.counts()["valid"], back.counts()["not_measured"]) == (1, 3)
    f, u_f, flag = np.genfromtxt("out.csv", delimiter=",", skip_header=1)[:, -3:].T
    assert f == pytest.approx(0.1) and flag.tolist() == [0, 4, 4, 4]
    assert np.isnan(u_f).tolist() == [False, True, True, True]
    np.testing.assert_array_equal(
        table.covers([[30], [70]], 0, [50, 65], 180, degrees=True), [[True, False], [False, False]]
    )
    assert main(["eval", "part.h5", "--theta-i", "30", "--theta-o", "50"]) == 0
    captured = capsys.readouterr()
    assert "flag" not in captured.out and not captured.err
    gonio.Table.from_arrays(*(a.ravel() for a in angles), np.full(angles[0].size, 0.1), degrees=True).save("bare.h5")
    assert main(["eval", "bare.h5", "--theta-i", "20", "--theta-o", "40"]) == 0
    assert "not all readings of bare state their own uncertainty" in capsys.readouterr().err


def test_a_fit_has_uncertainties_beside_its_values_and_says_what_it_is(here, capsys):
    """Without them on request; one that was judged no good fit says so."""
    angles = np.meshgrid(np.arange(0, 61, 20.0), [0.0], np.arange(0, 76, 15.0), [0.0, 90.0, 180.0])
    f = 0.1 + 0.02 * np.cos(np.radians(angles[2]))
    gonio.fit(gonio.Table.from_arrays(*angles, f, degrees=True), "lambert").save("matte.toml")
    assert main(["eval", "matte.toml", "--theta-o", "10", "--json"]) == 0
    captured = capsys.readouterr()
    facts, rho = json.loads(captured.out), gonio.material("matte.toml").meta["fit"]["parameters"][0]
    assert facts["u_f"] == [[pytest.approx(rho["standard_uncertainty"] / math.pi)]]
    assert "matte is a fit that was judged fair" in captured.err and "u_f is what the uncertainties" in captured.err
    assert main(["eval", "matte.toml", "--theta-o", "10", "--json", "--values-only"]) == 0
    captured = capsys.readouterr()
    assert "u_f" not in json.loads(captured.out) and "u_f" not in captured.err


class Typed(io.StringIO):
    """A terminal's standard output."""

    def isatty(self):
        return True


def test_a_terminal_gets_a_table_as_wide_as_it_is(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(sys, "stdout", Typed())
    assert main(["eval", "gold", "--theta-i", "45", "--theta-o", "-60:60:30"]) == 0
    above, header, _, first, *_, below = sys.stdout.getvalue().splitlines()
    assert above == "theta_i 45, phi_i 0, f in 1/sr" and header.split()[:2] == ["theta_o", "f_413.3nm"]
    assert first.split()[0] == "-60" and "3 more channels" in below and len(header) <= 60


def test_standard_input_and_output_stand_for_files(here, monkeypatch, capsysbinary):
    def piped(data, *words):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
        status = main(list(words))
        return status, *(stream.decode() for stream in capsysbinary.readouterr())

    directions = (here / "d.csv").read_bytes()
    status, values, _ = piped(directions, "eval", COLOURED, "--directions", "-")
    assert status == 0 and values.splitlines()[0] == "theta_i,phi_i,theta_o,phi_o,f_R,f_G,f_B"
    status, facts, _ = piped(values.encode(), "info", "-", "--json")
    assert status == 0 and json.loads(facts)["cells"] == 2
    status, text, err = piped((here / "t.h5").read_bytes(), "convert", "-", "-")
    (here / "back.csv").write_text(text)
    assert status == 0 and gonio.open("back.csv").layout == gonio.open("t.h5").layout
    for words, why in {
        "info -": "is empty",
        "eval - --directions -": "can be read once",
        "convert t.h5 - --to hdf5": "no text",
        "measure gold -o -": "no text",
        "eval gold --theta-o 0 -o - --json": "both go to standard output",
    }.items():
        status, out, err = piped(b"", *words.split())
        assert status == 2 and out == "" and why in err and "/tmp" not in err, words


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "give angles"),
        ("--directions d.csv --phi-i 3", "leave --phi-i out"),
        ("--phi-o 1 --delta-phi 2", "give one of them"),
        ("--theta-o 0:80", "start:stop:step"),
        ("--theta-o 0:80:-1", "a step that leads there"),
        ("--theta-o 0:80:1e-9", "give a larger step"),
        ("--theta-i 0:80:0.01 --theta-o 0:80:0.01", "give larger steps"),
        ("--theta-i 181", "from the normal"),
        ("--theta-i nan", "give degrees"),
    ],
)  # fmt: skip
def test_angles_that_are_none_are_refused_in_a_line(here, capsys, words, message):
    assert main(["eval", "gold", *words.split()]) == 2
    out, err = capsys.readouterr()
    assert out == "" and message in err and err.count("\n") == 1
