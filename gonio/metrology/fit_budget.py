"""The budget of fitted numbers: the optimum of a fit moves by (JᵀWJ)⁻¹JᵀW δf with any error δf of the readings."""

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np

from gonio.data.layouts import spherical_angles
from gonio.data.table import Table
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.problem import weighted_residuals
from gonio.fitting.problem.readings import transform, uses_cosine
from gonio.fitting.residuals.summary import Evidence
from gonio.fitting.result import FitResult
from gonio.metrology.budget import Budget, Contribution
from gonio.metrology.effects import Readings
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.quantity import Quantity
from gonio.metrology.sources import ESTIMATED, MEANINGS, STORED, Noise, Sources
from gonio.metrology.table_budget import APERTURE, aperture_shift, of_apertures, shared
from gonio.models.errors import GonioError
from gonio.models.expression.parser import parse, with_defaults
from gonio.models.geometry.directions import Direction
from gonio.planning.prior import Prior
from gonio.planning.wanted import INCIDENCES, albedos

CHUNK = 1 << 14
MOST_NUMBERS = 48
MOST_GROUPS = 64
STRUCTURE = 4.0
"""Standard deviations of χ² beyond its expectation from which on the model leaves something out."""
LOST = 1e-13
MOST_STEPS, STEADY = 8, 1e-5
"""Steps of a refit, and the relative change of the numbers at which it ends."""
MODEL, SCATTER = "model", "scatter"
FITTED = {"albedo": "albedo of the fit", "transmittance": "transmittance of the fit"}


class Sums(NamedTuple):
    """Sums of products of a fit's weighted rows: derivatives J by P numbers, m shifts q of the readings, residual r.

    `groups` (G, P + m + 1, P + m + 1): of each group of incidences; `noise` (parts, P, P): Σ (Jᵀσ)(Jᵀσ)ᵀ of each part
    of the noise; `expected`: Σ r² of noise alone, over `count` readings.
    """

    groups: np.ndarray
    noise: np.ndarray
    expected: float
    count: int

    @property
    def total(self) -> np.ndarray:
        """Over all readings (P + m + 1, P + m + 1)."""
        return self.groups.sum(axis=0)


def prior_of_fit(fitted: FitResult) -> Prior:
    """The fitted model with its free numbers.

    Raises GonioError for one fitted channel by channel, without free numbers, or with too many.
    """
    terms = with_defaults(parse(fitted.requested))
    s, fixed, _ = parameters(terms, len(fitted.channels))
    if len(fitted.uncertainty) > 1:
        name = f"'{fitted.requested}' was fitted channel by channel"
        raise GonioError(f"{name}; a budget is of a joint fit, or of a table of one channel")
    if not 0 < s.size <= MOST_NUMBERS:
        raise GonioError(f"'{fitted.requested}' has {s.size} free numbers; a budget takes from 1 to {MOST_NUMBERS}")
    p = np.array([e.value for e in fitted.parameters if e.status != "fixed"])
    return Prior(fitted.table, terms, s, fixed, p, p[None], np.ones(1), fitted.channels)


@dataclasses.dataclass(frozen=True)
class FitBudget:
    """A fit with what moves its free numbers and its albedos."""

    prior: Prior
    fitted: FitResult
    evidence: Evidence
    shifts: dict[str, np.ndarray]
    """Change of the readings (n, C) by one standard uncertainty of each systematic term, and by the apertures."""
    noise: list[Noise]
    """Parts of the readings' noise, (n, C) each."""
    missing: dict[str, str]
    """Why other terms are not known."""
    cells: np.ndarray | None
    """Numbers (n,) of the cells of the readings; None where they are a choice."""

    def refitted(self, shift: np.ndarray) -> np.ndarray:
        """Changes (Q,) of the numbers, by Gauss-Newton steps, and of the albedos, where readings change (n, C)."""
        e, p = self.evidence, self.prior.p.copy()
        cosine = self._cosine()
        by_model, by_reading = self._weights(cosine)
        first, slopes = self.prior.values_and_slopes(p, e.readings.wi, e.readings.wo)
        residual = weighted_residuals(e.readings, e.loss, e.floor, e.weight, e.model_f) - by_reading * shift
        f, d = first, self.prior.parameterisation.domains
        for _ in range(MOST_STEPS):
            rows = (slopes * by_model[..., None]).reshape(-1, p.size)
            now = (residual + by_model * (f - first)).ravel()
            step = inverse_of(rows.T @ rows, self.moving) @ (rows.T @ now)
            p = np.clip(p - step, d.low, d.high)
            if np.all(np.abs(step) <= STEADY * np.maximum(np.abs(p), STEADY)):
                break
            f, slopes = self.prior.values_and_slopes(p, e.readings.wi, e.readings.wo)
        return self.outputs[1] @ (p - self.prior.p)

    @functools.cached_property
    def moving(self) -> np.ndarray:
        """Which numbers (P,) no bound holds."""
        return np.array([not p.status.startswith("at ") for p in self.fitted.parameters if p.status != "fixed"])

    @functools.cached_property
    def outputs(self) -> tuple[list[Quantity], np.ndarray]:
        """The numbers and albedos, and their slopes (Q, P) by the numbers."""
        return outputs_of(self.fitted)

    def _cosine(self) -> np.ndarray:
        e = self.evidence
        return e.readings.cos_i[:, None] if uses_cosine(e.loss) else np.ones((e.readings.f.shape[0], 1))

    def _weights(self, cosine: np.ndarray) -> list[np.ndarray]:
        """Weights of changes of the model and of the readings (n, C): w T'(f c) c."""
        e = self.evidence
        return [e.weight * transform(e.loss, f * cosine, e.floor, np)[1] * cosine for f in (e.model_f, e.readings.f)]

    def sums(self) -> Sums:
        """The sums over all readings, in chunks."""
        e, prior = self.evidence, self.prior
        size, parts = prior.p.size + len(self.shifts) + 1, [part.u_f for part in self.noise]
        groups = _groups(e.readings.wi)
        total = np.zeros((int(groups.max()) + 1, size, size))
        noise, expected = np.zeros((len(parts), prior.p.size, prior.p.size)), 0.0
        by_model, by_reading = self._weights(self._cosine())
        residual = weighted_residuals(e.readings, e.loss, e.floor, e.weight, e.model_f)
        for start in range(0, groups.size, CHUNK):
            these = slice(start, start + CHUNK)
            wi, wo = (Direction(*(np.asarray(c)[these] for c in w)) for w in (e.readings.wi, e.readings.wo))
            j = prior.values_and_slopes(prior.p, wi, wo)[1] * by_model[these, :, None]
            q = [(shift[these] * by_reading[these])[..., None] for shift in self.shifts.values()]
            rows = np.concatenate([j, *q, residual[these, :, None]], axis=-1)
            for g in np.unique(groups[these]):
                alike = rows[groups[these] == g].reshape(-1, size)
                total[g] += alike.T @ alike
            for k, sigma in enumerate(parts):
                u = np.nan_to_num(sigma[these] * by_reading[these])
                flat = (j * u[..., None]).reshape(-1, prior.p.size)
                noise[k] += flat.T @ flat
                expected += float(np.sum(u**2))
        return Sums(total, noise, expected, e.readings.count)


def outputs_of(fitted: FitResult) -> tuple[list[Quantity], np.ndarray]:
    """A fit's free numbers, albedos and transmittances as quantities, and their slopes (Q, P) by the numbers."""
    free, prior = [e for e in fitted.parameters if e.status != "fixed"], prior_of_fit(fitted)
    rows = [Quantity(e.name, "fit", e.channel or "", e.value, 0.0, {}, e.unit or "1", group="fit") for e in free]
    made = albedos(prior, prior.p)
    shares = dict.fromkeys(name.split(" ")[0] for name in made.names)
    places = [(share, t, c) for share in shares for t in INCIDENCES for c in fitted.channels.names]
    rows += [
        Quantity(FITTED[share], f"θi {t:g}°", c, float(v), 0.0, {"theta_i": t}, group="fit")
        for (share, t, c), v in zip(places, made.values, strict=True)
    ]
    slopes = np.concatenate([np.eye(len(free)), made.slopes])
    numbers = FitNumbers.of(fitted.material)
    spread = np.zeros(len(rows)) if numbers is None else numbers.spread(slopes)
    return [dataclasses.replace(q, u=float(u)) for q, u in zip(rows, spread, strict=True)], slopes


def fit_budget(fit: FitBudget, sources: Sources) -> Budget:
    """The budget of a fit's free numbers and albedos.

    Numbers that a bound holds do not move. Where the noise of the readings is known, the fit's own uncertainties are
    not taken: they count as noise what alignment does to the residuals. What these still hold, after the systematic
    terms were moved within their uncertainties, is a source of its own, as large as the incidences scatter.
    """
    sums, slopes, p = fit.sums(), fit.outputs[1], fit.prior.p.size
    inverse = inverse_of(sums.total[:p, :p], fit.moving)

    def spread(matrix: np.ndarray) -> np.ndarray:
        return np.sqrt(np.maximum(np.einsum("qp,pr,qr->q", slopes, matrix, slopes), 0.0))

    rows = [
        _independent(part.name, part.meaning, spread(inverse @ matrix @ inverse), part.dof, part.origin)
        for part, matrix in zip(fit.noise, sums.noise, strict=True)
    ]
    if not rows:
        freedom, covariance = float(fit.fitted.samples - p), np.nan_to_num(fit.fitted.covariance)
        rows.append(_independent(SCATTER, "scatter about the model", spread(covariance), freedom))
    elif (left_out := _left_out(sums, inverse)) is not None:
        freedom = float(sums.groups.shape[0] - 1)
        rows.append(_independent(MODEL, "what the model leaves out", spread(left_out), freedom))
    moves = slopes @ inverse @ sums.total[:p, p:-1]
    for k, name in enumerate(fit.shifts):
        rows.append(of_apertures(moves[:, k]) if name == APERTURE else shared(sources.systematic[name], moves[:, k]))
    unbounded = np.zeros(slopes.shape[0], bool)
    unbounded[:p] = [e.status == "undetermined" for e in fit.fitted.parameters if e.status != "fixed"]
    return Budget(rows, fit.missing, unbounded)


def _independent(name: str, meaning: str, values: np.ndarray, dof: float, origin: str = ESTIMATED) -> Contribution:
    return Contribution(name, meaning, False, values, dof=dof, origin=origin)


def fit_errors(table: Table, fitted: FitResult, sources: Sources) -> FitBudget:
    """What moves the numbers of a table's fit that was made in this process. Raises GonioError as `prior_of_fit`."""
    e, missing = fitted.evidence, dict(sources.missing)
    if e is None:
        raise GonioError("this fit keeps no readings; give its model, and the table is fitted again")
    pair = [[np.asarray(c) for c in w] for w in (e.readings.wi, e.readings.wo)]
    angles = np.stack([angle for w in pair for angle in spherical_angles(*w)])
    cells = table.valid_cells(fitted.theta_max)
    # A factor acts on the expected readings: noise of one's own in the shift would explain itself.
    readings = Readings(table, cells, angles, e.model_f, fitted.brdf)
    shifts: dict[str, np.ndarray] = {}
    if fitted.apertures is not None and not fitted.apertures["averaged"]:
        shift = aperture_shift(table, readings)
        assert not isinstance(shift, str)
        shifts[APERTURE] = np.broadcast_to(shift, e.readings.f.shape)
    elif table.receiver_solid_angle is None and "instrument" not in table.provenance:
        missing[APERTURE] = "the table stores no solid angle"
    for name, source in sources.acting.items():
        shift = readings.shift(name, source.stated.standard)
        assert shift is not None
        shifts[name] = shift
    whole = cells.size == e.readings.f.shape[0]  # else a choice of the readings was fitted
    noise = [n._replace(u_f=n.u_f.reshape(table.layout.size, -1)[cells]) for n in sources.noise] if whole else []
    if not whole and (e.readings.u_f > 0).any():
        noise = [Noise("readings", MEANINGS["readings"], e.readings.u_f, math.inf, STORED)]
    return FitBudget(prior_of_fit(fitted), fitted, e, shifts, noise, missing, cells if whole else None)


def _groups(wi: Direction) -> np.ndarray:
    """Numbers of the incidences (n,), of many several together."""
    rounded = np.round(np.stack([np.asarray(c) for c in wi], axis=1), 6)
    return np.unique(rounded, axis=0, return_inverse=True)[1].ravel() % MOST_GROUPS


def inverse_of(matrix: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """(JᵀJ)⁻¹ over the numbers that move, 0 for the others; combinations without effect are left alone."""
    inverse, index = np.zeros_like(matrix), np.flatnonzero(moving & (np.diagonal(matrix) > 0))
    lengths = np.sqrt(np.diagonal(matrix)[index])
    scaled = matrix[np.ix_(index, index)] / np.outer(lengths, lengths)
    small = np.linalg.pinv(scaled, LOST * max(index.size, 1), hermitian=True)
    inverse[np.ix_(index, index)] = small / np.outer(lengths, lengths)
    return inverse


def _left_out(sums: Sums, inverse: np.ndarray) -> np.ndarray | None:
    """Covariance (P, P) by what residuals hold beyond noise and the shifts of systematic terms; None where nothing.

    The shifts are first fitted to the residuals, each within its uncertainty.
    """
    p, total, number = inverse.shape[0], sums.total, sums.groups.shape[0]
    if number < 2 or sums.expected <= 0:
        return None
    rows, r = total[:-1, :-1], total[:-1, -1]
    # The numbers eliminated first: of a shift that they can follow, such as a gain, nothing is then told.
    followed = inverse @ rows[:p, p:]
    shifts = rows[p:, p:] - rows[p:, :p] @ followed
    b = -np.linalg.solve(shifts + np.eye(shifts.shape[0]), r[p:] - followed.T @ r[:p])
    x = np.append(-inverse @ r[:p] - followed @ b, b)
    chi2 = total[-1, -1] + 2 * x @ r + x @ rows @ x
    if chi2 <= sums.expected * (1 + STRUCTURE * math.sqrt(2 / sums.count)):
        return None
    scores = sums.groups[:, :p, -1] + sums.groups[:, :p, :-1] @ x
    scatter = number / (number - 1) * scores.T @ scores - sums.noise.sum(axis=0)
    values, vectors = np.linalg.eigh(inverse @ scatter @ inverse)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
