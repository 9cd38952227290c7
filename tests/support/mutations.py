"""The ways in which strangers, disks and attackers change files; seeded."""

import json
import math
import random
import re
import struct
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomli_w

from gonio.data.formats.registry import load
from gonio.data.scene import read_scene

NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1",
    "0",
    "-0.0",
    "1e-320",
    "9" * 30,
    "9" * 5000,
    "1e9",
    "0x10",
    "1_000",
    "٣",
]
NUMBERS += [str(2**31), str(2**63), str(-(2**63) - 1), "1.5.5", "1,5", "true", '"x"', "[]", "{}", "[[1]]", "null", ""]
TEXTS = [
    "\x1b[2J",
    "\n",
    "\r\n",
    "\t",
    "\x00",
    "\\ud800",
    "\u202e",
    "\ufeff",
    "\x85",
    '"',
    "'",
    "[" * 40,
    "{" * 40,
    ".",
]
TEXTS += ["=", "#", ",", ";", "\\", "a.b.c", "coat(base=", "(" * 30, "é", "\x9b", "x" * 3000, "-999", "f", "theta_i"]
BYTES = [struct.pack("<d", x) for x in (np.nan, np.inf, -np.inf, 1e308, -1.0, 5e-324)]
BYTES += [struct.pack("<q", n) for n in (-1, 0, 1, 2**62, -(2**63), 2**32, 2**31, 2**16)] + [b"\xff" * 4, bytes(4)]


def read_anything(path: Path) -> object:
    """What `gonio info` would: the content of any file, and its facts."""
    if path.suffix == ".scene":
        scene = read_scene(path)
        return scene.pairs(200), scene.facts()
    content = load(f"{path}:a" if path.suffix == ".fit" else path)
    return json.dumps([content.facts(), content.channels.names])


def changed_text(text: str, rng: random.Random) -> str:
    """A text with a number, a word, a line or a mark exchanged, doubled, left out or swapped."""
    pieces = list(re.finditer(rng.choice([r"[-+.\w]+", r"[\d.]+", r"[^\n]*\n", r"\W"]), text)) or [re.match("", text)]
    one, two = rng.choice(pieces), rng.choice(pieces)
    new = rng.choice([*NUMBERS, *TEXTS, two[0], two[0] * 2, one[0] * rng.choice([2, 50]), "", one[0].upper()])
    return text[: one.start()] + new + text[one.end() :]


def changed_bytes(data: bytes, rng: random.Random) -> bytes:
    """Bytes flipped, cut, doubled, left out, moved, or replaced by numbers that nobody expects."""
    at, length = rng.randrange(len(data)), rng.choice([1, 4, 8, 64])
    kind = rng.randrange(7)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + data[at : at + length] * 2 + data[at + length :]
    if kind == 2:
        return data[:at] + data[at + length :]
    if kind == 3:
        other = rng.randrange(len(data))
        return data[:at] + data[other : other + length] + data[at + length :]
    if kind == 4:
        return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
    new = rng.choice(BYTES) if kind == 5 else rng.randbytes(length)
    return data[:at] + new + data[at + len(new) :]


def change_hdf5(path: Path, rng: random.Random) -> None:
    """One variable or attribute of an HDF5 file becomes another: values, type, shape, filter, link or nothing."""
    with h5py.File(path, "r+") as file:
        name = rng.choice(sorted(file))
        node = file[name]
        owner = rng.choice([file, node])
        attributes = sorted(set(owner.attrs) - {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"}) or ["units"]
        if rng.random() < 0.45:
            attribute = rng.choice(attributes)
            old = owner.attrs.get(attribute)
            if rng.random() < 0.4 and isinstance(old, str):
                value: object = changed_text(old, rng).replace("\0", "")
            else:
                value = rng.choice(_ODD_ATTRIBUTES)
            owner.attrs.pop(attribute, None)
            if value is not None:
                owner.attrs[attribute] = value
        elif rng.random() < 0.5 and node.dtype.kind in "fiu" and node.size:
            number = rng.choice([np.nan, np.inf, -np.inf, -1, 0, 1e308, 1e-320, 7, 255, 3.1, 6.3, 1e9])
            values = node[...]
            with np.errstate(all="ignore"):
                values.reshape(-1)[rng.randrange(values.size) :: rng.choice([1, 7, 10**6])] = np.array(number).astype(
                    node.dtype
                )
            node[...] = values
        else:
            kept, shape = dict(node.attrs.items()), node.shape
            units = {k: v for k, v in kept.items() if k == "units"}
            del file[name]
            rng.choice(_ODD_NODES)(file, name, shape)
            if name in file and isinstance(file.get(name, getlink=True), h5py.HardLink):
                file[name].attrs.update(units)


_ODD_ATTRIBUTES = [
    None,
    1,
    -1,
    0,
    2**40,
    np.nan,
    np.inf,
    1e308,
    True,
    "",
    "x" * 60_000,
    "nm",
    "degree",
    "[]",
    "{}",
    "null",
]
_ODD_ATTRIBUTES += [
    "[1, 2]",
    '["a", "a", "a"]',
    '{"source": 3, "instrument": [], "assumptions": 7}',
    '{"warnings": 5, "material": 3}',
    '["\\ud800"]',
    b"raw",
]
_ODD_ATTRIBUTES += [
    np.arange(3),
    np.array(["a", "b"], dtype=h5py.string_dtype()),
    h5py.Empty("f8"),
    np.zeros(1),
    1 + 2j,
]
_ODD_NODES: list[Callable[[h5py.File, str, tuple[int, ...]], object]] = [
    lambda file, name, shape: None,
    lambda file, name, shape: file.create_group(name),
    lambda file, name, shape: file.create_dataset(name, data=1.0),
    lambda file, name, shape: file.create_dataset(name, data=h5py.Empty("f8")),
    lambda file, name, shape: file.create_dataset(name, data=np.ones(shape, "i8")),
    lambda file, name, shape: file.create_dataset(name, data=np.ones(shape, ">f8")),
    lambda file, name, shape: file.create_dataset(name, data=np.ones(shape, "f2")),
    lambda file, name, shape: file.create_dataset(name, data=np.ones(shape, "c16")),
    lambda file, name, shape: file.create_dataset(name, data=np.ones(shape, bool)),
    lambda file, name, shape: file.create_dataset(name, data=np.full(shape, "x", object), dtype=h5py.string_dtype()),
    lambda file, name, shape: file.create_dataset(name, data=np.zeros(shape, [("a", "f8"), ("b", "i4")])),
    lambda file, name, shape: file.create_dataset(name, data=np.ones((*shape, 2))),
    lambda file, name, shape: file.create_dataset(name, data=np.ones((0, *shape[1:]))),
    lambda file, name, shape: file.create_dataset(name, shape, "f8", fillvalue=np.nan),
    lambda file, name, shape: file.create_dataset(name, (2**40, *shape[1:]), "f8", chunks=(1024, *shape[1:])),
    lambda file, name, shape: file.create_dataset(
        name, data=np.ones(shape), maxshape=(None,) * len(shape), shuffle=True
    ),
    lambda file, name, shape: file.create_dataset(name, data=np.ones(shape, "f4"), compression="lzf", fletcher32=True),
    lambda file, name, shape: file.__setitem__(name, h5py.SoftLink("/f")),
    lambda file, name, shape: file.__setitem__(name, h5py.SoftLink(f"/{name}")),
    lambda file, name, shape: file.__setitem__(name, h5py.ExternalLink("/dev/zero", "/f")),
    lambda file, name, shape: file.__setitem__(name, np.dtype("f8")),
    lambda file, name, shape: file.create_dataset(name, shape, "f8", external=[("/dev/zero", 0, h5py.h5f.UNLIMITED)]),
]


_ODD_VALUES = [None, 1, -1, 0, 2**63 - 1, 1e308, float("nan"), float("inf"), True, "", "x" * 5000, "\x1b[2J", [], {}]
_ODD_VALUES += [
    [1, "a"],
    ["a", "a", "a"],
    [[[1]]],
    {"a": {"b": 1}},
    [{}],
    [0.1] * 500,
    [math.nan] * 3,
    "lambert",
    "ggx",
]


def changed_toml(text: str, rng: random.Random) -> str:
    """One entry of a TOML text becomes another, doubled, or nothing; an unknown one may come."""
    data = tomllib.loads(text)
    places: list[tuple[Any, Any]] = [(data, "unknown")]
    for container, _ in places:
        inside = container.items() if isinstance(container, dict) else enumerate(container)
        for key, value in list(inside):
            if (container, key) not in places:
                places.append((container, key))
            if isinstance(value, dict | list) and value:
                places.append((value, next(iter(value)) if isinstance(value, dict) else 0))
        if len(places) > 200:
            break
    container, key = rng.choice(places)
    value = rng.choice(_ODD_VALUES)
    if value is None and isinstance(container, dict):
        container.pop(key, None)
    else:
        container[key] = "" if value is None else value
    return tomli_w.dumps(data)


def mutate(valid: Path, target: Path, rng: random.Random) -> None:
    """Writes a changed copy of a valid file, by one to three changes."""
    data = valid.read_bytes()
    changes = rng.choice([1, 1, 1, 2, 3])
    if valid.suffix == ".h5" and rng.random() < 0.5:
        target.write_bytes(data)
        for _ in range(changes):
            try:
                change_hdf5(target, rng)
            except (OSError, TypeError, ValueError, KeyError, RuntimeError, AttributeError):
                continue  # the library itself does not write that, or not beside the change before
        return
    if valid.suffix in (".toml", ".scene") and rng.random() < 0.5:
        target.write_text(changed_toml(data.decode(), rng), encoding="utf-8")
        return
    binary = b"\0" in data
    for _ in range(changes):
        if binary or rng.random() < 0.25:
            data = changed_bytes(data, rng) if data else data
        else:
            data = changed_text(data.decode("latin-1"), rng).encode("utf-8" if rng.random() < 0.9 else "utf-16")
    target.write_bytes(data)
