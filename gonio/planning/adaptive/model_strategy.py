"""With a model: it is fitted, and the planner reads what its predictions need most."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from gonio.fitting.fit_table import fit
from gonio.fitting.result import FitResult
from gonio.instrument.instrument import Instrument
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import from_spherical
from gonio.planning.adaptive.accuracy import FLOOR, random_directions
from gonio.planning.adaptive.prediction import Prediction
from gonio.planning.adaptive.session import Session
from gonio.planning.planner import Planner, Read
from gonio.planning.prior import Prior, prior_of
from gonio.planning.shots import Shots, Sites, counting
from gonio.planning.ways import Way

WANTED = 60
"""Directions whose predictions the planner is to improve."""
WRONG = 2.0
"""Times the error expected, from which on a model is taken to leave something out."""
FEWEST = 20
LARGEST = 1.0
"""Of the squares of relative errors."""


@dataclasses.dataclass(frozen=True)
class ModelPrediction(Prediction):
    """A fitted model; `prior` are its numbers with their covariance, None where it has too many to plan for.

    `why` says how the model came about.
    """

    result: FitResult
    prior: Prior | None
    instrument: Instrument
    isotropic: bool
    why: str
    of_session: tuple[Way, ...] = (Way(),)

    @property
    def ways(self) -> tuple[Way, ...]:
        """Those on which the session reads."""
        return self.of_session

    @classmethod
    def of(cls, session: Session, ratio: float) -> "ModelPrediction":
        """The last round's model fitted to the readings so far; selected from anew where its residuals are structure.

        `ratio`: the error that the last check showed, over what was expected. A model that was asked for is kept.
        """
        requested = session.about["model"]
        last = requested or next((r["model"] for r in reversed(session.rounds) if "model" in r), None)
        table, why = session.table(), "as asked for" if requested else "kept: its residuals are noise"
        result = None if last is None else fit(table, last)
        if result is None or (requested is None and (ratio > WRONG or _structure(result.to_dict()))):
            why = "selected" if result is None else "selected anew: the last model left structure"
            result = fit(table)
        try:
            prior = prior_of(result, None)
        except GonioError:
            prior = None
        return cls(result, prior, session.instrument, session.isotropic, why, session.ways)

    def facts(self) -> dict[str, Any]:
        return {"model": self.result.requested, "fitted": self.result.expression, "model_why": self.why}

    def values(self, angles: np.ndarray) -> np.ndarray:
        theta_i, phi_i, theta_o, phi_o = angles
        wi, wo = from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)
        f = np.asarray(evaluate_in_blocks(self.result.brdf, wi, wo)).reshape(angles.shape[1], -1)
        return np.broadcast_to(f, (angles.shape[1], len(self.result.channels)))

    def squares(self, angles: np.ndarray) -> np.ndarray:
        if self.prior is None:
            return np.ones(angles.shape[1])
        slopes = _relative(self.prior, self.prior.p, angles)
        variances = np.einsum("ncp,pq,ncq->nc", slopes, np.nan_to_num(self.result.covariance), slopes)
        return np.clip(variances.mean(axis=1), 0.0, LARGEST)

    def next_shots(self, session: Session, most: int, seconds: float, rng: np.random.Generator) -> Shots:
        """The planner's for predictions all over, in as much time as passed so far; where it has none, random ones."""
        seconds = min(seconds, session.seconds())
        try:
            shots = self._planned(session, seconds, rng)
        except (GonioError, np.linalg.LinAlgError):
            shots = session.shots(self._random(min(FEWEST, most), rng))
        return Shots(shots.angles[:, :most], shots.seconds[:most])

    def _random(self, count: int, rng: np.random.Generator) -> np.ndarray:
        return random_directions(count, self.instrument, self.isotropic, rng, self.ways)

    def _planned(self, session: Session, seconds: float, rng: np.random.Generator) -> Shots:
        if self.prior is None:
            raise GonioError(f"{self.result.requested} has too many numbers to plan for")
        wanted = self._random(WANTED, rng)
        rows = np.stack([_relative(self.prior, p, wanted) for p in self.prior.draws])
        rows = rows.reshape(rows.shape[0], -1, rows.shape[-1])
        instrument, valid = counting(self.instrument), session.valid
        angles = session.angles[:, valid]
        sites = Sites.of(self.prior, instrument, angles, self.prior.p[None])
        known = Read(sites.rows(session.counting[valid])[:1], angles)
        return Planner(self.prior, instrument, wanted=rows, known=known).schedule(seconds).shots


def _relative(prior: Prior, p: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Slopes (n, C, P) of f over its size, by the numbers."""
    f, slopes = prior.at_angles(p, angles)
    return slopes / (np.abs(f) + FLOOR)[:, :, None]


def _structure(fitted: Mapping[str, Any]) -> bool:
    """Whether the residuals of a fit are structure."""
    return ((fitted.get("residuals") or {}).get("noisiness") or {}).get("verdict") == "structure"
