"""What a user waits for: each verb on the usual table in a process of its own, warm, and where the time goes.

python verbs.py [--other CHECKOUT] [--runs N] [--only VERB,...] [--no-where]

The usual table is two_lobe_paint on the default scan, 23,328 cells of three channels. With another checkout (a folder
of the repository at another commit), its commands run in turn with these, by the same interpreter. Medians: wall and
processor seconds (all threads; what counts on a machine that others load), peak memory. Where the time goes is
processor time of the main thread in one more run, and beside it that of other threads (programs made ahead).
"""

import argparse
import json
import math
import os
import pathlib
import statistics
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from support.process import Run, timed

HERE = pathlib.Path(__file__).resolve()
MODEL = "lambert + ggx(eta=1.5) + ggx(eta=1.5)"
VERBS = {
    "measure": ("measure two_lobe_paint -o t.h5 --photons 1e6 --seed 1 --force", 1.2),
    "fit": (f"fit t.h5 -m '{MODEL}' -o t.fit.toml --force", 1.8),
    "check of a table": ("check t.h5", 1.5),
    "check of a model": ("check t.fit.toml", 2.0),
    "report": ("report t.h5 --fit t.fit.toml -o t.html --force", 3.5),
    "fit without a model": ("fit t.h5 -o u.fit.toml --force", 4.0),
    "demo": ("demo -o demo --force", 25.0),
}
"""A command, and the seconds that it should take."""
STATUSES = (0, 3)
"""Done, and undecided checks."""
COLUMNS = ("imports", "tracing", "lowering", "compiling", "loading", "drawing", "rest", "other threads")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--other")
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--only", default=",".join(VERBS))
    parser.add_argument("--no-where", action="store_true")
    args = parser.parse_args()
    verbs = [v for v in VERBS if v in args.only.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        sides = {"this": _laid(HERE.parents[3], folder, "this")}
        if args.other:
            sides["other"] = _laid(pathlib.Path(args.other).resolve(), folder, "other")
        for side, place in sides.items():
            for verb in VERBS:  # warm: kept programs, and the files that later verbs read
                if verb in verbs or verb in ("measure", "fit"):
                    _run(verb, place)
            print(f"{side}: warm", file=sys.stderr)
        print(f"medians of {args.runs}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
        print(f"{'':22}{'target':>8}" + "".join(f"{s + ' wall s':>15}{'CPU s':>8}{'MB':>6}" for s in sides))
        for verb in verbs:
            runs: dict[str, list[Run]] = {side: [] for side in sides}
            for _ in range(args.runs):
                for side, place in sides.items():
                    runs[side].append(_run(verb, place))
            print(f"{verb:22}{VERBS[verb][1]:8.1f}" + "".join(_medians(runs[side]) for side in sides), flush=True)
        print(f"load {os.getloadavg()[0]:.1f}")
        if not args.no_where:
            _print_where(verbs, sides)


def _laid(checkout: pathlib.Path, folder: str, side: str) -> str:
    """A folder to work in, with the four folders of a checkout as the one package that they install as."""
    package = pathlib.Path(folder, side, "path", "gonio")
    package.mkdir(parents=True)
    for part in [*(checkout / "gonio").iterdir(), *(checkout / name for name in ("models", "fitting", "data"))]:
        (package / part.name).symlink_to(part)
    return str(package.parent.parent)


def _run(verb: str, place: str, *before: str) -> Run:
    """One run; numbers are nan where the other commit fails."""
    command = ["sh", "-c", 'exec "$0" "$@" ' + VERBS[verb][0], sys.executable, *(before or ("-m", "gonio"))]
    # Compiled modules are kept, as those of an installed package are.
    done = timed(command, place, PYTHONPATH=os.path.join(place, "path"), PYTHONDONTWRITEBYTECODE="")
    if done.status not in STATUSES:
        assert pathlib.Path(place).name == "this", f"{verb}: {done.output}"
        return done._replace(wall=math.nan, cpu=math.nan, peak_mb=math.nan)
    return done


def _medians(runs: list[Run]) -> str:
    wall, cpu, peak = (statistics.median(r[k] for r in runs) for k in (1, 2, 3))
    return f"{wall:15.2f}{cpu:8.2f}{peak:6.0f}"


def _print_where(verbs: list[str], sides: dict[str, str]) -> None:
    print(f"\nCPU seconds of one run\n{'':28}" + "".join(f"{c:>14}" for c in COLUMNS) + f"{'programs':>10}{'kept':>6}")
    for verb in verbs:
        for side, place in sides.items():
            done = _run(verb, place, str(HERE.with_name("where.py")), "where.json")
            if math.isnan(done.wall):
                continue
            spent = json.loads(pathlib.Path(place, "where.json").read_text())
            row = "".join(f"{spent[c]:14.2f}" for c in COLUMNS)
            print(f"{verb:22}{side:6}{row}{spent['programs']:10.0f}{spent['kept']:6.0f}", flush=True)


if __name__ == "__main__":
    main()
