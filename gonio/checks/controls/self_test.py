"""`gonio check` judged by itself: liars, mutants and honest subjects whose verdicts are known beforehand."""

import dataclasses
from collections.abc import Callable, Iterator

from gonio.checks.certificate import FAIL, PASS, Certificate
from gonio.checks.controls.known_violations import HONEST, LIARS, LOSERS, SEEN_LOSS


@dataclasses.dataclass(frozen=True)
class Judged:
    """One subject: what it is, what was expected, what was found, and whether that is right."""

    kind: str
    """liar, loser, honest, mutant, honest table, or mutant table."""
    subject: str
    expected: str
    """The property that fails, or "pass"."""
    found: str
    """The properties that failed or were undecided, or "pass"."""
    right: bool


def self_test() -> Iterator[Judged]:
    """Judges every subject, one after another. A lawless subject must fail in the law that it breaks.

    Mutants that break no law must pass all laws and fail against the model that was meant.
    """
    from gonio.checks.certify import check

    for expression, law in LIARS.items():
        yield _caught("liar", expression, law, check(expression))
    for expression in LOSERS:
        certificate = check(expression)
        told = certificate["energy"].facts["largest_loss"] > SEEN_LOSS
        yield _passed("loser", expression, certificate, told, "pass, losing")
    for expression in HONEST:
        yield _passed("honest", expression, check(expression))
    yield from _mutants(check)


def _mutants(check: Callable) -> Iterator[Judged]:
    from gonio.checks.controls.model_mutants import mutants
    from gonio.checks.controls.table_mutants import honest_table, material, table_mutants

    for m in mutants():
        yield _caught("mutant", m.mistake, m.gives_away, check(m.model, against=m.meant, name=m.mistake))
    yield _passed("honest table", "the table that was meant", check(honest_table(), against=material()))
    for t in table_mutants():
        yield _caught("mutant table", t.mistake, t.gives_away, check(t.table, against=material()))


def _said(certificate: Certificate) -> str:
    wrong = [
        p.name if p.verdict == FAIL else f"{p.name} {p.verdict}"
        for p in certificate.properties
        if p.verdict not in (PASS, "not applicable")
    ]
    return ", ".join(wrong) or PASS


def _caught(kind, subject, law, certificate) -> Judged:
    right = certificate[law].verdict == FAIL
    if law == "agreement":
        # That no law gives it away is part of what is claimed of it.
        right = right and all(p.verdict != FAIL for p in certificate.properties if p.name != law)
    return Judged(kind, subject, law, _said(certificate), right)


def _passed(kind, subject, certificate, told=True, expected=PASS) -> Judged:
    right = told and all(p.verdict in (PASS, "not applicable") for p in certificate.properties)
    return Judged(kind, subject, expected, _said(certificate), right)


def confusion(judged: list[Judged]) -> dict[str, dict[str, int]]:
    """Numbers of subjects, right and wrong, for each kind and expectation."""
    table: dict[str, dict[str, int]] = {}
    for one in judged:
        row = table.setdefault(f"{one.kind}: {one.expected}", {"right": 0, "wrong": 0})
        row["right" if one.right else "wrong"] += 1
    return table
