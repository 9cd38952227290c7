"""Where the uncertainty of a table's quantities comes from, as far as the table stores it."""

import math
from typing import Any

import numpy as np

from gonio.metrology.budget import Budget, Contribution
from gonio.metrology.measurands import ALBEDO
from gonio.metrology.quantities import Quantities, quantities
from gonio.metrology.quantity import Quantity
from gonio.metrology.sources import sources_of
from gonio.models.errors import GonioError
from gonio.reports.subject import ReportSubject

INCIDENCES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)
"""Degrees: albedos near these are listed."""
MOST_READINGS = 2_000_000
MOST_COLUMNS, LEAST_SHARE = 7, 0.02
"""Sources that have a column, and the share of some u that they make at least; the others have one together."""
LISTED = ("albedo", "reflectance", "transmission", "gloss", "fit")
"""Groups of quantities."""
COMPUTED = ("reflectance", "gloss", "transmission")
"""Those of standards."""
NOTHING = 1e-4
"""Per cent."""
MOST_FITTED = 300_000
"""Readings beyond which a fit is not made again for its budget."""


def budget_of(s: ReportSubject) -> dict[str, Any] | None:
    """The budget of a subject in its shown channel; None of models, and without a source."""
    table = s.table
    if table is None or s.empty or table.interpolant is not None or not table.layout.size:
        return None
    readings = table.layout.size * len(table.channels)
    if readings > MOST_READINGS:
        return None
    sources = sources_of(table, None, {})
    if not (sources.noise or sources.acting):
        return None
    if table.layout.in_half_vectors:  # whose integrals take seconds each
        return _section(s, quantities(table.only([s.channel]), budget=True, only=COMPUTED))
    fit = s.fits[0] if s.fits and readings <= MOST_FITTED else None
    try:
        made = quantities(table, budget=True, fit=fit, only=COMPUTED)
    except GonioError:  # a fit of a kind that has no budget
        made = quantities(table, budget=True, only=COMPUTED)
    return _section(s, made)


def _section(s: ReportSubject, made: Quantities) -> dict[str, Any] | None:
    b = made.budget
    assert b is not None
    rows = [k for k, q in enumerate(made.quantities) if q.channel in (s.channel, "") and _listed(made, q)]
    if not rows:
        return None
    shares = {
        c.name: float(np.max(np.abs(c.values[rows]) / np.maximum(b.standard[rows], 1e-300))) for c in b.contributions
    }
    known = sorted((c for c in b.contributions if shares[c.name] > 0), key=lambda c: -shares[c.name])
    if not known:
        return None
    columns = [c for c in known[:MOST_COLUMNS] if shares[c.name] >= LEAST_SHARE]
    return {
        "channel": s.in_channel,
        "columns": [_name(c) for c in columns] + ["others"] * (len(columns) < len(known)),
        "sources": [_source(c) for c in known],
        "rows": [_row(made.quantities[k], b, columns, k) for k in rows],
        "not_known": [{"name": name.replace("_", " "), "why": why} for name, why in b.missing.items()],
    }


def _listed(made: Quantities, q: Quantity) -> bool:
    if q.group not in LISTED:
        return False
    if q.name != ALBEDO:
        return True
    albedos = [other.angles for other in made.quantities if other.name == ALBEDO]
    thetas, first = {a["theta_i"] for a in albedos}, min(a.get("phi_i", 0.0) for a in albedos)
    near = {min(thetas, key=lambda t: abs(t - wanted)) for wanted in INCIDENCES}
    return q.angles["theta_i"] in near and q.angles.get("phi_i", 0.0) == first


def _row(q: Quantity, b: Budget, columns: list[Contribution], k: int) -> dict[str, Any]:
    parts = [abs(float(c.values[k])) for c in columns]
    named = {_name(c) for c in columns}
    others = math.sqrt(sum(float(c.values[k]) ** 2 for c in b.contributions if _name(c) not in named))
    u, value = float(b.standard[k]), abs(q.value)
    percent = [100 * part / value if value else math.nan for part in (*parts, others)]
    return {
        "name": q.name, "place": q.place, "value": q.value, "standard_uncertainty": u,
        "expanded_uncertainty": float(b.expanded[k]), "effective_degrees_of_freedom": float(b.dof[k]),
        "percent": [0.0 if p < NOTHING else p for p in percent],
        "largest": parts.index(max(parts)) if u > 0 else None,
    }  # fmt: skip


def _name(c: Contribution) -> str:
    return c.name.replace("_", " ")


def _source(c: Contribution) -> dict[str, Any]:
    angle = c.unit == "rad"
    size = None if c.standard is None else math.degrees(c.standard) if angle else 100 * c.standard
    return {
        "name": _name(c), "meaning": c.meaning, "standard_uncertainty": size,
        "unit": "°" if angle else " %", "distribution": c.shape, "degrees_of_freedom": c.dof, "origin": c.origin,
        "errors": "the same in all readings" if c.shared else "of the integral" if c.name == "interpolation"
        else "new in each reading",
    }  # fmt: skip
