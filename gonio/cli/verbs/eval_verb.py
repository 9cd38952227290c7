"""``gonio eval``: values of a material at any directions, typed at the prompt or listed in a file."""

import argparse
import io
import itertools
import math
import shutil
import sys
from typing import TYPE_CHECKING, Any, NamedTuple

from gonio.cli.arguments import (
    FORCE,
    MATERIAL,
    READING,
    Options,
    add_options,
    as_stated,
    write_text,
    writing_json,
)
from gonio.models.errors import GonioError
from gonio.text import columns as aligned
from gonio.text import number, show

if TYPE_CHECKING:
    import numpy as np

    from gonio.data.channels import Channels
    from gonio.data.subject import Subject
    from gonio.data.table import Table
    from gonio.models.geometry.directions import Direction

ANGLES = ("theta_i", "phi_i", "theta_o", "phi_o", "delta_phi")
MOST_VALUES = 100_000
"""Numbers of one option."""
Columns = dict[str, "np.ndarray"]
CELL = 12
"""Columns of a terminal that a value takes."""
MOST_ROWS = 10_000_000
OPTIONS: Options = {
    "--directions DIRS.csv": "columns theta_i,phi_i,theta_o,phi_o in degrees, or wi_x,wi_y,wi_z,wo_x,wo_y,wo_z; '-' is "
    "standard input",
    "--theta-i ANGLES": "polar angles of the light, degrees: one, several (0,30,60), or start:stop:step with stop; "
    "all angles that are given are combined (default 0)",
    "--theta-o ANGLES": "polar angles of the detector; without --phi-o and --delta-phi in the plane of incidence, "
    "positive on the mirror side, negative on the light's side (default 0)",
    "--phi-i ANGLES": "azimuths of the light (default 0)",
    "--phi-o ANGLES": "azimuths of the detector",
    "--delta-phi ANGLES": "or what they are beyond those of the light: 180 is the mirror side",
    "--values-only": "f alone, without its standard uncertainty, which takes longer",
    "-o/--output OUT.csv": "'-': standard output (default: there, as a table to read at a terminal)",
}


class Listed(NamedTuple):
    """Directions, and the columns of numbers that name them in the output."""

    wi: "Direction"
    wo: "Direction"
    columns: "dict[str, np.ndarray]"
    typed: "dict[str, np.ndarray] | None" = None
    """The angles as they were typed, where they were: to be read beside the values."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Values of f, in 1/sr without the cosine, of a material at any directions. Those of a table are interpolated "
        "between its readings; where there are none about a direction its row says so (flag 4). Tables and fits have "
        "the standard uncertainty u_f beside f: by the readings' own, and by what may lie between them; of a fit by "
        "the covariance of its numbers."
    )
    parser.add_argument("material", metavar="MATERIAL", help=MATERIAL)
    add_options(parser.add_argument, OPTIONS | READING | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.files import refuse_outputs

    refuse_outputs([args.output], [args.directions, args.material], args.force)
    import numpy as np

    from gonio.data.formats.registry import is_there, sniff
    from gonio.data.subject import resolve_subject
    from gonio.fitting.material_warnings import material_warnings
    from gonio.models.evaluation import evaluate

    listed = _directions(args)
    if not (is_there(args.material) and "angles" in sniff(args.material).options):
        args.angles = None  # they are the directions' own
    subject = resolve_subject(as_stated(args.material, args))
    material = subject.as_material()
    f = np.asarray(evaluate(material.brdf, listed.wi, listed.wo)).reshape(listed.wi.z.size, -1)
    facts: dict[str, Any] = {"material": material.name, "channels": material.channels.names, "unit": "1/sr"}
    facts |= {"wavelengths_nm": material.channels.wavelengths_nm, **_angles_deg(listed), "f": f}
    flag, u_f = np.zeros(0, np.uint8), np.zeros((0, f.shape[1]))
    if subject.table is not None:
        flag = _not_read(subject.table, listed)
        facts["flag"] = flag
    remarks = material_warnings(material) if subject.table is None else []
    if not args.values_only and (subject.table is not None or "fit" in material.meta):
        u_f, further = _uncertainty(subject, listed)
        remarks += further
        facts |= {"u_f": u_f} if u_f.size else {}
    with writing_json(args, facts):
        _write(args, listed, f, u_f, material.channels, flag)
    for line in [*_remarks(flag, u_f, material.name), *remarks]:
        print(f"gonio: {line}.", file=sys.stderr)
    return 0


def _uncertainty(subject: "Subject", listed: Listed) -> "tuple[np.ndarray, list[str]]":
    """The standard uncertainty (n, C) of f of a table or a fit, (0, C) where a fit keeps none, and remarks on it."""
    import numpy as np

    from gonio.fitting.material_warnings import fit_warnings
    from gonio.metrology.values.standard_uncertainty import states_uncertainties, uncertainty_of_values

    material = subject.as_material()
    try:
        u_f = uncertainty_of_values(subject, listed.wi, listed.wo)
    except GonioError as error:
        if subject.table is not None:
            raise
        return np.zeros((0, len(material.channels))), [f"{error}: f has no uncertainty beside it"]
    if subject.table is None:
        of_numbers = "u_f is what the uncertainties of its numbers make of f, and no bound of how far off the fit is"
        return u_f, [of_numbers] if fit_warnings(material) else []
    unstated = (
        f"not all readings of {material.name} state their own uncertainty: u_f is of what lies between them alone"
    )
    return u_f, [] if states_uncertainties(subject.table) else [unstated]


def _not_read(table: "Table", listed: Listed) -> "np.ndarray":
    """Of each pair of directions the flag `NOT_MEASURED` where a table has no readings about it, else `VALID`."""
    import numpy as np

    from gonio.data.flags import Flag
    from gonio.data.interpolation.coverage import covered

    known = covered(table, listed.wi, listed.wo)
    return np.where(known, Flag.VALID, Flag.NOT_MEASURED).astype(np.uint8)


def _remarks(flag: "np.ndarray", u_f: "np.ndarray", name: str) -> list[str]:
    """What is to be said of directions that were not read, and of values that nothing bounds."""
    import numpy as np

    remarks: list[str] = []
    beyond = int(np.count_nonzero(flag))
    if beyond:
        what = "directions are" if flag.size > 1 else "direction is"
        remarks.append(
            f"{beyond:,} of {flag.size:,} {what} beyond what was read of {name}, or in a gap of it: f is "
            "continued there from the nearest readings, without any bound (flag 4); a model may know it: gonio fit"
        )
    unknown = np.isnan(u_f).any(axis=1)
    if flag.size and unknown.size:
        unknown &= flag == 0
    if open_ended := int(np.count_nonzero(unknown)):
        what = "directions have" if len(u_f) > 1 else "direction has"
        why = (
            "a lobe may hide between its readings, its format has a rule of its own, or a reading is there without u_f"
        )
        why = why if flag.size else "a number of the fit is not determined"
        remarks.append(f"{open_ended:,} of {len(u_f):,} {what} a value that nothing bounds (u_f is NaN): {why}")
    return remarks


def _write(
    args: argparse.Namespace,
    listed: Listed,
    f: "np.ndarray",
    u_f: "np.ndarray",
    channels: "Channels",
    flag: "np.ndarray",
) -> None:
    from gonio.data.formats.csv.columns import write_columns
    from gonio.data.formats.csv.header import channel_comments, value_names

    beside = dict(zip(value_names(channels, "u_f"), u_f.T, strict=True)) if u_f.size else {}
    values = dict(zip(value_names(channels), f.T, strict=True))
    flags = {"flag": flag} if flag.any() else {}
    if args.output is None and (args.json == "-" or sys.stdout.isatty()):
        of_channels = (
            [list(pair) for pair in zip(values.items(), beside.items(), strict=True)]
            if beside
            else [[item] for item in values.items()]
        )
        show(_to_read(listed.typed or listed.columns, of_channels, flags))
        return
    values |= beside | flags
    text = io.StringIO()
    write_columns(text, listed.columns | values, channel_comments(channels))
    write_text(args.output or "-", text.getvalue(), args.force)


def _to_read(angles: Columns, of_channels: "list[list[tuple[str, np.ndarray]]]", flags: Columns) -> str:
    """A table as wide as the terminal: angles that are the same in all rows stand above it."""
    same = {name: a[0] for name, a in angles.items() if a.size > 1 and (a == a[0]).all()}
    varying = {name: [f"{v:.6g}" for v in a] for name, a in angles.items() if name not in same}
    room = shutil.get_terminal_size().columns - (CELL - 2) * len(varying) - CELL * len(flags)
    shown = of_channels[: max(1, room // (CELL * len(of_channels[0])))]
    values = dict(itertools.chain(*shown)) | flags
    cells = [*varying.values(), *(_in_words(name, column) for name, column in values.items())]
    unit = "f and its standard uncertainty u_f in 1/sr" if len(of_channels[0]) > 1 else "f in 1/sr"
    above = [", ".join([*(f"{name} {value:.6g}" for name, value in same.items()), unit])]
    more = len(of_channels) - len(shown)
    below = [f"{more} more channels: widen the terminal, or write them with -o or --json"] if more else []
    return "\n".join([*above, aligned(list(zip(*cells, strict=True)), [*varying, *values]), *below])


def _in_words(name: str, column: "np.ndarray") -> list[str]:
    return [f"{v:.2g}" if name.startswith("u_f") else number(v) for v in column]


def _angles_deg(listed: Listed) -> "dict[str, np.ndarray]":
    import numpy as np

    from gonio.data.layouts import spherical_angles

    angles = [*spherical_angles(*listed.wi), *spherical_angles(*listed.wo)]
    names = ("theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg")
    return {name: np.round(np.degrees(a), 10) for name, a in zip(names, angles, strict=True)}


def _directions(args: argparse.Namespace) -> Listed:
    """Those of the file, or all combinations of the angles that are given."""
    given = {name: getattr(args, name) for name in ANGLES if getattr(args, name) is not None}
    if args.directions is not None:
        if given:
            raise GonioError(f"--directions lists all angles; leave --{next(iter(given)).replace('_', '-')} out")
        from gonio.data.formats.csv.table_file import read_directions

        return Listed(*read_directions(args.directions, args.angles))
    if not given:
        raise GonioError("give angles, such as --theta-i 30 --theta-o 0:80:10, or --directions FILE")
    if "phi_o" in given and "delta_phi" in given:
        raise GonioError("--phi-o and --delta-phi say the same; give one of them")
    return _combined({name: _numbers(name, text) for name, text in given.items()}, args.angles == "radians")


def _combined(given: "dict[str, np.ndarray]", radians: bool) -> Listed:
    import numpy as np

    from gonio.models.geometry.directions import from_spherical

    half = math.pi if radians else 180.0
    azimuth = "delta_phi" if "delta_phi" in given else "phi_o"
    axes = {name: given.get(name, np.zeros(1)) for name in ("theta_i", "phi_i", "theta_o")}
    axes[azimuth] = given.get(azimuth, np.full(1, half))
    if math.prod(axis.size for axis in axes.values()) > MOST_ROWS:
        raise GonioError(f"the angles combine to more than {MOST_ROWS:,} directions; give larger steps")
    theta_i, phi_i, theta_o, turn = (a.ravel() for a in np.meshgrid(*axes.values(), indexing="ij"))
    phi_o = turn if "phi_o" in given else phi_i + turn
    angles: list[np.ndarray] = []
    for theta, phi in ((theta_i, phi_i), (theta_o, phi_o)):
        behind = theta < 0  # a signed angle: its size, on the other side of the normal
        angles += [np.abs(theta), np.where(behind, phi + half, phi) % (2 * half)]
    for name, theta in (("theta-i", angles[0]), ("theta-o", angles[2])):
        if (theta > half).any():
            raise GonioError(f"--{name} has {theta.max():g}; give 0 to {half:g} from the normal, or negative angles")
    scale = 1.0 if radians else math.pi / 180.0
    wi, wo = (from_spherical(angles[k] * scale, angles[k + 1] * scale, np) for k in (0, 2))
    unit = " [rad]" if radians else ""
    named = dict(zip([f"{name}{unit}" for name in ANGLES[:4]], angles, strict=True))
    typed = {f"theta_i{unit}": theta_i, f"phi_i{unit}": phi_i, f"theta_o{unit}": theta_o}
    return Listed(wi, wo, named, typed | ({f"{azimuth}{unit}": turn} if azimuth in given else {}))


def _numbers(name: str, text: str) -> "np.ndarray":
    """The numbers of 0,30,60 or 0:80:10 (80 included), or of several such, separated by commas."""
    import numpy as np

    option = f"--{name.replace('_', '-')}"
    values: list[float] = []
    for item in text.split(","):
        try:
            ends = [float(n) for n in item.split(":")]
        except ValueError:
            ends = []
        if len(ends) not in (1, 3) or not all(map(math.isfinite, ends)):
            expected = "give degrees: 30, several as 0,30,60, or start:stop:step as 0:80:10"
            raise GonioError(f"{option} is {text[:80]!r}; {expected}")
        values += ends if len(ends) == 1 else _steps(option, *ends)
    return np.array(values)


def _steps(option: str, start: float, stop: float, step: float) -> list[float]:
    if step == 0 or (stop - start) / step < 0:
        raise GonioError(f"{option} goes from {start:g} to {stop:g} by {step:g}; give a step that leads there")
    count = int((stop - start) / step * (1 + 1e-12) + 1e-9) + 1
    if count > MOST_VALUES:
        raise GonioError(f"{option} has {count:,} numbers; give a larger step")
    # The decimals that were typed, not those of a sum.
    return [round(start + k * step, 12) for k in range(count)]
