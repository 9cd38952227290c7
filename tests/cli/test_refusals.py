"""What a user gets wrong ends in one line that names the mistake, status 2, and no file."""

import shlex

import h5py
import numpy as np
import pytest

from gonio.__main__ import main

DIRECTIONS = "theta_i,phi_i,theta_o,phi_o"
MATT = "lambert(rho=0.5)"


@pytest.fixture
def faulty(here):
    """The folder, with files that are no tables or hold impossible directions."""
    texts = {
        "empty.csv": "",
        "text.csv": f"{DIRECTIONS}\n1,2,3,4\nx,0,20,0\n",
        "nan.csv": f"{DIRECTIONS}\nnan,0,20,0\n",
        "below.csv": f"{DIRECTIONS}\n10,0,190,0\n",
        "few.csv": f"{DIRECTIONS},f\n10,0,20,0,0.1\n20,0,20,0,0.1\n",
    }
    for name, text in texts.items():
        (here / name).write_text(text)
    (here / "broken.h5").write_bytes((here / "t.h5").read_bytes()[:900])
    with h5py.File(here / "foreign.h5", "w") as file:
        file["x"] = np.arange(5)
    (here / "noise.bin").write_bytes(np.random.default_rng(0).bytes(5000))
    (here / "merl.binary").write_bytes(np.array([2**31 - 1, -90, 180], "<i4").tobytes() + bytes(800))
    (here / "warp.bsdf").write_bytes(b"tensor_file\0" + bytes([1, 0]) + (2**32 - 1).to_bytes(4, "little") + bytes(90))
    (here / "folder").mkdir()
    (here / "link.h5").symlink_to("t.h5")
    (here / "t.json").write_bytes((here / "t.h5").read_bytes())
    (here / "link.json").symlink_to("t.json")
    (here / "s.scene.toml").write_text("gonio_scene = 1\n")
    (here / "page.json").write_text("{}")
    return here


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("eval lambrt(rho=0.1) --directions d.csv", "did you mean 'lambert'?"),
        ("eval gld --directions d.csv", "did you mean 'gold'?"),
        ("eval lambert(rho=1.5) --directions d.csv", "outside of its domain [0, 1]"),
        (f"eval {MATT} --directions absent.csv", "does not exist"),
        (f"eval {MATT} --directions d.csv -o d.csv", "exists already"),
        (f"eval {MATT} --directions d.csv -o d.csv --force", "is an input of this command"),
        (f"eval {MATT} --directions d.csv -o no/where.csv", "the folder"),
        (f"eval {MATT} --directions empty.csv", "is empty"),
        (f"eval {MATT} --directions text.csv", "line 3: theta_i is 'x'"),
        (f"eval {MATT} --directions nan.csv", "line 2: theta_i is missing"),
        (f"eval {MATT} --directions below.csv", "expected 0 to 180 degrees"),
        ("info broken.h5", "not a whole HDF5 file"),
        ("info foreign.h5", "no table of gonio"),
        ("info noise.bin", "of an unknown kind"),
        ("info merl.binary", "its header claims"),
        ("info warp.bsdf", "the file is damaged"),
        (f"measure {MATT} --adaptive -o a.h5", "give a target"),
        (f"measure {MATT} --adaptive --target 0 -o a.h5", "between 0 and 1"),
        (f"measure {MATT} --adaptive --target much -o a.h5", "give a share, such as 1%"),
        (f"measure {MATT} --adaptive --budget 2 -o a.h5", "give a time, such as 2h"),
        (f"measure {MATT} --adaptive --budget 5s -o a.h5", "is too short"),
        (f"measure {MATT} --adaptive --target 1% --step 5 -o a.h5", "leave --step out"),
        (f"measure {MATT} --target 1% -o a.h5", "give --adaptive too"),
        (f"measure {MATT} --adaptive grid --target 1% -o a.h5", "give table or model"),
        (f"measure {MATT} --adaptive -m lambert --target 1% -o a.h5", "leave it out"),
        ("fit t.h5 -m lambert -o d.csv", "exists already"),
        ("fit t.h5 -m ggy", "did you mean 'ggx'?"),
        ("fit t.h5 -m lambert --loss cube", "did you mean 'cbrt'?"),
        ("fit t.h5 -m lambert --theta-max 120", "from 0 to 90"),
        ("fit t.h5 -m lambert --theta-max 0", "above 0"),
        ("fit t.h5 -m lambert --starts -1", "0 or more"),
        ("fit t.h5 -m lambert --robust tuky", "did you mean 'tukey'?"),
        ("fit t.h5 -m lambert --bootstrap 1", "from 2"),
        ("fit t.h5 -m lambert --weight cos", "did you mean 'cosine'?"),
        ("fit few.csv -m 'lambert + ggx'", "1 more are needed"),
        ("fit . -m lambertt", "did you mean 'lambert'?"),
        ("fit t.h5 folder/../t.h5 -m lambert", "would both be written"),
        ("fit . -m lambert -o t.h5", "names the folder"),
        ("fit folder -m lambert", "holds no table"),
        ("convert t.h5 t.xyz", "give .h5"),
        ("convert t.h5 t.h5 --force", "is an input of this command"),
        ("convert t.h5 link.h5 --force", "is an input of this command"),
        ("check t.json --json t.json --force", "is an input of this command"),
        ("info t.json --json link.json --force", "is an input of this command"),
        (f"check {MATT} --against t.json --json t.json --force", "is an input of this command"),
        ("info t.h5 --json page.json", "exists already"),
        ("check t.h5 --repair t.h5 --force", "is an input of this command"),
        ("fit t.h5 -m lambert -o new.json --json folder/../new.json", "are one file"),
        ("fit t.h5 -m lambert --scene s.scene.toml -o s.scene.toml --force", "is an input of this command"),
        ("fit t.h5 -m lambert -o new.json --json ./new.json", "are one file"),
        ("reduce t.h5 --scene s.scene.toml -o s.scene.toml --force", "is an input of this command"),
        ("report t.h5 -o t.h5 --force", "is an input of this command"),
        ("report t.h5 -o ''", "is a folder"),
        ("report t.h5 -o page.html --against page.json --force", "is an input of this command"),
        ("reduce t.h5 --scene nowhere -o x.h5", "known are low_sun_car"),
        ("reduce t.h5 --scene low_sun_car -o x.csv", "not an HDF5 name"),
        ("reduce t.h5 --scene low_sun_car -o x.h5 --tolerance 5", "above 0 and below 1"),
        ("measure t.h5 -o t.h5 --force", "is an input of this command"),
        ("measure gold -o new.h5 --step -5", "give one above 0"),
        ("measure gold -o new.h5 --source-half-angle 80", "(45°)"),
        ("measure gold -o no/new.h5", "the folder"),
        ("measure lambrt(rho=0.5) -o new.h5", "did you mean 'lambert'?"),
        (f"measure {MATT} -o new.h5 --scan meril", "is unknown"),
        (f"measure {MATT} -o new.h5 --scan none.csv", "does not exist"),
        (f"measure {MATT} -o new.h5 --scan merl --step 2", "no step"),
        (f"measure {MATT} -o new.h5 --scan in-plane --theta-i 1,x", "give degrees, such as"),
        (f"measure {MATT} -o new.h5 --photons -3", "photons is -3"),
        (f"measure {MATT} -o new.h5 --read-noise 3", "give photons too"),
        (f"measure {MATT} -o new.h5 --systematic tilt=1", "it has tilt_x"),
        (f"measure {MATT} -o new.h5 --systematic tilt_x", "give NAME=NUMBER"),
        (f"measure {MATT} -o new.h5 --seed -1", "seed is -1"),
        (f"measure {MATT} -o new.h5 --step 0.01 --scan spherical", "larger step"),
        ("report t.h5 -o t.h5 --force", "is an input of this command"),
        ("check absent.h5", "does not exist"),
        ("check", "give either a FILE or MATERIAL"),
        (f"check {MATT} --self-test", "give either a FILE or MATERIAL"),
        (f"check {MATT} --tol-energy -1", "is -1"),
        (f"check {MATT} --feature-width 100", "from 0 to 90"),
        (f"check {MATT} --level 0", "above 0 and up to 0.5"),
        (f"check {MATT} --against nonsense", "nknown material"),
        (f"check {MATT} --step 5", "give --repair OUT.h5 too"),
        ("check t.h5 --repair x.h5 --strict", "tolerances and --json only"),
        ("models gxx", "did you mean 'ggx'?"),
        ("models --picture x.png", "name it"),
        ("materials silvr", "did you mean 'silver'?"),
        ("stress ggx --processes 0", "give 1 or more"),
        ("stress --cell KEY", "name that model"),
        ("demo -o t.h5", "name a folder"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(faulty, capsys, command, message):
    assert message not in command, "a message that only repeats the command would pass"
    before = {p: p.stat().st_mtime_ns for p in faulty.rglob("*")}
    assert main(shlex.split(command)) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("gonio: ") and err.count("\n") == 1
    assert message in err
    assert {p: p.stat().st_mtime_ns for p in faulty.rglob("*")} == before


@pytest.mark.parametrize(
    "command",
    ["mesure", "fit", "eval gold --direction x --bogus", "measure gold -o x.h5 --photons many", "info --json t.h5"],
)
def test_unknown_verbs_and_options_are_one_line(here, capsys, command):
    with pytest.raises(SystemExit) as stop:
        main(command.split())
    assert stop.value.code == 2 and capsys.readouterr().err.count("\n") == 1
