"""``gonio measure``: scan a material with the simulated instrument into a table file."""

import argparse

ANGLES = {
    "source_half_angle": "half-angle of the source's disc (default 0: a point)",
    "detector_half_angle": "half-angle of the detector's disc (default 0: a point)",
    "misalignment": "standard deviation of tilts and arm angles, drawn once from the seed",
    "shadow": "the detector blocks the source where the arms are closer than this",
}
NUMBERS = {
    "photons": ("N", "counts expected of the perfect white diffuser at normal incidence (default: no shot noise)"),
    "ambient": ("SHARE", "light without the source, as a share of the photons"),
    "dark": ("N", "dark counts expected per reading"),
    "read_noise": ("N", "standard deviation of the reading-out, counts"),
    "noise": ("SHARE", "relative standard deviation of the source from reading to reading"),
    "calibration": ("SHARE", "relative standard deviation of the calibration factor, drawn once from the seed"),
    "saturation": ("N", "counts at which the detector is full"),
}
SYSTEMATIC = ("tilt_x", "tilt_y", "theta_i", "theta_o", "phi")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("material", metavar="MATERIAL", help="a reference material, a readable file or an expression")
    parser.add_argument("-o", "--output", required=True, metavar="T.h5", help="the table; a killed run is continued")
    scan = parser.add_argument_group("scan")
    scan.add_argument(
        "--scan",
        metavar="SCAN",
        help="isotropic, spherical, half-difference, merl, in-plane, or a CSV file of directions "
        "(default: isotropic, or spherical for an anisotropic material)",
    )
    scan.add_argument("--step", type=float, metavar="DEG", help="step of the angles")
    scan.add_argument("--phi-step", type=float, metavar="DEG", help="step of the azimuths, where it is another")
    scan.add_argument("--theta-max", type=float, metavar="DEG", help="largest polar angle (default 85)")
    scan.add_argument("--theta-i", metavar="DEG,DEG,...", help="incidences of the in-plane scan")
    tool = parser.add_argument_group("instrument (ideal by default)")
    for name, help_text in ANGLES.items():
        tool.add_argument(f"--{name.replace('_', '-')}", type=float, default=0.0, metavar="DEG", help=help_text)
    for name, (metavar, help_text) in NUMBERS.items():
        tool.add_argument(f"--{name.replace('_', '-')}", type=float, metavar=metavar, help=help_text)
    tool.add_argument(
        "--systematic",
        metavar="NAME=V,...",
        help=f"the systematic errors themselves: {', '.join(SYSTEMATIC)} in degrees, gain as a factor",
    )
    tool.add_argument(
        "--tolerance", type=float, metavar="REL", help="error allowed to aperture averages (default 1e-3)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the noise and the systematic errors (default 0)")
    parser.add_argument("--float32", action="store_true", help="store single precision")
    parser.add_argument("--progress", action="store_true", help="show a bar even where no terminal is")
    parser.add_argument("--force", action="store_true", help="replace an existing output")


def run(args: argparse.Namespace) -> int:
    import shlex
    import sys

    from gonio.data.files import refuse_existing, refuse_input
    from gonio.text import say, tell

    # Before anything is read or computed.
    refuse_existing(args.output, args.force)
    refuse_input(args.output, *(given for given in (args.material, args.scan) if given))
    from gonio.data.subject import load_material
    from gonio.instrument.measurement import measure

    instrument = instrument_of(args)
    material = load_material(args.material)
    layout = _scan_of(args, material.brdf)
    measure(
        material,
        instrument,
        layout,
        output=args.output,
        seed=args.seed,
        progress=args.progress or sys.stderr.isatty(),
        force=args.force,
        dtype="float32" if args.float32 else None,
        say=tell,
        command=shlex.join(["gonio", *sys.argv[1:]]),
    )
    say(f"written: {args.output}")
    return 0


def instrument_of(args: argparse.Namespace):
    """The instrument that the options describe."""
    import math

    from gonio.instrument.instrument import Instrument

    given = {name: math.radians(getattr(args, name)) for name in ANGLES}
    given |= {name: getattr(args, name) for name in NUMBERS if getattr(args, name) is not None}
    if args.tolerance is not None:
        given["tolerance"] = args.tolerance
    if args.systematic:
        given["systematic"] = _systematic(args.systematic)
    return Instrument(**given)


def _systematic(text: str):
    import math

    from gonio.instrument.instrument import Systematic
    from gonio.models.errors import GonioError

    values = {}
    for part in text.split(","):
        name, _, number = (piece.strip() for piece in part.partition("="))
        try:
            value = float(number)
        except ValueError:
            raise GonioError(f"--systematic has {part.strip()!r}; give NAME=NUMBER, such as tilt_x=0.1") from None
        if name not in (*SYSTEMATIC, "gain"):
            raise GonioError(f"--systematic has no {name!r}; it has {', '.join(SYSTEMATIC)} and gain")
        values[name] = value if name == "gain" else math.radians(value)
    return Systematic(**values)


def _scan_of(args: argparse.Namespace, brdf):
    import math

    from gonio.instrument.scans import default_name, scan
    from gonio.models.errors import GonioError

    options = {name: getattr(args, name) for name in ("step", "phi_step", "theta_max")}
    options = {name: math.radians(value) for name, value in options.items() if value is not None}
    if args.theta_i is not None:
        try:
            options["theta_i"] = [math.radians(float(t)) for t in args.theta_i.split(",")]
        except ValueError:
            raise GonioError(f"--theta-i is {args.theta_i!r}; give degrees, such as 0,30,60") from None
    return scan(args.scan or default_name(brdf), **options)
