"""Outputs that cannot or must not be written, over all verbs that write; then kills of each at random moments.

    hostile_outputs.py [KILLS [SEED [0]]] [VERB ...]

Every command is a process of its own; a third 0 leaves the hostile outputs out; VERBs are keys of `VERBS` and
`FOLDERS`, all of them where none is named. Counts what came of them: written, or
refused in a sentence; and what must not be: tracebacks, statuses that are none, inputs that changed, files left behind
or half written, hangs (above 60 s of a processor, or minutes in which it used none).
"""

import collections
import contextlib
import importlib
import json
import os
import pathlib
import pkgutil
import random
import resource
import signal
import sys
import tempfile
import time
import tomllib
import warnings
from collections.abc import Callable
from xml.etree import ElementTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

import numpy as np

import gonio
from gonio.__main__ import command
from gonio.data import layouts
from gonio.data.profile_files import holds_profile
from gonio.data.table import whole_table_of_values
from support.tables import grey_table

# Nothing is computed before the forks, so there are no threads that one could lose.
warnings.filterwarnings("ignore", category=RuntimeWarning)
for module in pkgutil.walk_packages(gonio.__path__, "gonio."):  # once, not in each process
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)

HANG, WAITS = 60, 300
"""Seconds of a processor in all, and of a clock without any: other work on the machine makes no hang."""
TICK = os.sysconf("SC_CLK_TCK")
NOBODY = 65534
WITHOUT_MIRROR = [10.0, 35.0, 60.0], np.arange(2.5, 88, 5), np.arange(0, 360, 10)
"""Degrees: a grid whose energy the mirror directions would decide."""
VERBS = {
    "eval": "eval lambert(rho=0.5) --directions in/d.csv -o OUT.csv",
    "measure": "measure lambert(rho=0.5) --step 30 -o OUT.h5",
    "convert to csv": "convert in/t.h5 OUT.csv",
    "convert to h5": "convert in/c.csv OUT.h5",
    "convert to merl": "convert in/t.h5 OUT.binary",
    "fit": "fit in/t.h5 -m lambert -o OUT.toml",
    "fit json": "fit in/t.h5 -m lambert -o fit.toml --json OUT.json",
    "check json": "check in/t.h5 --json OUT.json",
    "check repair": "check in/t.h5 --repair OUT.h5",
    "reduce": "reduce in/t.h5 --scene in/s.toml -o OUT.h5",
    "report": "report in/t.h5 -o OUT.html --no-check",
    "models": "models lambert --picture OUT.svg",
    "convert to zemax": "convert in/t.h5 OUT.bsdf --to zemax --step 30",
    "convert to speos": "convert in/t.h5 OUT.brdf",
    "convert to klems": "convert lambert(rho=0.5) OUT.xml --basis quarter",
    "convert to ssdd": "convert in/t.h5 OUT.ssdd",
    "convert to bird": "convert in/t.h5 OUT.json",
    "convert to astm": "convert in/t.h5 OUT.astm",
    "convert to utia": "convert in/t.h5 OUT.bin",
    "to mitsuba": "convert lambert(rho=0.5) OUT.xml --to mitsuba",
    "to pbrt": "convert lambert(rho=0.5) OUT.pbrt --to pbrt",
    "to gltf": "convert lambert(rho=0.5) OUT.gltf --to gltf",
    "to blender": "convert lambert(rho=0.5) OUT.py --to blender",
    "quantities json": "quantities in/t.h5 --json OUT.json",
    "measure adaptive": "measure lambert(rho=0.5) --adaptive --budget 10min -o OUT.h5",
    "plan": "plan in/t.h5 -m lambert --budget 10min -o OUT.csv",
    "plan energy": "plan in/e.h5 --for energy -m lambert -o OUT.csv",
    "to materialx": "convert lambert(rho=0.5) OUT.mtlx --to materialx",
    "to radiance": "convert lambert(rho=0.5) OUT.xml --to radiance",
    "report render": "report lambert(rho=0.5) -o OUT.html --no-check --render",
    "measure profile": "measure marble --scan offsets -o OUT.h5",
    "fit profile": "fit in/p.csv -m dipole(eta=1.5) -o OUT.toml",
    "quantities of a profile": "quantities in/p.csv --json OUT.json",
    "measure rgl": "measure lambert(rho=0.5) --scan rgl -o OUT.h5",
}
"""By what they write; the inputs lie in the folder in/, OUT stands for the output without its ending."""
FOLDERS = {
    "fit a folder": "fit in/t.h5 in/c.csv -m lambert -o OUT",
    "demo": "demo -o OUT",
    "chart": "chart evaluation --quick -o OUT",
    "stress": "stress ggx -o OUT",
    "campaign": "campaign in/r.toml --workers 0 -o OUT",
}
"""Those that fill a folder; they are not killed here (campaign/kills.py, data/kill_measure.py)."""
RECIPE = """gonio_campaign = 1
[[measure]]
materials = ["lambert(rho=0.5)"]
scans = [{step = 30}]
fit = ["lambert"]
"""
SCENE = "gonio_scene = 1\ntolerance = 0.2\n[[light]]\ntheta = 30\n[[view]]\ntheta = [0, 80]\n"


def inputs(folder: pathlib.Path) -> None:
    """The inputs of all commands."""
    (folder / "in").mkdir()
    grey_table(0.3, 20.0, 60.0).save(folder / "in/t.h5")
    grey_table(0.3, 30.0, 90.0).save(folder / "in/c.csv")
    gaps = layouts.isotropic(*(np.radians(degrees) for degrees in WITHOUT_MIRROR))
    whole_table_of_values(gaps, np.full(gaps.shape, 0.1)).save(folder / "in/e.h5")
    (folder / "in/d.csv").write_text("theta_i,phi_i,theta_o,phi_o\n10,0,20,0\n")
    (folder / "in/s.toml").write_text(SCENE)
    (folder / "in/r.toml").write_text(RECIPE)
    (folder / "in/p.csv").write_text("offset_mm,R\n" + "".join(f"{r},{0.1 / (r + r**3)}\n" for r in (0.5, 1, 2, 4)))


Setup = Callable[[pathlib.Path, str], str]
"""Prepares a folder for an output of this ending; returns the output's name."""


def _made(path: pathlib.Path, make: Callable[[pathlib.Path], object], name: str = "") -> str:
    make(path)
    return name or path.name


KINDS: dict[str, Setup] = {
    "nothing in the way": lambda d, s: f"x{s}",
    "it exists": lambda d, s: _made(d / f"x{s}", lambda p: p.write_text("kept")),
    "a link to an input": lambda d, s: _made(d / f"x{s}", lambda p: p.symlink_to(d / "in/t.h5")),
    "a hard link of an input": lambda d, s: _made(d / f"x{s}", lambda p: p.hardlink_to(d / "in/t.h5")),
    "a dangling link": lambda d, s: _made(d / f"x{s}", lambda p: p.symlink_to(d / "nowhere/x")),
    "a link to itself": lambda d, s: _made(d / f"x{s}", lambda p: p.symlink_to(p)),
    "a folder": lambda d, s: _made(d / f"x{s}", lambda p: p.mkdir()),
    "a pipe": lambda d, s: _made(d / f"x{s}", os.mkfifo),
    "a device": lambda d, s: "/dev/full",
    "a link to a device": lambda d, s: _made(d / f"x{s}", lambda p: p.symlink_to("/dev/full")),
    "no such folder": lambda d, s: f"none/x{s}",
    "a file for a folder": lambda d, s: f"in/d.csv/x{s}",
    "a name too long": lambda d, s: "x" * 300 + s,
    "the longest name": lambda d, s: "x" * (250 - len(s)) + s,
    "a strange name": lambda d, s: f"x\n\x1b[2J\udcff{s}",
    "an empty name": lambda d, s: "",
    "the folder itself": lambda d, s: ".",
    "a folder that is only read": lambda d, s: _made(d / "locked", lambda p: p.mkdir(0o555), f"locked/x{s}"),
    "a disk that is full at once": lambda d, s: f"x{s}",
    "a disk that is full after 100 bytes": lambda d, s: f"x{s}",
    "a disk that is full after 4000 bytes": lambda d, s: f"x{s}",
    "a disk that is full after 40000 bytes": lambda d, s: f"x{s}",
    "a stranger's unfinished file": lambda d, s: _made(d / f"x{s}.part", lambda p: p.write_text("kept"), f"x{s}"),
    "a link for an unfinished file": lambda d, s: _made(d / f"x{s}.part", lambda p: p.symlink_to("in/t.h5"), f"x{s}"),
}
LIMITS = {"at once": 0, "100 bytes": 100, "4000 bytes": 4000, "40000 bytes": 40_000}
GOOD = {
    ".toml": lambda p: tomllib.loads(p.read_text()), ".json": lambda p: json.loads(p.read_text()),
    ".h5": lambda p: gonio.open_profile(p) if holds_profile(p) else gonio.open(p), ".binary": gonio.open,
    ".csv": lambda p: p.read_text().index("theta_i"),
    ".html": lambda p: p.read_text().index("</html>"), ".svg": lambda p: p.read_text().index("</svg>"),
    **dict.fromkeys((".bsdf", ".brdf", ".ssdd", ".astm", ".bin"), gonio.open),
    **dict.fromkeys((".xml", ".mtlx"), lambda p: ElementTree.fromstring(p.read_bytes())),
    ".gltf": lambda p: json.loads(p.read_text()), ".py": lambda p: compile(p.read_text(), str(p), "exec"),
    ".pbrt": lambda p: p.read_text().index("WorldBegin"),
}  # fmt: skip


def started(
    words: list[str], folder: pathlib.Path, errors: int | None = None, limit: int | None = None, user: int | None = None
) -> int:
    """A process that runs one command in a folder; its errors go to the pipe `errors`."""
    child = os.fork()
    if child:
        return child
    try:
        os.chdir(folder)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(os.open(os.devnull, os.O_WRONLY) if errors is None else errors, 2)
        sys.stdout, sys.stderr = (os.fdopen(k, "w", encoding="utf-8", errors="strict") for k in (1, 2))
        if user is not None:
            os.setuid(user)
        if limit is not None:
            os.environ["GONIO_NO_CACHE"] = "1"
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        sys.argv = ["gonio", *words]
        command()
    except SystemExit as stop:
        sys.stderr.flush()
        os._exit(stop.code if isinstance(stop.code, int) else 1)
    except BaseException:
        os._exit(99)
    os._exit(98)


def status_of(child: int) -> int | str:
    """Exit status of a process, waited for."""
    used, since = 0.0, time.monotonic()
    while used < HANG and time.monotonic() < since + WAITS:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
        if (now := _processor_seconds(child)) > used:
            used, since = now, time.monotonic()
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "a hang"


def _processor_seconds(child: int) -> float:
    """What a process has used so far, by Linux's own count."""
    try:
        words = pathlib.Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(words[11]) + int(words[12])) / TICK


def contents(folder: pathlib.Path) -> dict[str, bytes | str]:
    """Everything in a folder by name: bytes of files, what links point at."""
    every = {}
    for path in sorted(folder.rglob("*")):
        link, file = path.is_symlink(), path.is_file()
        every[str(path.relative_to(folder))] = os.readlink(path) if link else path.read_bytes() if file else "no file"
    return every


def outcome(words: list[str], folder: pathlib.Path, output: str, **limits: int | None) -> str:
    """Runs a command; 'written', 'refused', or what must not be."""
    before = contents(folder)
    ours, theirs = os.pipe()
    status = status_of(started(words, folder, errors=theirs, **limits))
    os.close(theirs)
    with os.fdopen(ours, errors="replace") as pipe:
        after, error = contents(folder), pipe.read()
    if status not in (0, 1, 2, 3) or "Traceback" in error or "fault of gonio" in error:
        return f"WRONG: status {status}, {error[-300:]!r}"
    changed = [n for n in before if n.startswith("in") and before[n] != after.get(n)]
    if changed:
        return f"WRONG: changed {changed}"
    if status == 2:
        lost, new = [n for n in before if before[n] != after.get(n)], [n for n in after if n not in before]
        if lost or new:
            return f"WRONG: refused, but lost {lost} and left {new}: {error!r}"
        last = (error.splitlines() or [""])[-1]  # behind what a long command logs
        return "refused" if last.startswith("gonio: ") and len(last) < 450 else f"WRONG: a message {error[:300]!r}"
    if any(".tmp" in n for n in after):
        return f"WRONG: left {sorted(after)}"
    try:
        GOOD[pathlib.Path(output).suffix](folder / output)
    except (KeyError, IsADirectoryError):
        pass
    except (OSError, ValueError) as bad:
        return f"WRONG: half a file: {bad}"
    return "written"


def hostile(verbs: dict[str, str], folders: dict[str, str], count: collections.Counter) -> None:
    """Every kind of output for every verb, with --force and without."""
    for verb, line in verbs.items():
        suffix = next(pathlib.Path(w).suffix for w in line.split() if w.startswith("OUT"))
        given = next((w for w in line.split() if w.startswith("in/")), None)
        own = {} if given is None else {"an input": lambda d, s, given=given: given}
        for kind, setup in {**KINDS, **own}.items():
            for force in ([], ["--force"]) if not kind.startswith("a disk") else ([],):
                with tempfile.TemporaryDirectory() as name:
                    folder = pathlib.Path(name, "w")
                    folder.mkdir()
                    pathlib.Path(name).chmod(0o777)
                    inputs(folder)
                    output = setup(folder, suffix)
                    words = [output if w.startswith("OUT") else w for w in line.split()] + force
                    limit = next((n for words_, n in LIMITS.items() if words_ in kind), None)
                    user = NOBODY if kind.endswith("only read") and os.getuid() == 0 else None
                    tell(
                        count,
                        f"{verb}{' --force' if force else ''}",
                        kind,
                        outcome(words, folder, output, limit=limit, user=user),
                    )
    for verb, line in folders.items():
        for kind in ("it exists", "a link to an input", "a pipe", "a file for a folder", "a name too long", "a device"):
            with tempfile.TemporaryDirectory() as name:
                folder = pathlib.Path(name, "w")
                folder.mkdir()
                inputs(folder)
                output = KINDS[kind](folder, "")
                words = [output if w == "OUT" else w for w in line.split()]
                tell(count, verb, kind, outcome(words, folder, output))


def tell(count: collections.Counter, verb: str, kind: str, result: str) -> None:
    """Counts an outcome, and prints what must not be."""
    count[verb, result.split(":")[0]] += 1
    if result.startswith("WRONG"):
        print(f"{verb}, {kind}: {result}", flush=True)


def kills(verbs: dict[str, str], number: int, seed: int, count: collections.Counter) -> None:
    """Kills each verb `number` times: inputs and what was kept stay, the output is whole or not there."""
    rng = random.Random(seed)
    for verb, line in verbs.items():
        suffix = next(pathlib.Path(w).suffix for w in line.split() if w.startswith("OUT"))
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name, "w")
            folder.mkdir()
            inputs(folder)
            output = folder / f"x{suffix}"
            words = [output.name if w.startswith("OUT") else w for w in line.split()] + ["--force"]
            began = time.monotonic()
            status_of(started(words, folder))
            whole, first = time.monotonic() - began, contents(folder)
            for _ in range(number):
                old = rng.random() < 0.5
                if not old:
                    output.unlink(missing_ok=True)
                elif not output.exists():
                    output.write_bytes(first[output.name])
                child = started(words, folder)
                time.sleep(rng.uniform(0.0, 1.05) * whole)
                with contextlib.suppress(ProcessLookupError):
                    os.kill(child, signal.SIGKILL)
                killed = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) < 0
                tell(count, f"{verb}, killed", "", _after_kill(folder, output, first, old, killed))


def _after_kill(folder: pathlib.Path, output: pathlib.Path, first: dict, old: bool, killed: bool) -> str:
    after = contents(folder)
    result = "killed" if killed else "finished before"
    if any(first[n] != after.get(n) for n in first if n.startswith("in/")):
        return "WRONG: an input changed"
    if old and not output.exists():
        return "WRONG: what was kept is lost"
    if output.exists():
        try:
            GOOD[output.suffix](output)
        except (OSError, ValueError) as bad:
            return f"WRONG: half a file: {bad}"
    for path in folder.glob(".*.tmp"):  # hidden, and of no name that anybody reads
        path.unlink()
        result = "killed, a hidden temporary file left"
    return result


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    number, seed, outputs = (numbers + [50, 1, 1][len(numbers) :])[:3]
    names = [word for word in sys.argv[1:] if not word.isdigit()]
    verbs, folders = ({n: line for n, line in every.items() if n in names or not names} for every in (VERBS, FOLDERS))
    outcomes: collections.Counter = collections.Counter()
    began = time.perf_counter()
    if outputs:
        hostile(verbs, folders, outcomes)
    print(f"{sum(outcomes.values())} hostile outputs in {time.perf_counter() - began:.0f} s", flush=True)
    kills(verbs, number, seed, outcomes)
    for verb in sorted({v for v, _ in outcomes}):
        print(f"{verb:28} " + ", ".join(f"{o} {c}" for (v, o), c in sorted(outcomes.items()) if v == verb))
    wrong = sum(c for (_, o), c in outcomes.items() if o == "WRONG")
    print(f"{sum(outcomes.values())} commands in {time.perf_counter() - began:.0f} s, {wrong} wrong")
    raise SystemExit(wrong > 0)
