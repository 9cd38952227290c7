"""Fits of lobe families that the selection leaves out: they seldom win, and make every selection dearer.

Where much hangs on how closely a model follows the readings, they are tried in place of the lobes that were selected,
and beside them.
"""

from collections.abc import Iterator

from gonio.data.table import Table
from gonio.fitting.fit_table import fit
from gonio.fitting.result import FitResult
from gonio.fitting.selection.term_spec import FACETS, MAX_LOBES
from gonio.models.errors import GonioError
from gonio.models.expression.builder import terms_to_expression
from gonio.models.expression.parser import Call, Term, Value, parse

SCHLICK = {"f0": Value(None, free=True)}
FAMILIES = tuple(Term(None, Call(name, SCHLICK, {})) for name in ("gtr", "cook_torrance", "beckmann", "ggx"))
"""What is tried: lobes with Schlick's Fresnel factor."""
REPLACED = (*FACETS, "ggx", "gtr", "cook_torrance", "retro", "charlie", "harvey_shack")
ROUNDS, STARTS = 3, 3
"""How often the best one is grown again, and random starts of each fit."""
CLEAR = 10.0
"""Of BIC, by which another model has to be better [Kass & Raftery 1995]."""


def in_further_families(table: Table, selected: FitResult) -> FitResult:
    """The fit of the lowest BIC among a selected model and others grown out of it, family by family."""
    best = selected
    for _ in range(0 if selected.exact else ROUNDS):
        better = best
        for model in _others(best.requested):
            other = _fitted(table, model)
            better = min(filter(None, (better, other)), key=lambda r: r.bic)
            if better.exact:
                return better
        if not better.bic < best.bic - CLEAR:
            break
        best = better
    return best


def _fitted(table: Table, model: str) -> FitResult | None:
    try:
        result = fit(table, model, starts=STARTS)
    except GonioError:  # too few readings
        return None
    return result if result.converged else None


def _others(expression: str) -> Iterator[str]:
    """Models with one lobe of another family, or with one more."""
    terms = parse(expression)
    lobes = [k for k, t in enumerate(terms) if t.call.name in REPLACED and not _is_brushed(t)]
    made = [(*terms[:k], other, *terms[k + 1 :]) for k in lobes for other in FAMILIES if other != terms[k]]
    if len(lobes) < MAX_LOBES:
        made += [(*terms, other) for other in FAMILIES]
    yield from dict.fromkeys(map(terms_to_expression, made))


def _is_brushed(term: Term) -> bool:
    return "alpha_x" in term.call.values
