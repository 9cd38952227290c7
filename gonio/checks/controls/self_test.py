"""`gonio check` judged by itself: published violations, mutants and lawful subjects whose verdicts are known."""

import dataclasses
from collections.abc import Iterator

from gonio.checks.certificate import FAIL, NOT_APPLICABLE, PASS, UNDECIDED, Certificate
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
    from gonio.checks.controls.table_mutants import honest_tables, table_mutants

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
    for t in honest_tables():
        yield must_pass("honest table", t.mistake, check(t.table, against=t.meant), undecided=t.undecided)
    for t in table_mutants():
        yield must_fail("mutant table", t.mistake, t.gives_away, check(t.table, against=t.meant))


def must_fail(kind: str, subject: str, law: str, certificate: Certificate) -> Judgement:
    """Right if the law fails and, where only a truth gives the mistake away, all others do not."""
    right = certificate[law].verdict == FAIL
    if law == TRUTH:
        right = right and all(p.verdict != FAIL for p in certificate.properties if p.name != law)
    return Judgement(kind, subject, law, _outcome(certificate), right)


def must_pass(
    kind: str, subject: str, certificate: Certificate, condition: bool = True, undecided: tuple[str, ...] = ()
) -> Judgement:
    """Right if every property passes that applies, but for those that are to be undecided, and the condition holds."""
    outcome = _outcome(certificate)
    expected = ", ".join(f"{name} {UNDECIDED}" for name in undecided) or PASS
    return Judgement(kind, subject, expected, outcome, condition and outcome == expected)


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
