"""N mutated files for each reader, read in child processes: no uncaught exception, no hang, no 2 GiB.

    mutate_formats.py [N [SEED]] [READER | FILE ...]

Mutates the small files of `support.seed_files` by their readers, all or those named (as `gonio info` names formats),
and FILEs as readers of their own. Besides the changes of `mutate_inputs.py`: counts that are giant, encodings and line
ends of other systems, lines and blocks that are doubled, moved or lost, deep nesting, entries of JSON that are others,
numbers that are none, and words of binary files exchanged in place. Files that did what they should not are kept in
./mutated. Prints the outcomes by file; a read is bounded by `mutate_inputs.py`: 10 s and 2 GiB.
"""

import collections
import json
import pathlib
import random
import re
import struct
import sys
import tempfile
import time
from typing import Any

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import mutate_inputs

from gonio.data.formats.registry import sniff
from support import mutations, seed_files

GIANT = ["999999999", "2147483648", "-1", "0", "18446744073709551616", "1e9", "4294967295", "65536", "20001", "3.5", ""]
ODD = ["nan", "NaN", "inf", "-inf", "1e400", "-1e400", "-1e-400", "1,5", "1e30", "--", "0x1F", "٣", "1_0", "7" * 400]
ENCODINGS = ["utf-16", "utf-16-le", "utf-8-sig", "utf-32", "cp500"]
OPENINGS = [("[", "]"), ("{", "}"), ('{"a":', "}"), ("<a>", "</a>"), ("(", ")")]
DEPTHS = [3, 100, 1100, 100_000]
HEAD = 60
"""Lines in which counts stand."""
LARGEST = 1 << 20
"""Bytes that a text may grow to."""
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
WORDS = [struct.pack("<d", x) for x in (float("nan"), float("inf"), -1.0, 1e308, 5e-324, -1e30)]
WORDS += [struct.pack("<f", x) for x in (float("nan"), float("-inf"), -1.0, 1e38)]
WORDS += [struct.pack("<i", n) for n in (-1, 0, 1, 2**31 - 1, -(2**31), 65536)]


def giant_count(lines: list[str], rng: random.Random) -> None:
    """A whole number of the header becomes another."""
    k = rng.randrange(min(HEAD, len(lines)))
    one = rng.choice(list(re.finditer(r"(?<![\w.])\d+(?![\w.])", lines[k])) or [re.match("", lines[k])])
    lines[k] = lines[k][: one.start()] + rng.choice(GIANT) + lines[k][one.end() :]


def odd_number(lines: list[str], rng: random.Random) -> None:
    """A word becomes a number that is none, or is too large."""
    k = rng.randrange(len(lines))
    words = re.split(r"([\s,;]+)", lines[k])
    words[rng.randrange(len(words))] = rng.choice(ODD)
    lines[k] = "".join(words)


def swapped_numbers(lines: list[str], rng: random.Random) -> None:
    """Two numbers of the file change places."""
    text = "\n".join(lines)
    there = list(NUMBER.finditer(text))
    if len(there) > 1:
        one, two = sorted(rng.sample(there, 2), key=lambda match: match.start())
        text = text[: one.start()] + two[0] + text[one.end() : two.start()] + one[0] + text[two.end() :]
        lines[:] = text.split("\n")


def doubled_lines(lines: list[str], rng: random.Random) -> None:
    """A line is there more often."""
    k = rng.randrange(len(lines))
    lines[k:k] = [lines[k]] * rng.choice([1, 1, 2, 1000 if len(lines[k]) < 1000 else 3])


def moved_block(lines: list[str], rng: random.Random) -> None:
    """A block of lines is there again elsewhere, or many times."""
    start, stop = sorted(rng.randrange(len(lines) + 1) for _ in range(2))
    place = rng.randrange(len(lines) + 1)
    lines[place:place] = lines[start:stop] * (rng.choice([1, 1, 2, 50]) if stop - start < 200 else 1)


def lost_lines(lines: list[str], rng: random.Random) -> None:
    """Lines are lost."""
    k = rng.randrange(len(lines))
    del lines[k : k + rng.choice([1, 1, 5])]


def cut_off(lines: list[str], rng: random.Random) -> None:
    """The file ends in the middle of a word."""
    text = "\n".join(lines)
    lines[:] = text[: rng.randrange(len(text) + 1)].split("\n")


def exchanged_lines(lines: list[str], rng: random.Random) -> None:
    """Two lines change places."""
    one, two = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[one], lines[two] = lines[two], lines[one]


def nested(lines: list[str], rng: random.Random) -> None:
    """A word becomes brackets within brackets, or one word of great length."""
    k = rng.randrange(len(lines))
    words = re.split(r"([\s,;:]+)", lines[k])
    place, depth = rng.randrange(len(words)), rng.choice(DEPTHS)
    start, stop = rng.choice(OPENINGS)
    words[place] = rng.choice([start * depth + words[place] + stop * depth, start * depth, words[place] * depth])
    lines[k] = "".join(words)


LINE_CHANGES = (
    giant_count, odd_number, swapped_numbers, doubled_lines, moved_block, lost_lines, cut_off, exchanged_lines, nested
)  # fmt: skip


def changed_json(data: bytes, rng: random.Random) -> bytes:
    """One entry of a JSON text becomes another, is lost, longer or shorter."""
    tree: Any = json.loads(data)
    places: list[tuple[Any, Any]] = []
    stack: list[Any] = [tree]
    while stack:
        node = stack.pop()
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            places.append((node, key))
            if isinstance(value, dict | list):
                stack.append(value)
    node, key = rng.choice(places)
    value, kind = node[key], rng.randrange(6)
    if kind == 0:
        del node[key]
    elif kind == 1 and isinstance(value, list):
        node[key] = value[: rng.randrange(len(value) + 1)] * rng.choice([1, 3])
    elif kind == 2 and isinstance(node, dict):
        node[rng.choice(["values", "unit", "BRDF", "theta_i", "data", "x" * 3000])] = node.pop(key)
    elif kind == 3:
        other, place = rng.choice(places)
        node[key] = json.loads(json.dumps(other[place])) if place in other or isinstance(other, list) else None
    else:
        odd = [
            None,
            1,
            -1,
            2**70,
            1e308,
            float("nan"),
            True,
            "",
            "1,5",
            "x" * 5000,
            "\x1b[2J",
            [],
            {},
            [[1]],
            [0] * 500,
        ]
        node[key] = rng.choice(odd)
    return json.dumps(tree).replace("Infinity", rng.choice(["Infinity", "1e400"])).encode()


def changed_words(data: bytes, rng: random.Random) -> bytes:
    """Numbers of a binary file exchanged in place: its size stays."""
    result, word = bytearray(data), rng.choice(WORDS)
    size = len(word)
    for _ in range(rng.choice([1, 1, 3, 300])):
        at = rng.randrange(max(len(data) // size, 1)) * size
        if rng.random() < 0.3:
            at = min(at, 15 * size)  # where headers are
        result[at : at + size] = word[: len(result) - at]
    if rng.random() < 0.1:
        result[:] = (word * (len(data) // size + 1))[: len(data)]
    return bytes(result)


def changed_text(data: bytes, rng: random.Random) -> bytes:
    """A change that text files of readings meet."""
    text, kind = data.decode("latin-1"), rng.random()
    if kind < 0.06:
        return text.encode(rng.choice(ENCODINGS), "replace")
    if kind < 0.12:
        return text.replace("\n", rng.choice(["\r\n", "\r", "\n\n", " \n"])).encode("latin-1", "replace")
    lines = text.split("\n")
    rng.choice(LINE_CHANGES)(lines, rng)
    return "\n".join(lines).encode("utf-8" if rng.random() < 0.5 else "latin-1", "replace")


def mutate(valid: pathlib.Path, target: pathlib.Path, rng: random.Random) -> None:
    """Writes a changed copy: by the changes of such files, or by those of all files."""
    data = valid.read_bytes()
    binary = b"\0" in data
    if rng.random() < (0.2 if len(data) > 1 << 20 else 0.4) or valid.suffix == ".h5":
        mutations.mutate(valid, target, rng)
        return
    if data.startswith(b"{") and rng.random() < 0.5:
        target.write_bytes(changed_json(data, rng))
        return
    for _ in range(rng.choice([1, 1, 2])):
        data = (changed_words(data, rng) if binary else changed_text(data, rng))[: max(len(data), LARGEST)]
    target.write_bytes(data)


def by_reader(folder: pathlib.Path, names: list[str]) -> dict[str, list[pathlib.Path]]:
    """The files to change, by the reader's name; FILEs under their own."""
    files: dict[str, list[pathlib.Path]] = {}
    for path in [*seed_files.valid_files(folder), seed_files.utia_file(folder)]:
        if path.suffix != ".scene":
            files.setdefault(sniff(path).name, []).append(path)
    known = {name.casefold(): name for name in files}
    chosen = {known[n.casefold()]: files[known[n.casefold()]] for n in names if n.casefold() in known}
    chosen |= {n: [pathlib.Path(n).resolve(strict=True)] for n in names if n.casefold() not in known}
    return chosen if names else files


def main(words: list[str]) -> None:
    numbers = [int(word) for word in words if word.isdigit()]
    count, seed = (numbers + [20_000, 1][len(numbers) :])[:2]
    mutate_inputs.mutate = mutate
    with tempfile.TemporaryDirectory() as folder:
        for name, files in by_reader(pathlib.Path(folder), [w for w in words if not w.isdigit()]).items():
            began, start = time.perf_counter(), 0
            outcomes: collections.Counter = collections.Counter()
            while start < count:
                numbers = range(start, min(start + mutate_inputs.BATCH, count))
                start = mutate_inputs.run_batch(files, numbers, seed, False, outcomes)
            print(f"{name}: {count} files in {time.perf_counter() - began:.0f} s", flush=True)
            mutate_inputs.table(outcomes)


if __name__ == "__main__":
    main(sys.argv[1:])
