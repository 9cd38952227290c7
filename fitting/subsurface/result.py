"""The result of fitting a profile: a translucent material with the uncertainties of its coefficients."""

import dataclasses
import os
from pathlib import Path
from typing import Any

from gonio.data.formats.material_file import write_material
from gonio.data.material import Material
from gonio.data.serialise import unboxed
from gonio.fitting.judgement import FAILED, FitJudgement, judge_fit
from gonio.fitting.uncertainty.optimum import ParameterEstimate
from gonio.models.display import Displayed


@dataclasses.dataclass(frozen=True, repr=False)
class ProfileFit(Displayed):
    """A fitted model of light below the surface; a subject of every verb, as its `material` is.

    Attributes:
        fitted: the fitted model (as wide spots see it) and its channels, without the fit's facts.
        requested: the expression that was fitted.
        parameters: every number with uncertainty, 95 % interval and status.
        converged, reason: stationary by the projected gradient, or exact.
        metrics: `relative_rms` and `reduced_chi2` (where the noise is known) of the worst channel, `total` ∫R dA.
        samples: readings, channels counted apart; `cost` Σr² of them all.
        starts, starts_agreed: descents of a channel, and how many ended at the best cost, of the worst channel.
        undetermined, notes: sentences.
        residuals: `noisiness`, whether the residuals along the offsets are noise, structure or rounding.
        profile: name of the profile; `alternatives`: what else was fitted.
        common_errors: what all readings share and the standard uncertainties leave out; see `common_errors`.
        noise_stated: whether the readings of all channels state their uncertainties.
        covariance_by_channel: of each channel `numbers`, places among the free ones, and their `covariance`.
    """

    fitted: Material
    requested: str
    parameters: list[ParameterEstimate]
    converged: bool
    reason: str
    metrics: dict[str, float]
    samples: int
    cost: float
    starts: int
    starts_agreed: int
    undetermined: list[str]
    notes: list[str]
    residuals: dict[str, Any]
    profile: str = ""
    alternatives: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    covariance_by_channel: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    common_errors: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    noise_stated: bool = True

    @property
    def material(self) -> Material:
        """The fitted model as a material of every verb, with the facts of the fit."""
        return dataclasses.replace(self.fitted, meta={"fit": self.to_dict()})

    @property
    def judgement(self) -> FitJudgement:
        """Whether it is good, in one sentence."""
        facts = ("converged", "reason", "metrics", "undetermined", "residuals", "common_errors")
        return judge_fit({name: getattr(self, name) for name in facts})

    @property
    def exit_status(self) -> int:
        """1 for a fit that failed, else 0."""
        return 1 if self.judgement.verdict == FAILED else 0

    def facts(self) -> dict[str, str]:
        """Verdict, model and numbers."""
        numbers = {
            p.label: f"{p.value:.6g} ± {p.standard_uncertainty:.2g} {p.unit}, {p.status}" for p in self.parameters
        }
        return {"verdict": self.judgement.sentence, "model": self.requested} | numbers

    def to_dict(self) -> dict[str, Any]:
        """Everything as JSON can hold it, but for numbers that are not finite."""
        names = (
            "converged",
            "reason",
            "metrics",
            "samples",
            "starts",
            "starts_agreed",
            "undetermined",
            "notes",
            "residuals",
            "covariance_by_channel",
            "common_errors",
        )
        facts = {name: getattr(self, name) for name in names}
        numbers = [dataclasses.asdict(p) | {"label": p.label} for p in self.parameters]
        loss = "sigma" if self.noise_stated else "likeliest"
        more = {"table": self.profile, "asked": self.requested, "loss": loss}
        return unboxed(facts | more | {"parameters": numbers, "alternatives": self.alternatives})

    def save(self, path: str | os.PathLike[str], force: bool = False) -> Path:
        """Writes the fitted model as a material file with the facts of the fit, and returns the path.

        Raises GonioError where `path` exists (unless `force`) or cannot be written.
        """
        return write_material(path, self.material, force)
