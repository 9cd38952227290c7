"""Small valid files of every reader, and the ways in which strangers, disks and attackers change them; seeded."""

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

from gonio.data import layouts
from gonio.data.formats.registry import load
from gonio.data.scene import read_scene
from gonio.data.table import Channels, Table, whole_table_of_values
from support.window_xml import QUARTER, document, numbers

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


def tensor_bytes(fields: dict[str, np.ndarray]) -> bytes:
    """An RGL tensor file."""
    codes = {"u1": 1, "f4": 10, "f8": 11}
    sizes = sum(2 + len(name) + 2 + 1 + 8 + 8 * a.ndim for name, a in fields.items())
    head, body, offset = b"tensor_file\0\1\0" + struct.pack("<I", len(fields)), b"", 18 + sizes
    for name, a in fields.items():
        head += (
            struct.pack("<H", len(name)) + name.encode() + struct.pack("<HBQ", a.ndim, codes[a.dtype.str[1:]], offset)
        )
        head += struct.pack(f"<{a.ndim}Q", *a.shape)
        body, offset = body + a.tobytes(), offset + a.nbytes
    return head + body


def _tables() -> dict[str, Table]:
    rng = np.random.default_rng(0)
    grid = layouts.isotropic([0.1, 0.5, 1.0], [0.1, 0.5, 1.0], np.radians([0, 90, 180, 270]))
    listed = layouts.scattered(*(rng.uniform(0, 1.4, 12) for _ in range(4)))
    plane = layouts.in_plane([0.1, 0.5], [-0.5, -0.1, 0.1, 0.5])
    value = {name: 0.1 + 0.01 * rng.random((*g.shape, 3)) for name, g in (("g", grid), ("l", listed), ("p", plane))}
    spectral, noisy = Channels.of_wavelengths([450, 550, 650]), {"u_f": np.full(value["g"].shape, 0.01)}
    about = {"source": "here", "instrument": {"photons": 1e6}, "seed": 1, "assumptions": ["none"]}
    return {
        "grid.h5": whole_table_of_values(
            grid, value["g"], name="grid", provenance=about, source_solid_angle=1e-3, **noisy
        ),
        "list.h5": whole_table_of_values(listed, value["l"], spectral, name="list"),
        "plane.h5": whole_table_of_values(plane, value["p"].astype(np.float32)),
        "half.h5": whole_table_of_values(layouts.merl(counts=(3, 3, 4)), np.ones((3, 3, 4))),
    }


def valid_files(folder: Path) -> list[Path]:
    """Writes one small valid file or more of every reader."""
    for name, table in _tables().items():
        table.save(folder / name)
    for name in ("grid.csv", "grid.json"):
        _tables()["grid.h5"].save(folder / name)
    with h5py.File(folder / "grid.h5") as plain, h5py.File(folder / "packed.h5", "w") as packed:
        packed.attrs.update(plain.attrs)
        for name in plain:
            packing = {"compression": "gzip"} if name in ("f", "u_f", "flag") else {}
            packed.create_dataset(name, data=plain[name][...], **packing)
            packed[name].attrs.update({k: v for k, v in plain[name].attrs.items() if k == "units"})
    rng, f4 = np.random.default_rng(1), np.float32
    maps = {"theta_i": np.array([0, 0.7, 1.4], f4), "phi_i": np.zeros(1, f4), "ndf": np.ones((2, 4), f4)}
    maps |= {"sigma": np.full((2, 4), 0.5, f4), "vndf": np.ones((1, 3, 4, 4), f4), "jacobian": np.ones(1, np.uint8)}
    rgb, spectra = (rng.random((1, 3, count, 3, 3)).astype(f4) for count in (3, 4))
    texts: dict[str, bytes | str] = {
        "rgb.bsdf": tensor_bytes({"description": np.frombuffer(b"made up", np.uint8), **maps, "rgb": rgb}),
        "spec.bsdf": tensor_bytes({**maps, "spectra": spectra, "wavelengths": np.linspace(400, 700, 4).astype(f4)}),
        "m.binary": struct.pack("<3i", 3, 3, 4) + rng.random(108).tobytes(),
        "list.csv": "# a comment\ntheta_i,phi_i,theta_o,phi_o,f,u_f,flag\n"
        "10,0,20,180,0.3,0.01,0\n20,0,10,180,0.3,nan,0\n",
        "spectral.csv": "theta_i;phi_i;theta_o;phi_o;f_450;f_550;f_650\n" + "10,5;0;20;90;0,1;0,2;0,3\n" * 3,
        "vectors.csv": "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,f_1,f_2\n0,0,1,0.6,0,0.8,0.1,0.2\n0.6,0,0.8,0,0,1,0.1,0.2\n",
        "nist.csv": "lambda,thetai,phi,thetar,phir,f_r11\n0.633,-30,0,30,0,0.3\n0.633,-30,0,45,0,0.29\n",
        "m.toml": 'gonio_material = 1\nname = "m"\ndescription = "d"\nchannels = ["R", "G", "B"]\n'
        'model = "lambert(rho=[0.1, 0.2, 0.3]) + 0.5 * ggx(alpha=0.2, eta=1.5)"\n[source]\ntext = "mine"\n'
        '[fit]\nconverged = true\nloss = "cbrt"\nsamples = 12\n[fit.metrics]\nrelative_rms = 0.1\n',
        "w.toml": 'gonio_material = 1\nmodel = "coat(base=lambert(rho=[0.5, 0.6]), alpha=0.1, eta=1.5)"\n'
        "wavelengths_nm = [450.0, 650.5]\n",
        "p.fit": "# fits\na = Aggregate(Lambertian(albedo = [0.1, 0.2]), NganWard(albedo = 0.2, roughness = 0.1))\n"
        "b = Bagher(albedo = 1, alpha = 0.1, p = 0.9, K = 10, eta = [0.5, 0.1], Lambda = 0.1, c = 0.1, k = 1, "
        "theta0 = 0)\n",
        "s.scene": 'gonio_scene = 1\nname = "s"\ntolerance = 0.05\nchannels = ["R"]\n[[light]]\ntheta = [60, 80]\n'
        "phi = [0, 90]\nweight = 0.8\n[[light]]\ntheta = [0, 90]\nfills = true\n[[view]]\ntheta = [0, 80]\n",
    }
    bounds = "<ThetaBounds><LowerTheta>{}</LowerTheta><UpperTheta>{}</UpperTheta></ThetaBounds>"
    ring = f"<AngleBasisBlock>{bounds}<nPhis>{{}}</nPhis></AngleBasisBlock>"
    basis = ring.format(0, 45, 1) + ring.format(45, 90, 4)
    own = f"<AngleBasis><AngleBasisName>own</AngleBasisName>{basis}</AngleBasis>"
    matrix, leaf = numbers(rng.random(25)), "{" + numbers(rng.random(8)) + "}"
    sheet = document({"Reflection Front": matrix, "Transmission Back": matrix}, more=own)
    texts["klems.xml"] = sheet.replace(QUARTER.name, "own")
    texts["tree.xml"] = document({"Transmission Front": "{" + f"{leaf} {{0.1}}" * 4 + "}"}, "TensorTree3")
    texts |= _laboratory_files()
    for name, text in texts.items():
        (folder / name).write_bytes(text.encode() if isinstance(text, str) else text)
    return sorted(folder.iterdir())


def _laboratory_files() -> dict[str, bytes | str]:
    """Files of laboratories and researchers."""
    names = ("theta_i", "phi_i", "theta_r", "phi_r")
    columns: dict[str, Any] = {n: {"unit": "deg", "values": [10 * k, 20.5, 30, 40]} for k, n in enumerate(names)}
    columns["BRDF"] = {"unit": "1/sr", "values": [0.1, -0.2, 0.3, 0.4], "uncertainty": {"value": 2, "unit": "%"}}
    columns["wavelength_i"] = {"unit": "nm", "values": [450, 450, 650, 650]}
    schema = {"metadata": {"sample": {"name": "tile"}, "type": "BRDF"}, "data": columns}
    polarised = {"polarization_i": {"notation": "inStokes", "values": [[1, 1, 0, 0], [1, -1, 0, 0]] * 2}}
    older = {"wavelengths": [400, 500.5], "theta_i": [45, 45, 15], "phi_i": [0, 0, 0], "theta_v": [20, -30, 0]}
    older |= {"phi_v": [0, 22.5, 180], "pol": ["s", "s", "p"], "data": [[0.1, 0.2, 0.3], [0.2, 0.3, 0.4]]}
    rows = [[w, t, o, p, 0.2] for w in (5e-7, 9.05e-7) for t in (0.0, 0.5) for o in (0.0, 0.7) for p in (0.0, 3.14)]
    table = {"lookupTable": rows, "receiverSolidAngles": [{"wavelength": 5e-7, "solidAngle": 1e-3}]}
    asphalt = {"metadata": {"name": "asphalt", "license": "x"}, "brdf": table}
    spherical = "PARAM_TYPE spherical_coordinate_system\nPARAM0_LIST 0 30\nPARAM2_LIST 0 40\nPARAM3_LIST 0 90 180\n"
    half = "PARAM_TYPE half_difference_coordinate_system\nREDUCTION_TYPE bilateral_symmetry reciprocity\n"
    half += "PARAM0_LIST 0 30\nPARAM2_LIST 0 40\nPARAM3_LIST 0 45 90\n"
    offsets = "PARAM_TYPE specular_coordinate_system\nPARAM0_LIST 0 30\nPARAM2_LIST 0 40\nPARAM3_LIST 0 90 180\n"
    head, twelve = "VERSION 0.3\n\nDATA_TYPE brdf\nCOLOR_MODEL {}\n", np.arange(12, dtype="<f4")
    bins = np.array([2, 2, 2, 3, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 0, 0], "<i4").tobytes() + bytes(12 * 24)
    return {
        "half.ssdd": head.format("monochrome") + half + "DATA ascii\n" + "0.25\n" * 12,
        "text.ssdd": head.format("spectrum\nWAVELENGTH_LIST 450 550.5") + offsets + "PARAM4_LIST 0 -3\nNAME a\n"
        "# gonio flags: 0*20 2*4\nDATA ascii\n" + "0.25 0.5\n" * 12,
        "binary.ssdd": (head.format("monochrome") + spherical + "DATA binary\n").encode()
        + twelve.tobytes()
        + b"\nDATA_TYPE btdf\nCOLOR_MODEL monochrome\n"
        + spherical.encode()
        + b"DATA binary\n"
        + twelve.tobytes(),
        "bins.csail": bins,
        "a.astm": "DATE today\nNUM_POINTS 3\nVARS theta_i,phi_i,theta_s,phi_s,R,G,B\n"
        + "0.1,0,0.5,3.1,0.1,-0.2,0.3\n" * 3,
        "three.astm": "VARS theta_i,theta_s,phi_s,400nm,500nm\r\n" + "0.1,0.5,3.1,0.1,0.2\r\n" * 3,
        "s.alta": "#DIM 4 1\n#PARAM_IN SPHERICAL_TL_PL_TV_PV\n#PARAM_OUT INV_STERADIAN_COSINE_FACTOR\n#VS 2\n"
        + "0.1 0 0.5 3.1 0.2 0.01 0.02\n" * 3,
        "h.alta": "#DIM 3 3\n#PARAM_IN RUSIN_TH_TD_PD\n#PARAM_OUT RGB_COLOR\n" + "0.1 0.2 0.3 0.1 0.2 0.3\n" * 3,
        "pab.dat": '#sample_name "a"\n#format: theta phi DSF\n#intheta 30\n#inphi 0\n' + "10 20.5 0.1\n120 30 0.2\n",
        "schema.json": json.dumps(schema),
        "pol.json": json.dumps({"data": columns | polarised}),
        "older.json": json.dumps({"head": {}, "data": older}),
        "a.xompt": json.dumps(asphalt),
    }


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
