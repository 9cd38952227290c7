"""``gonio convert``: from one format to another, or a model into a file of samples or a renderer's, with the error."""

import argparse
import dataclasses
from typing import TYPE_CHECKING, Any

from gonio.cli.arguments import FORCE, MERL, READING, Options, add_options, given, reading_options, share_of, write_json
from gonio.models.errors import GonioError
from gonio.text import is_verbose, log, show

if TYPE_CHECKING:
    from gonio.data.subject import Subject

OPTIONS: Options = {
    "--to NAME": "the renderer (mitsuba, pbrt, materialx, gltf, blender, radiance), or the format where OUT's ending "
    "leaves it open",
    "-m/--model EXPRESSION": "for a renderer, of a table: what is fitted to it; without one a model is selected",
    "--measured": "for mitsuba and pbrt: the surface as data, in OUT.bsdf beside OUT",
    "--tolerance SHARE": "for a renderer: write nothing if rms (of f, cosine-weighted) or albedo differ by more, such "
    "as 5%%",
    "--ascii": {"default": None, "help": "values of an .ssdd file as text, exact, in place of single precision"},
    "--channel-bytes N": "of one channel's samples in a .bsdf file (default 16384, as published), of an anisotropic "
    "surface those of each azimuth of the light",
    "--part": {"choices": ("reflection", "transmission"), "help": "which of both a Zemax file is to hold"},
    "--channel C": "write this channel alone: of a Zemax or Klems file",
    "--step ANGLE": {"type": float, "help": "degrees between the angles of a Zemax (default 5) or Speos file (2)"},
    "--basis": {"choices": ("full", "half", "quarter"), "help": "angles of a Klems file (default full: 145 patches)"},
}
NAMES = ("ascii", "channel_bytes", "part", "channel", "step", "basis")
"""Of the options that a format has."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    models = "for renderers, .bsdf, .binary, .anisotropicbsdf, .brdf, .xml, .ssdd and .bin any model too"
    parser.add_argument(
        "input", metavar="IN", help=f"any file that can be read; {models} (a reference material, an expression, a fit)"
    )  # fmt: skip
    parser.add_argument(
        "output", metavar="OUT", help=".h5 (gonio's HDF5), .bsdf (RGL; --to zemax: Zemax), .binary (MERL), "
        ".anisotropicbsdf or .brdf (Speos), .xml (Klems), .json (BiRD), .astm, .ssdd, .bin (UTIA), .csv; "
        ".xml or .json (--to mitsuba), .pbrt, .mtlx (OpenPBR), .gltf or .glb, .py (--to blender); '-' prints CSV, or "
        "what --to names"
    )  # fmt: skip
    add_options(parser.add_argument, OPTIONS | MERL | READING | FORCE, SHARE=str)


def streamed(args: argparse.Namespace) -> str:
    """The ending of the format that is printed: CSV, or the one that is named. Raises GonioError where it is binary."""
    from gonio.data.formats.registry import targets
    from gonio.exports.targets import TARGETS, canonical

    if args.measured:
        raise GonioError("--measured writes two files; name them by OUT in place of '-'")
    name = canonical(args.to) or "csv"
    known = TARGETS.get(name) or targets().get(name)
    return known.suffixes[0] if known is not None and known.suffixes else ".csv"


def run(args: argparse.Namespace) -> int:
    from gonio.data.profile_files import holds_profile

    if holds_profile(args.input):
        return _run_profile(args)
    from gonio.exports.targets import canonical, target_of

    if target_of(args.output, args.to) is None:
        from gonio.data.formats.registry import writable

        writable(args.output, canonical(args.to))  # refuses other endings, before any work
    from gonio.data.files import refuse_outputs
    from gonio.data.subject import resolve_subject
    from gonio.exports.convert import convert

    refuse_outputs([args.output], [args.input], args.force)
    subject = resolve_subject(args.input, **reading_options(args))
    for warning in _warnings(subject):
        log(f"gonio: {args.input}: {warning}")
    options: dict[str, Any] = given(args, "model", *NAMES) | {
        "force": args.force,
        "measured": args.measured,
        "log": log,
    }
    if args.tolerance is not None:
        options["tolerance"] = share_of(args.tolerance, "--tolerance")
    error = convert(subject, args.output, args.to, **options)
    show(f"{args.output}: {error}")
    if is_verbose() and (others := getattr(error, "others", ())):
        show("other forms: " + ", ".join(f"{name} (rms {100 * rms:.3g} %)" for name, rms in others[:3]))
    facts = dataclasses.asdict(error) if dataclasses.is_dataclass(error) else {}
    return write_json(args, {"written": args.output, "error": facts, "sentence": str(error)})


def _warnings(subject: "Subject") -> list[str]:
    """What limits the use of the subject's values."""
    if subject.table is not None:
        return subject.table.provenance.get("warnings", [])
    from gonio.fitting.material_warnings import material_warnings

    return material_warnings(subject.as_material())


def _run_profile(args: argparse.Namespace) -> int:
    """A profile of light below a surface from HDF5 to CSV or back; says what reading it again shows to be lost."""
    from gonio.data.files import refuse_outputs
    from gonio.data.profile_files import open_profile, require_profile_ending, write_profile
    from gonio.data.round_trip import compare

    require_profile_ending(args.output)
    refuse_outputs([args.output], [args.input], args.force)
    profile = open_profile(args.input)
    again = open_profile(write_profile(args.output, profile, args.force))
    note = "" if again.provenance == profile.provenance else "CSV holds no provenance, nor why a reading is missing"
    error = compare(profile.value, again.value, profile.valid, again.valid, note)
    text = str(error).replace("sr^-1", "1/mm²")
    show(f"{args.output}: {text}")
    return write_json(args, {"written": args.output, "error": dataclasses.asdict(error), "sentence": text})
