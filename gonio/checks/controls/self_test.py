"""`gonio check` judged by itself: published violations, mutants and lawful subjects whose verdicts are known."""

import dataclasses
from collections.abc import Iterator

from gonio.checks.certificate import FAIL, NOT_APPLICABLE, PASS, Certificate
from gonio.checks.controls.known_violations import HONEST, LEAST_LOSS, LIARS, LOSERS
from gonio.checks.controls.model_mutants import TRUTH


@dataclasses.dataclass(frozen=True)
class Judgement:
    """One subject: what it is, which verdict is expected, which was given, and whether that is right."""

    kind: str
    """liar, loser, honest, mutant, honest table, or mutant table."""
    subject: str
    expected: str
    """The property that fails, or "pass"."""
    outcome: str
    """The properties that failed or were undecided, or "pass"."""
    right: bool

    def to_dict(self) -> dict[str, str | bool]:
        """As the report of the self-test holds it."""
        return {
            "kind": self.kind, "subject": self.subject, "expected": self.expected, "found": self.outcome,
            "right": self.right,
        }  # fmt: skip


def self_test() -> Iterator[Judgement]:
    """Judges every subject, one after another. A lawless subject must fail in the law that it violates.

    Mutants that violate no law must pass all laws and fail against the model that was meant.
    """
    from gonio.checks.certify import check
    from gonio.checks.controls.model_mutants import mutants
    from gonio.checks.controls.table_mutants import honest_table, material, table_mutants

    for expression, law in LIARS.items():
        yield must_fail("liar", expression, law, check(expression))
    for expression in LOSERS:
        certificate = check(expression)
        loses = certificate["energy"].facts["largest_loss"] > LEAST_LOSS
        yield dataclasses.replace(must_pass("loser", expression, certificate, loses), expected="pass, losing")
    for expression in HONEST:
        yield must_pass("honest", expression, check(expression))
    for m in mutants():
        yield must_fail("mutant", m.mistake, m.gives_away, check(m.model, against=m.meant, name=m.mistake))
    yield must_pass("honest table", "the table that was meant", check(honest_table(), against=material()))
    for t in table_mutants():
        yield must_fail("mutant table", t.mistake, t.gives_away, check(t.table, against=material()))


def must_fail(kind: str, subject: str, law: str, certificate: Certificate) -> Judgement:
    """Right if the law fails and, where only a truth gives the mistake away, all others do not."""
    right = certificate[law].verdict == FAIL
    if law == TRUTH:
        right = right and all(p.verdict != FAIL for p in certificate.properties if p.name != law)
    return Judgement(kind, subject, law, _outcome(certificate), right)


def must_pass(kind: str, subject: str, certificate: Certificate, condition: bool = True) -> Judgement:
    """Right if every property passes that applies, and the condition holds."""
    outcome = _outcome(certificate)
    return Judgement(kind, subject, PASS, outcome, condition and outcome == PASS)


def _outcome(certificate: Certificate) -> str:
    wrong = [
        p.name if p.verdict == FAIL else f"{p.name} {p.verdict}"
        for p in certificate.properties
        if p.verdict not in (PASS, NOT_APPLICABLE)
    ]
    return ", ".join(wrong) or PASS


def confusion(judgements: list[Judgement]) -> dict[str, dict[str, int]]:
    """Numbers of subjects, right and wrong, for each kind and expectation."""
    table: dict[str, dict[str, int]] = {}
    for one in judgements:
        row = table.setdefault(f"{one.kind}: {one.expected}", {"right": 0, "wrong": 0})
        row["right" if one.right else "wrong"] += 1
    return table
