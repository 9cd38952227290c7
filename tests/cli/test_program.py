"""What all verbs share: help, unknown words, quiet and JSON, completion, terminals of few characters, signals."""

import os
import shlex
import subprocess
import sys

import pytest

from gonio.cli import encoding
from gonio.cli.examples import EXAMPLES
from gonio.cli.program import VERBS, main, parsed, parser
from gonio.models.catalog import MODELS
from gonio.models.names import BELOW, WHERE
from gonio.models.subsurface.catalog import BSSRDFS


def help_of(verb: str) -> str:
    return parser(verb)._subparsers._group_actions[0].choices[verb].format_help()


@pytest.mark.parametrize("verb", VERBS)
def test_every_help_ends_with_examples_that_parse(verb, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    lines = help_of(verb).splitlines()
    assert max(map(len, lines)) <= 80
    shown = [line.strip() for line in lines[lines.index("examples:") + 1 :]]
    assert shown == list(EXAMPLES[verb])
    for line in shown:
        command = line.removeprefix('eval "$(').removesuffix(')"') if "$(" in line else line
        words = shlex.split(command.partition(')"')[0].partition("|")[0].partition("&&")[0], comments=True)
        words = words[: min((words.index(w) for w in "<>" if w in words), default=None)]
        assert words[0] == "gonio" and parsed(words[1:]).verb == verb


def test_without_a_verb_the_first_steps_are_shown(capsys):
    assert main([]) == 0
    commands = [line.strip() for line in capsys.readouterr().out.splitlines() if line.startswith("  gonio")]
    assert len(commands) == 3
    for line in commands:
        words = shlex.split(line, comments=True)[1:]
        assert parsed(words).verb == words[0]


@pytest.mark.parametrize(
    ("words", "nearest"),
    [
        ("mesure gold", "'measure'"),
        ("measure gold --fotons 3 -o x.h5", "'--photons'"),
        ("fit --modle lambert", "'--model'"),
        ("check gold --jsn", "'--json'"),
        ("--versin", "'--version'"),
    ],
)
def test_what_is_misspelled_is_named_with_the_nearest(capsys, words, nearest):
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    err = capsys.readouterr().err
    assert stop.value.code == 2 and err.count("\n") == 1 and f"did you mean {nearest}?" in err


def test_quiet_says_nothing_and_keeps_the_verdict(here, capsys):
    for words, status in {
        "info t.h5 -q": 0,
        "models ggx -q": 0,
        "fit t.h5 -m lambert -q": 0,
        "info none.h5 -q": 2,
    }.items():
        assert main(words.split()) == status
        out, err = capsys.readouterr()
        assert out == "" and bool(err) == (status == 2), words


def test_names_are_known_without_loading_models():
    assert list(WHERE) == list(MODELS) and list(BELOW) == list(BSSRDFS)


@pytest.mark.parametrize(
    ("line", "completed"),
    {
        "gonio me": "measure",
        "gonio measure --pho": "--photons",
        "gonio eval gol": "gold",
        "gonio fit t.h5 -m beck": "beckmann",
        "gonio info t.": "t.h5",
        "gonio reduce --scene low": "low_sun_car",
    }.items(),
)
def test_a_shell_completes_verbs_options_names_and_files(here, line, completed):
    """As TAB asks for it: without JAX, which would take a second."""
    (here / "slow").mkdir()
    (here / "slow" / "jax.py").write_text("raise SystemExit('JAX was loaded')\n")
    tab = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "_ARGCOMPLETE_SHELL": "bash", "COMP_LINE": line}
    tab |= {"COMP_POINT": str(len(line)), "_ARGCOMPLETE_STDOUT_FILENAME": "answer", "PYTHONPATH": str(here / "slow")}
    subprocess.run([sys.executable, "-m", "gonio"], env=os.environ | tab, cwd=here, check=True, capture_output=True)
    assert (here / "answer").read_text().split() == [completed]


def test_every_shell_gets_a_script(capsys):
    for shell, word in {"bash": "complete ", "zsh": "compdef", "fish": "complete --command gonio"}.items():
        assert main(["completion", shell]) == 0
        out = capsys.readouterr().out
        assert word in out and "_ARGCOMPLETE" in out


def test_a_terminal_of_few_characters_gets_the_names_of_symbols(here):
    """A whole process in ASCII, and every symbol that gonio prints has a name."""
    assert encoding.in_ascii("θi 30° ± 1 μm, χ² ≤ 2 – Größe") == "theta_i 30 deg +- 1 um, chi^2 <= 2 - Grosse"
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "GONIO_NO_CACHE": "1"}
    command = [sys.executable, "-m", "gonio", "eval", "--help"]
    done = subprocess.run(command, capture_output=True, env=environment, cwd=here, check=True)
    assert b"reflectance_factor (pi f)" in done.stdout and done.stderr == b""


STOPPED = """
import os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background starts with it ignored
import gonio.cli.verbs.materials_verb as verb
from gonio.cli.program import command
verb.kept = lambda args: "half of it is kept: run it again to go on"
verb.run = lambda args: (os.kill(os.getpid(), int(sys.argv.pop())), time.sleep(50))
command()
"""


@pytest.mark.parametrize(("number", "word", "status"), [(2, "interrupted", 130), (15, "terminated", 143)])
def test_a_signal_ends_a_verb_with_a_line_on_what_is_kept(number, word, status):
    """Real signals to a real process, whose verb does nothing but wait for them."""
    command = [sys.executable, "-c", STOPPED.replace("sys.argv.pop()", str(number)), "materials"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == status and done.stdout == ""
    assert done.stderr == f"gonio: {word}; half of it is kept: run it again to go on.\n"


def test_a_measurement_says_what_it_keeps(here, monkeypatch, capsys):
    """Interrupted between two blocks its part is there, and the same command goes on to the same readings."""
    from gonio.instrument import reader

    monkeypatch.setattr(reader, "block_rows", lambda layout, most: 1)
    whole = reader.Reader.read
    blocks = iter([0])

    def read(self, start, stop):
        if next(blocks, None) is None:
            raise KeyboardInterrupt
        return whole(self, start, stop)

    words = ["measure", "lambert(rho=0.5)", "--step", "30", "-o", "m.h5", "--json", "m.json"]
    monkeypatch.setattr(reader.Reader, "read", read)
    assert main(words) == 130
    assert "kept in m.h5.part: run it again to go on" in capsys.readouterr().err
    assert sorted(p.name for p in here.glob("m.*")) == ["m.h5.part"]
    monkeypatch.setattr(reader.Reader, "read", whole)
    assert main(words) == 0 and "going on with m.h5.part" in capsys.readouterr().err
    assert sorted(p.name for p in here.glob("m.*")) == ["m.h5", "m.json"]
