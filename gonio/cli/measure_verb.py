"""``gonio measure``: scan a material with the simulated instrument into a table file."""

import argparse
import math
import shlex
import sys
from typing import TYPE_CHECKING, Any

from gonio.cli.arguments import MATERIAL, add_force, refuse_outputs
from gonio.models.errors import GonioError
from gonio.text import log, show

if TYPE_CHECKING:
    from gonio.data.layouts import Layout
    from gonio.instrument.instrument import Instrument, Systematic
    from gonio.models.brdf import AbstractBRDF

ANGLES = {
    "source_half_angle": "half-angle of the source's disc (default 0: a point)",
    "detector_half_angle": "half-angle of the detector's disc (default 0: a point)",
    "misalignment": "standard deviation of tilts and arm angles, one sample of each from the seed",
    "shadow": "the detector blocks the source where the arms are closer than this",
}
NUMBERS = {
    "photons": ("N", "counts expected of the perfect white diffuser at normal incidence (default: no shot noise)"),
    "ambient": ("SHARE", "light without the source, as a share of the photons"),
    "dark": ("N", "dark counts expected per reading"),
    "read_noise": ("N", "standard deviation of the reading-out, counts"),
    "noise": ("SHARE", "relative standard deviation of the source from reading to reading"),
    "calibration": ("SHARE", "relative standard deviation of the calibration factor, one sample from the seed"),
    "saturation": ("N", "counts at which the detector is full"),
    "tolerance": ("REL", "error allowed to aperture averages (default 1e-3)"),
}
SYSTEMATIC = ("tilt_x", "tilt_y", "theta_i", "theta_o", "phi")
SCANS = "isotropic, spherical, half-difference, merl, in-plane, or a CSV file of directions"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("material", metavar="MATERIAL", help=MATERIAL)
    parser.add_argument("-o", "--output", required=True, metavar="T.h5", help="the table; a killed run is continued")
    add = parser.add_argument_group("scan").add_argument
    add("--scan", metavar="SCAN", help=f"{SCANS} (default: isotropic, or spherical for an anisotropic material)")
    add("--step", type=float, metavar="DEG", help="step of the angles")
    add("--phi-step", type=float, metavar="DEG", help="step of the azimuths, where it is another")
    add("--theta-max", type=float, metavar="DEG", help="largest polar angle (default 85)")
    add("--theta-i", metavar="DEG,DEG,...", help="incidences of the in-plane scan")
    add = parser.add_argument_group("instrument (ideal by default)").add_argument
    for name, help_text in ANGLES.items():
        add(f"--{name.replace('_', '-')}", type=float, default=0.0, metavar="DEG", help=help_text)
    for name, (metavar, help_text) in NUMBERS.items():
        add(f"--{name.replace('_', '-')}", type=float, metavar=metavar, help=help_text)
    errors = f"the systematic errors themselves: {', '.join(SYSTEMATIC)} in degrees, gain as a factor"
    add("--systematic", metavar="NAME=V,...", help=errors)
    parser.add_argument("--seed", type=int, default=0, help="of the noise and the systematic errors (default 0)")
    parser.add_argument("--float32", action="store_true", help="store single precision")
    parser.add_argument("--progress", action="store_true", help="show a bar even where no terminal is")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    refuse_outputs([args.output], [args.material, args.scan], args.force)
    from gonio.data.subject import load_material
    from gonio.instrument.measurement import measure

    instrument = _instrument(args)
    material = load_material(args.material)
    measure(
        material,
        instrument,
        _scan(args, material.brdf),
        output=args.output,
        seed=args.seed,
        progress=args.progress or sys.stderr.isatty(),
        force=args.force,
        dtype="float32" if args.float32 else None,
        log=log,
        command=shlex.join(["gonio", *sys.argv[1:]]),
    )
    show(f"written: {args.output}")
    return 0


def _instrument(args: argparse.Namespace) -> "Instrument":
    from gonio.instrument.instrument import Instrument

    options: dict[str, Any] = {name: math.radians(getattr(args, name)) for name in ANGLES}
    options |= {name: getattr(args, name) for name in NUMBERS if getattr(args, name) is not None}
    if args.systematic:
        options["systematic"] = _systematic(args.systematic)
    return Instrument(**options)


def _systematic(text: str) -> "Systematic":
    from gonio.instrument.instrument import Systematic

    values: dict[str, float] = {}
    for item in text.split(","):
        name, _, value = (piece.strip() for piece in item.partition("="))
        if name not in (*SYSTEMATIC, "gain"):
            raise GonioError(f"--systematic has no {name!r}; it has {', '.join(SYSTEMATIC)} and gain")
        try:
            values[name] = float(value) if name == "gain" else math.radians(float(value))
        except ValueError:
            raise GonioError(f"--systematic has {item.strip()!r}; give NAME=NUMBER, such as tilt_x=0.1") from None
    return Systematic(**values)


def _scan(args: argparse.Namespace, brdf: "AbstractBRDF") -> "Layout":
    from gonio.instrument.scans import default_name, scan

    angles = {name: getattr(args, name) for name in ("step", "phi_step", "theta_max")}
    options: dict[str, Any] = {name: math.radians(value) for name, value in angles.items() if value is not None}
    if args.theta_i is not None:
        try:
            options["theta_i"] = [math.radians(float(t)) for t in args.theta_i.split(",")]
        except ValueError:
            raise GonioError(f"--theta-i is {args.theta_i!r}; give degrees, such as 0,30,60") from None
    return scan(args.scan or default_name(brdf), **options)
