"""``gonio fit`` of a profile: the coefficients of light below the surface."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gonio.cli.arguments import writing_json
from gonio.models.errors import GonioError
from gonio.text import columns, number, show

if TYPE_CHECKING:
    from gonio.fitting.subsurface.result import ProfileFit

OTHERS = (
    "loss", "relative_noise", "weight", "robust", "bootstrap", "theta_max", "channel", "per_channel", "samples",
    "scene", "nuisance",
)  # fmt: skip
"""Options of fits of tables."""


def run_profile_fit(args: argparse.Namespace, file: str, output: str) -> int:
    """Fits a profile, writes the material and prints what is known of it; the exit status is the fit's."""
    from gonio.data.files import refuse_outputs
    from gonio.data.profile_files import open_profile
    from gonio.fitting.subsurface.profile_fit import fit_profile

    if given := [name for name in OTHERS if getattr(args, name, None)]:
        raise GonioError(f"{file} is a profile of light below a surface; leave --{given[0].replace('_', '-')} out")
    if len(args.model or []) > 1:
        raise GonioError("a profile is fitted with one model, or with none named: then the best of all is taken")
    refuse_outputs([output, args.json], [file], args.force)
    profile = open_profile(file)
    result = fit_profile(profile, args.model[0] if args.model else None)
    with writing_json(args, result.to_dict() | {"written": output}, result.exit_status):
        result.save(output, args.force)
    show("\n".join([*profile_summary(result), f"written: {output}"]))
    return result.exit_status


def profile_summary(r: "ProfileFit") -> list[str]:
    """What is known of a fit of a profile, the numbers first."""
    rows = [
        [
            p.label, number(p.value, 8), number(p.standard_uncertainty, 2),
            f"[{number(p.interval95[0])}, {number(p.interval95[1])}]", p.unit, p.status,
        ]
        for p in r.parameters if p.status != "fixed"
    ]  # fmt: skip
    verdict = "converged" if r.converged else "NOT converged"
    candidates = [
        [a["model"], number(a["bic_above_best"], 4), number(a["relative_rms"], 3), a["verdict"]] for a in r.alternatives
    ]
    return [
        r.judgement.sentence,
        f"{r.requested} on {Path(r.profile).name or 'the profile'}: {r.samples} readings",
        f"{verdict}: {r.reason}; {r.starts_agreed} of {r.starts} starts agree",
        *([columns(rows, ["number", "value", "std. unc.", "95 % interval", "unit", "status"])] if rows else []),
        "; ".join(f"{name.replace('_', ' ')} {number(value, 3)}" for name, value in r.metrics.items()),
        *(f"undetermined: {sentence}" for sentence in r.undetermined),
        *(f"note: {note}" for note in r.notes),
        *([columns(candidates, ["tried", "Σr² above best", "relative rms", ""])] if candidates else []),
    ]
