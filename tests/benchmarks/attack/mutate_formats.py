"""N mutated copies of each of these files, read in child processes: no uncaught exception, no hang, no 2 GiB.

    mutate_formats.py FILE... N [SEED]

Besides the changes of `mutate_inputs.py`: counts that are giant, line ends and encodings of other systems, lines that
are doubled or lost, numbers that are none. The files that did what they should not are kept in ./mutated. Prints the
outcomes by file, the time of the slowest read and the largest peak of memory are bounded by `mutate_inputs.py`: 10 s
and 2 GiB.
"""

import collections
import pathlib
import random
import re
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import mutate_inputs

from support import mutations

GIANT = ["999999999", "2147483648", "-1", "0", "18446744073709551616", "1e9", "4294967295", "65536", "20001", "3.5", ""]
ODD = ["nan", "NaN", "inf", "-inf", "1e999", "-1e-400", "1,5", "1e30", "--", "0x1F", "٣", "1_0"]
ENCODINGS = ["utf-16", "utf-16-le", "utf-8-sig", "utf-32", "cp500"]
HEAD = 60
"""Lines in which counts stand."""


def changed(data: bytes, rng: random.Random) -> bytes:
    """A change that text files of readings meet."""
    text, kind = data.decode("latin-1"), rng.randrange(7)
    lines = text.split("\n")
    k = rng.randrange(len(lines))
    if kind == 0:
        k = rng.randrange(min(HEAD, len(lines)))
        numbers = list(re.finditer(r"(?<![\w.])\d+(?![\w.])", lines[k])) or [re.match("", lines[k])]
        one = rng.choice(numbers)
        lines[k] = lines[k][: one.start()] + rng.choice(GIANT) + lines[k][one.end() :]
    elif kind == 1:
        words = re.split(r"(\s+)", lines[k])
        words[rng.randrange(len(words))] = rng.choice(ODD)
        lines[k] = "".join(words)
    elif kind == 2:
        lines[k:k] = [lines[k]] * rng.choice([1, 1, 2, 1000 if len(lines[k]) < 1000 else 3])
    elif kind == 3:
        del lines[k : k + rng.choice([1, 1, 5])]
    elif kind == 4:
        other = rng.randrange(len(lines))
        lines[k], lines[other] = lines[other], lines[k]
    elif kind == 5:
        return "\n".join(lines).encode(rng.choice(ENCODINGS), "replace")
    else:
        return "\n".join(lines).replace("\n", rng.choice(["\r\n", "\r", "\n\n", " \n"])).encode("latin-1", "replace")
    return "\n".join(lines).encode("latin-1", "replace")


def mutate(valid: pathlib.Path, target: pathlib.Path, rng: random.Random) -> None:
    """Writes a changed copy: by the changes of text files, or by those of all files."""
    if rng.random() < 0.4:
        mutations.mutate(valid, target, rng)
        return
    data = valid.read_bytes()
    for _ in range(rng.choice([1, 1, 2])):
        data = changed(data, rng)
    target.write_bytes(data)


def main(files: list[pathlib.Path], count: int, seed: int) -> collections.Counter:
    mutate_inputs.mutate = mutate
    outcomes: collections.Counter = collections.Counter()
    total, start = count * len(files), 0
    while start < total:
        numbers = range(start, min(start + mutate_inputs.BATCH, total))
        start = mutate_inputs.run_batch(files, numbers, seed, False, outcomes)
        print(f"{start} of {total}", file=sys.stderr, flush=True)
    return outcomes


if __name__ == "__main__":
    *names, last = sys.argv[1:]
    seed = 1
    if names and not pathlib.Path(names[-1]).exists():
        seed, last = int(last), names.pop()
    began = time.perf_counter()
    mutate_inputs.table(main([pathlib.Path(n).resolve() for n in names], int(last), seed))
    print(f"{int(last)} of each in {time.perf_counter() - began:.0f} s")
