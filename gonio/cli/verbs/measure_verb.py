"""``gonio measure``: scan a material with the simulated instrument into a table file."""

import argparse
import dataclasses
import os
import shlex
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gonio.cli.arguments import (
    DESCRIPTION,
    FORCE,
    MATERIAL,
    READING,
    Options,
    add_options,
    as_stated,
    degrees,
    given,
    hours,
    seconds_of,
    share_of,
    write_json,
)
from gonio.models.errors import GonioError
from gonio.text import is_verbose, log, show

if TYPE_CHECKING:
    from gonio.data.layouts import Layout
    from gonio.data.material import Material
    from gonio.instrument.instrument import Instrument, Systematic
    from gonio.instrument.pace import Pace, ScanTime
    from gonio.models.brdf import AbstractBRDF

UNFINISHED = ".part"
"""The ending of a table that is being written."""
SYSTEMATIC = ("tilt_x", "tilt_y", "theta_i", "theta_o", "phi")
SCANS = "isotropic, spherical, half-difference, merl, in-plane, rgl, offsets, or a CSV file of directions"
OUTPUT: Options = {
    "-o/--output T.h5": "the table; a killed run is continued; of the rgl scan also .bsdf, or .csv",
    "--dry-run": "say the cells, hours on a real instrument and bytes, and measure nothing",
}
SCAN: Options = {
    "--scan SCAN": f"{SCANS}, whose column seconds, if any, is counting times (default: "
    "isotropic, or spherical for an anisotropic material); rgl: retro-reflection, from it the normals, then a grid "
    "warped to where they reflect [Dupuy 2018]",
    "--offsets MM,MM,...": "distances of the viewed from the lit spot, of either sign, for --scan offsets (R by the "
    "distance, light below the surface); or FROM:TO:NUMBER",
    "--step DEG": "step of the angles",
    "--phi-step DEG": "step of the azimuths, where it is another",
    "--theta-max DEG": "largest polar angle (default 85)",
    "--theta-i DEG,DEG,...": "incidences of the in-plane scan",
    "--hemisphere": {
        "choices": ("reflection", "transmission", "both"),
        "help": "where the detector goes: to the light's side of the sample, to the other one (polar angles above "
        "90 degrees), or to both (default: where the material scatters to)",
    },
    "--lit": {
        "choices": ("front", "back", "both"),
        "help": "the sides of the sample that the light goes to (default front); reciprocity of transmission is "
        "checked where both were lit",
    },
    "--incidences N": "polar angles of the light of the rgl scan (default 8, as published)",
    "--samples N": "samples along a side of its warped grid (default 32)",
}
INSTRUMENT: Options = {
    **DESCRIPTION,
    "--source-half-angle DEG": "half-angle of the source's disc (default 0: a point)",
    "--detector-half-angle DEG": "half-angle of the detector's disc (default 0: a point)",
    "--misalignment DEG": "standard deviation of tilts and arm angles, one sample of each from the seed",
    "--shadow DEG": "the detector blocks the source where the arms are closer than this",
    "--photons N": "counts expected of the perfect white diffuser at normal incidence (default: no shot noise)",
    "--ambient SHARE": "light without the source, as a share of the photons",
    "--dark N": "dark counts expected per reading",
    "--read-noise N": "standard deviation of the reading-out, counts",
    "--noise SHARE": "relative standard deviation of the source from reading to reading",
    "--calibration SHARE": "relative standard deviation of the calibration factor, one sample from the seed",
    "--saturation N": "counts at which the detector is full",
    "--illuminated-radius MM": "radius of the lit spot: with the viewed one, a translucent material loses the light "
    "that leaves beside it (default: both far wider than light travels below the surface)",
    "--viewed-radius MM": "radius of the viewed spot",
    "--tolerance REL": "error allowed to aperture averages (default 1e-3)",
    "--systematic NAME=V,...": f"the systematic errors themselves: {', '.join(SYSTEMATIC)} in degrees, gain as a "
    "factor, offset as a share of the white diffuser's signal",
}
ADAPTIVE: Options = {
    "--adaptive STRATEGY": {
        "nargs": "?",
        "const": "table",
        "help": "in place of a scan, read where it tells most, and show the error by random directions that were not "
        "used; table (if nothing is said): where the readings so far predict worst, kriging between them; model: what "
        "a fitted model needs, which grows where its residuals are structure",
    },
    "-m/--model MODEL": "of --adaptive model (default: selected, as gonio fit does)",
    "--target SHARE": {
        "type": str,
        "help": "until an error of at most this is shown, such as 1%%; exit status 1 if not",
    },
    "--budget TIME": "or until the time is spent: moving, settling and counting, such as 2h, 30min or 1h30min",
}
WITHOUT_VALUE = {
    "not_measured": "beyond the ranges of the axes",
    "shadowed": "where the detector shadows the sample",
    "saturated": "saturated",
    "invalid": "invalid",
}
"""Why a reading above the horizon has no value, in words."""
RUN: Options = {
    "--seed SEED": {"default": 0, "help": "of the noise and the systematic errors (default 0)"},
    "--float32": "store single precision",
    "--progress": "show a bar even where no terminal is",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("material", metavar="MATERIAL", help=MATERIAL)
    add_options(parser.add_argument, OUTPUT)
    add_options(parser.add_argument_group("scan").add_argument, SCAN)
    add_options(parser.add_argument_group("adaptive measurement").add_argument, ADAPTIVE)
    add_options(parser.add_argument_group("instrument (ideal by default)").add_argument, INSTRUMENT, N=float, MM=float)
    add_options(parser.add_argument, RUN | READING | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.files import refuse_outputs

    _require_one_way(args)
    refuse_outputs([args.output], [args.material, args.scan, args.instrument], args.force)
    from gonio.data.subject import load_material
    from gonio.fitting.material_warnings import material_warnings

    instrument = _instrument(args)
    material = load_material(as_stated(args.material, args))
    command = shlex.join(["gonio", *sys.argv[1:]])
    if args.adaptive or args.dry_run or args.scan in ("offsets", "rgl"):  # other measurements say it themselves
        for warning in material_warnings(material):
            log(warning)
    if args.adaptive:
        return _adaptive(args, material, instrument, command)
    if args.scan == "offsets":
        return _offsets(args, material, instrument, command)
    if args.scan == "rgl":
        return _rgl(args, material, instrument, command)
    return _scanned(args, material, instrument, command)


def kept(args: argparse.Namespace) -> str:
    """What an interrupted measurement has kept."""
    part = f"{args.output}{UNFINISHED}"
    if not args.output or not os.path.exists(part):
        return "nothing was written"
    return f"what was read is kept in {part}: run it again to go on"


def _scanned(args: argparse.Namespace, material: "Material", instrument: "Instrument", command: str) -> int:
    from gonio.instrument.measurement import measure
    from gonio.instrument.scans import listed_seconds

    layout = _scan(args, material.brdf)
    seconds = None if args.scan is None else listed_seconds(args.scan)
    takes = instrument.pace.scan_time(layout, instrument.seconds if seconds is None else seconds)
    each = (4 if args.float32 else 8) * (2 if instrument.has_noise else 1) + 1
    facts: dict[str, Any] = {"material": material.name, "layout": layout.name, "cells": layout.size}
    facts |= {"channels": len(material.channels), "bytes": layout.size * len(material.channels) * each}
    facts |= time_facts(takes)
    options = {name: getattr(args, name) for name in ("output", "seed", "force")}
    options["progress"] = args.progress or sys.stderr.isatty()
    options["dtype"] = "float32" if args.float32 else None
    unread, status = "", 0
    if not args.dry_run:
        table = measure(material, instrument, layout, log=log, command=command, seconds=seconds, **options)
        counts = table.counts()
        facts["without_value"] = {name: counts[name] for name in WITHOUT_VALUE}
        unread, status = without_value(facts["without_value"], counts["valid"]), 0 if counts["valid"] else 1
    else:
        size = f"{facts['cells']:,} cells × {facts['channels']} channels, at most {facts['bytes'] / 1e6:.3g} MB"
        show(f"{material.name}, {layout.name} scan: {size} before compression")
    show(time_sentence(takes, instrument.pace))
    show(unread) if unread else None
    if not args.dry_run:
        show(f"written: {args.output}")
    return write_json(args, facts | {"written": None if args.dry_run else args.output}, status)


def without_value(counts: Mapping[str, int], valid: int) -> str:
    """How many readings have no value and why; nothing where all have one.

    Args:
        counts: of the reasons `WITHOUT_VALUE`.
        valid: readings that have a value.
    """
    why = ", ".join(f"{count:,} {WITHOUT_VALUE[name]}" for name, count in counts.items() if count)
    number = sum(counts.values())
    return f"{'NO reading has a value' if not valid else f'{number:,} readings have no value'}: {why}" if why else ""


def time_facts(takes: "ScanTime") -> dict[str, Any]:
    """The time of a scan on a real instrument, for JSON."""
    return {"readings": takes.readings, "hours": takes.seconds / 3600, "hours_counting": takes.counting / 3600}


def time_sentence(takes: "ScanTime", pace: "Pace") -> str:
    """The time of a scan on a real instrument; with -v also the model of that."""
    how = f"{hours(takes.moving)} moving and settling, {hours(takes.counting)} counting"
    return f"on a real instrument: {hours(takes.seconds)} ({how})" + f"\n{pace.sentence()}" * is_verbose()


def _require_one_way(args: argparse.Namespace) -> None:
    """Refuses options of a scan beside --adaptive, and those of an adaptive measurement without it."""
    only_rgl = [n for n in ("incidences", "samples") if getattr(args, n) is not None]
    directions = ("scan", "step", "phi_step", "theta_max", "theta_i", "float32")
    scans = [n for n in directions if getattr(args, n)]
    ends = [n for n in ("target", "budget", "model") if getattr(args, n)]
    if args.adaptive and scans:
        raise GonioError(f"--adaptive chooses its directions itself; leave --{scans[0].replace('_', '-')} out")
    if args.offsets is not None and args.scan != "offsets":
        raise GonioError("--offsets belongs to the scan of offsets; give --scan offsets too")
    if only_rgl and args.scan != "rgl":
        raise GonioError(f"--{only_rgl[0]} belongs to the rgl scan; give --scan rgl too")
    if (args.output or "").lower().endswith(".bsdf") and args.scan != "rgl":
        raise GonioError(
            f"{args.output} is written by --scan rgl; give that, or measure into .h5 and convert the table"
        )
    if args.output is None and not args.dry_run:
        raise GonioError("name the table to write, as in -o T.h5, or give --dry-run to know what it takes")
    if args.dry_run and (args.adaptive or args.scan == "rgl"):
        which = "an adaptive measurement" if args.adaptive else "the rgl scan"
        raise GonioError(f"{which} chooses its directions by what it reads; leave --dry-run out")
    if ends and not args.adaptive:
        raise GonioError(f"--{ends[0]} belongs to an adaptive measurement; give --adaptive too")


def _adaptive(args: argparse.Namespace, material: "Material", instrument: "Instrument", command: str) -> int:
    from gonio.planning.adaptive.adaptive_measurement import KEY, Outcome, adapt

    target, budget = (None if t is None else of(t) for t, of in ((args.target, share_of), (args.budget, seconds_of)))
    options: dict[str, Any] = {"output": args.output, "seed": args.seed, "force": args.force, "command": command}
    options |= {"strategy": args.adaptive, "model": args.model}
    options |= {name: value for name in ("hemisphere", "lit") if (value := getattr(args, name))}
    table = adapt(material, instrument, target=target, budget=budget, log=log, **options)
    outcome = Outcome.of(table)
    show(f"{outcome.sentence}\nwritten: {args.output}")
    facts = {"material": material.name, "readings": table.layout.size, "channels": len(table.channels)}
    facts |= {key: table.provenance[KEY][key] for key in ("shown", "error", "bound", "hours", "verdict")}
    return write_json(args, facts | {"written": args.output}, 0 if outcome.shown or target is None else 1)


def _rgl(args: argparse.Namespace, material: "Material", instrument: "Instrument", command: str) -> int:
    from gonio.data.formats.registry import writable, write
    from gonio.data.formats.rgl_write import write_arrays
    from gonio.instrument.rgl_scan import measure_rgl

    kind = writable(args.output).name  # refuses other endings, before any work
    if kind == "MERL":
        raise GonioError(f"{args.output}: the rgl scan is no MERL grid; write .h5 or .bsdf, and convert that")
    if others := [n for n in ("step", "phi_step", "theta_i", "hemisphere", "lit") if getattr(args, n) is not None]:
        raise GonioError(f"the rgl scan chooses its directions itself; leave --{others[0].replace('_', '-')} out")
    options: dict[str, Any] = given(args, "incidences", "samples", "theta_max")
    options |= {"seed": args.seed, "progress": args.progress or sys.stderr.isatty(), "command": command}
    scan = measure_rgl(material, instrument, log=log, dtype="float32" if args.float32 else None, **options)
    if kind == "RGL":
        write_arrays(args.output, scan.fit, args.force)
    else:
        write(args.output, scan.table, args.force)
    show(f"on a real instrument: {hours(3600 * scan.hours)}\nwritten: {args.output}")
    facts = {"material": material.name, "readings": scan.table.layout.size, "channels": len(scan.table.channels)}
    return write_json(args, facts | {"hours": scan.hours, "written": args.output})


def _offsets(args: argparse.Namespace, material: "Material", instrument: "Instrument", command: str) -> int:
    from gonio.data.profile_files import require_profile_ending
    from gonio.instrument.offsets_scan import measure_profile, parsed_offsets
    from gonio.instrument.pace import ScanTime

    others = [n for n in ("step", "phi_step", "theta_max", "theta_i") if getattr(args, n) is not None]
    if others or args.float32:
        raise GonioError(f"the scan of offsets is read at the normal; leave --{(others or ['float32'])[0]} out")
    if not args.dry_run:
        require_profile_ending(args.output)
    offsets = None if args.offsets is None else parsed_offsets(args.offsets)
    options: dict[str, Any] = {"seed": args.seed, "force": args.force, "command": command}
    options["output"] = None if args.dry_run else args.output
    profile = measure_profile(material, instrument, offsets, **options)
    count = profile.offsets.size
    takes = ScanTime(count, count * instrument.pace.settling, count * instrument.seconds)
    facts = {"material": material.name, "channels": len(profile.channels), **time_facts(takes)}
    lines = [f"{k}: {v}" for k, v in profile.facts().items() if v] + [time_sentence(takes, instrument.pace)]
    show("\n".join([*lines, *([] if args.dry_run else [f"written: {args.output}"])]))
    return write_json(args, facts | {"written": None if args.dry_run else args.output})


def _instrument(args: argparse.Namespace) -> "Instrument":
    from gonio.instrument.description import read_instrument
    from gonio.instrument.instrument import Instrument

    args.systematic = _systematic(args.systematic) if args.systematic else None
    described = Instrument() if args.instrument is None else read_instrument(args.instrument)
    named = {field.name for field in dataclasses.fields(Instrument)} & vars(args).keys()
    return dataclasses.replace(described, **given(args, *named))


def _systematic(text: str) -> "Systematic":
    from gonio.instrument.instrument import Systematic

    values: dict[str, float] = {}
    for item in text.split(","):
        name, _, value = (piece.strip() for piece in item.partition("="))
        if name not in (*SYSTEMATIC, "gain", "offset"):
            raise GonioError(f"--systematic has no {name!r}; it has {', '.join(SYSTEMATIC)}, gain and offset")
        try:
            values[name] = (degrees if name in SYSTEMATIC else float)(value)
        except ValueError:
            raise GonioError(f"--systematic has {item.strip()!r}; give NAME=NUMBER, such as tilt_x=0.1") from None
    return Systematic(**values)


def _scan(args: argparse.Namespace, brdf: "AbstractBRDF") -> "Layout":
    from gonio.instrument.scans import default_hemisphere, default_name, scan

    options = given(args, "step", "phi_step", "theta_max", "hemisphere", "lit")
    name = args.scan or default_name(brdf)
    options.setdefault("hemisphere", default_hemisphere(name, brdf))
    if args.theta_i is not None:
        try:
            options["theta_i"] = [degrees(t) for t in args.theta_i.split(",")]
        except ValueError:
            raise GonioError(f"--theta-i is {args.theta_i!r}; give degrees, such as 0,30,60") from None
    return scan(name, **options)
