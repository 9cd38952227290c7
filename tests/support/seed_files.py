"""Small valid files of every reader: numbers made up here, in the forms that the programs and laboratories write."""

import json
import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from gonio.data import layouts
from gonio.data.table import Channels, Table, whole_table_of_values
from support import optics_files
from support.window_xml import QUARTER, document, numbers


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
    texts |= _laboratory_files() | _optics_files()
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


def _optics_files() -> dict[str, bytes | str]:
    """Files of optics programs, all with a grid of their own."""
    rng = np.random.default_rng(2)
    xyz = rng.random((3, 2, 2, 3, 3)) + 0.1
    lists = ([0, 90], [0, 30.5], [0, 90, 180], [0, 10, 60])
    words: dict[str, Any] = {"Symmetry": "PlaneSymmetrical", "ScatterType": "BTDF"}
    block = ([0, 45, 90], [0, 90, 180, 360], rng.random((3, 4)) + 0.1)
    behind = ([180, 120, 90], [0, 180], rng.random((3, 2)) + 0.1)
    spectrum = ((0, 0), [(400, 20.5), (700, 30.0)])
    rows = "".join(f"{t} {p} {0.1 + 0.001 * (t + p)}\n" for t in (-60, 0, 30) for p in (0, 90))
    viavi = "".join(f"{t} {p} 0.{t + 10}\n" for t in range(0, 90, 30) for p in range(0, 360, 90))
    return {
        "xyz.zemax.bsdf": optics_files.zemax(*lists, xyz, Symmetry="ASymmetrical4D"),
        "grey.zemax.bsdf": optics_files.zemax([0], [0, 30.5], [0, 90, 180], [0, 10, 60], xyz[:1, :1], **words),
        "two.brdf": optics_files.speos_isotropic(
            (1, 1), [0, 40], [450, 650.5], [(20, *block)] * 4 + [(5, *behind)] * 4
        ),
        "turned.anisotropicbsdf": optics_files.speos_anisotropic((1, 0), [0, 90], [0, 40], [spectrum], [block] * 4),
        "through.anisotropicbsdf": optics_files.speos_anisotropic((0, 1), [0], [0, 40], [spectrum], [behind] * 2, 0),
        "fred.txt": f"type bsdf_data\nformat angles=deg bsdf=value scale=2.5\n0 0\n{rows}45 0\n{rows}",
        "log.txt": "type bsdf_data\nformat angles=deg bsdf=log scale=1\n! remark\n10 0\n10 0 -1\n20 0 -1.5\n",
        "viavi.txt": f"!! BSDF of a sample\n!! 633 nm\n5 0\n{viavi}",
    }


def utia_file(folder: Path) -> Path:
    """A UTIA file, whose size is the format's: two megabytes, not among the small ones."""
    path = folder / "utia.bin"
    (np.random.default_rng(3).random((3, 288, 288)) + 0.1).astype("<f8").tofile(path)
    return path
