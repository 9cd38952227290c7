"""N mutated files over all readers, and the verbs `info`, `check` and `fit` on a sample of those that were read.

    mutate_inputs.py [N [SEED [VERBS]]]

Each batch is a process of its own, with limits on time and memory; a batch that dies is continued behind the file that
killed it. Counts, by reader: files read, refused in a sentence, uncaught exceptions, hangs above 10 s, crashes of the
process, peaks above 2 GiB, and inputs that were changed. The files that did it are kept in ./mutated.
"""

import collections
import contextlib
import importlib
import io
import os
import pathlib
import pkgutil
import random
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

import gonio
from gonio.__main__ import main
from gonio.models.errors import GonioError
from support.mutations import mutate, read_anything
from support.seed_files import valid_files

# Nothing is computed before the forks: there are no threads to lose. Overflows are judged by what comes of them.
warnings.filterwarnings("ignore", category=RuntimeWarning)
for module in pkgutil.walk_packages(gonio.__path__, "gonio."):  # once, not in each batch
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)

BATCH, HANG, VERB_HANG = 1000, 10, 60  # files; seconds
PATIENCE = 12
"""So many times as long on the clock of a machine that others use, before a process without work is given up."""
MOST_MEMORY = 2 << 20  # KiB
VERBS = (["info"], ["check"], ["fit", "-m", "lambert + ggx", "-o", "out.toml", "--force"])
MEMORY = pathlib.Path("/dev/shm")


def read_outcome(path: pathlib.Path) -> str:
    """What came of reading one file."""
    try:
        read_anything(path)
    except GonioError as error:
        return "refused" if "\n" not in str(error) and len(str(error)) < 400 else "a long message"
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)
        own = next((f for f in reversed(where) if "gonio" in f.name or "/data/" in f.filename), where[-1])
        return f"{type(error).__name__} in {pathlib.Path(own.filename).name}:{own.lineno}: {str(error)[:80]!r}"
    return "read"


def verb_outcome(words: list[str], path: pathlib.Path) -> str:
    """Exit status of a verb, or how it ended otherwise."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main([words[0], str(path), *words[1:]])
    except SystemExit as stop:
        status = stop.code
    except BaseException as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} in {pathlib.Path(last.filename).name}:{last.lineno}: {str(error)[:80]!r}"
    if "\x1b" in out.getvalue() + err.getvalue() or max(map(len, err.getvalue().splitlines()), default=0) > 500:
        return "prints what it should not"
    return "read" if status in (0, 1, 3) else "refused" if status == 2 else f"status {status}"


def batch(files: list[pathlib.Path], numbers: range, seed: int, verbs: bool, report: int, folder: pathlib.Path) -> None:
    """Mutates and reads (or runs the verbs on) the files of these numbers; one line to `report` for each."""
    os.environ["JAX_ENABLE_X64"] = "true"
    for k in numbers:
        rng = random.Random(f"{seed}/{k}")
        valid = files[k % len(files)]
        path = folder / f"x{valid.suffix}"
        try:
            mutate(valid, path, rng)
        except Exception as error:  # a change that the library does not make: nobody's finding, and no end of the batch
            os.write(report, f"{k}\tnot made ({type(error).__name__})\t{valid.name}\n".encode())
            continue
        before = path.read_bytes()
        os.write(report, f"{k}\tbegin\t{valid.name}\n".encode())
        outcome = read_outcome(path)
        if verbs and outcome == "read" and valid.suffix != ".scene":
            for words in VERBS:
                outcome = verb_outcome(words, path)
                os.write(report, f"{k}\t{outcome}\t{words[0]} {valid.name}\n".encode())
            outcome = "read"
        if path.read_bytes() != before:
            outcome = "the input was changed"
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        if peak > MOST_MEMORY:
            outcome = f"peak {peak >> 10} MiB"
        os.write(report, f"{k}\t{outcome}\t{valid.name}\n".encode())
        if peak > MOST_MEMORY:
            return


def processor_seconds(process: int) -> float:
    """What a process has used."""
    fields = pathlib.Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run_batch(files: list[pathlib.Path], numbers: range, seed: int, verbs: bool, count: collections.Counter) -> int:
    """Runs a batch as a process; the number at which to go on."""
    folder = pathlib.Path(tempfile.mkdtemp(dir=MEMORY if MEMORY.is_dir() else None))
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(ours)
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (12 << 30, 12 << 30))
        try:
            batch(files, numbers, seed, verbs, theirs, folder)
        finally:
            os._exit(0)
    os.close(theirs)
    last, name, rest, hung, begun = numbers.start - 1, "", b"", False, False
    longest, waits, used = VERB_HANG if verbs else HANG, 0, 0.0
    while True:
        ready, _, _ = select.select([ours], [], [], longest)
        waits = 0 if ready else waits + 1
        if not ready and waits < PATIENCE and processor_seconds(child) - used < longest:
            continue
        used = processor_seconds(child)
        data = os.read(ours, 1 << 16) if ready else b""
        if not data:
            hung = not ready
            break
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            number, outcome, name = line.decode(errors="replace").split("\t")
            last, begun = int(number), outcome == "begin"
            if not begun:
                count[name, outcome] += 1
                if outcome not in ("read", "refused") and not outcome.startswith("not made"):
                    keep(files, last, seed, outcome)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(ours)
    shutil.rmtree(folder)
    if begun:
        outcome = f"hang above {longest} s" if hung else "the process died"
        count[name, outcome] += 1
        keep(files, last, seed, outcome)
    return last + 1


def keep(files: list[pathlib.Path], number: int, seed: int, outcome: str) -> None:
    """Keeps the file of a number, and says what it did."""
    valid = files[number % len(files)]
    pathlib.Path("mutated").mkdir(exist_ok=True)
    target = pathlib.Path("mutated", f"{number}{valid.suffix}")
    mutate(valid, target, random.Random(f"{seed}/{number}"))
    print(f"{target} ({valid.name}): {outcome}", flush=True)


def run(total: int, seed: int, verbs: bool) -> collections.Counter:
    """Mutates and reads so many files; outcomes by (reader, outcome)."""
    count: collections.Counter = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        files = valid_files(pathlib.Path(folder))
        start = 0
        while start < total:
            start = run_batch(files, range(start, min(start + (50 if verbs else BATCH), total)), seed, verbs, count)
            print(f"{start} of {total}", file=sys.stderr, flush=True)
    return count


def table(count: collections.Counter) -> None:
    """Prints the outcomes by reader."""
    for name in sorted({n for n, _ in count}):
        outcomes = {o: c for (n, o), c in sorted(count.items()) if n == name}
        print(f"{name:20} " + ", ".join(f"{o} {c}" for o, c in outcomes.items()))


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:]]
    total, seed, verbs = (numbers + [200_000, 1, 300][len(numbers) :])[:3]
    began = time.perf_counter()
    table(run(total, seed, False))
    print(f"{total} files in {time.perf_counter() - began:.0f} s; now the verbs on {verbs} of another seed")
    table(run(verbs, seed + 1, True))
