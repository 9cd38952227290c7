"""The certificate: what a check found, property by property, with the error of the finding beside it."""

import dataclasses
import json
from typing import Any

from gonio.data.serialise import plain
from gonio.models.display import Displayed

PASS, FAIL, UNDECIDED, NOT_APPLICABLE = "pass", "fail", "undecided", "not applicable"
EXIT_STATUS = {PASS: 0, FAIL: 1, UNDECIDED: 3}
ESSENTIAL = ("reciprocity", "energy", "agreement")
"""What the overall verdict is about, where it was checked; the other properties count with `strict`."""

REPORTED = ("isotropy",)
"""What no law asks for: it never counts."""

NAMES = ("reciprocity", "energy", "positivity", "symmetry", "isotropy", "pole", "horizon", "agreement")


def verdict_of(residual: float, bound: float, tolerance: float) -> str:
    """pass if residual + bound ≤ tolerance, fail if residual − bound > tolerance, else undecided (also NaN)."""
    if residual + bound <= tolerance:
        return PASS
    return FAIL if residual - bound > tolerance else UNDECIDED


def worst(verdicts: list[str]) -> str:
    """fail before undecided before pass; "not applicable" does not count, and nothing left is undecided."""
    for verdict in (FAIL, UNDECIDED, PASS):
        if verdict in verdicts:
            return verdict
    return UNDECIDED


@dataclasses.dataclass
class Property:
    """One property of a material: its residual, a bound on the error of computing that, and the tolerance.

    `where` holds the angles in degrees of the worst place (and the channel, where there are several),
    `detail` one sentence for people, `facts` further numbers, `series` what a plot needs. Residual and bound
    are None where nothing could be computed.
    """

    name: str
    verdict: str
    residual: float | None
    bound: float | None
    tolerance: float | None
    where: dict[str, Any] = dataclasses.field(default_factory=dict)
    detail: str = ""
    facts: dict[str, Any] = dataclasses.field(default_factory=dict, repr=False)
    series: dict[str, list] = dataclasses.field(default_factory=dict, repr=False)


@dataclasses.dataclass(repr=False)
class Certificate(Displayed):
    """What `gonio.check` found about a model or a table (`kind`)."""

    subject: str
    kind: str
    properties: list[Property]
    strict: bool = False

    def facts(self) -> dict[str, str]:
        """The overall verdict and each property's, with residual, bound and tolerance."""
        rows = {}
        for p in self.properties:
            numbers = zip(("residual", "bound", "tolerance"), (p.residual, p.bound, p.tolerance), strict=True)
            known = ", ".join(f"{name} {value:.3g}" for name, value in numbers if value is not None)
            rows[p.name] = f"{p.verdict}{': ' * bool(known)}{known}"
        return {self.kind: f"{self.subject}: {self.overall.upper()}", **rows}

    @property
    def overall(self) -> str:
        """The worst verdict of reciprocity, energy and agreement; of all but isotropy if `strict`."""
        counted = [
            p.verdict for p in self.properties if p.name in ESSENTIAL or (self.strict and p.name not in REPORTED)
        ]
        return worst(counted)

    @property
    def exit_status(self) -> int:
        """0 pass, 1 fail, 3 undecided."""
        return EXIT_STATUS[self.overall]

    def __getitem__(self, name: str) -> Property:
        """The property of that name; KeyError where the check had none such."""
        for p in self.properties:
            if p.name == name:
                return p
        raise KeyError(name)

    def to_dict(self) -> dict:
        """Everything, as JSON can hold it: what is not a finite number is None."""
        return plain(
            {
                "gonio_certificate": 1,
                "subject": self.subject,
                "kind": self.kind,
                "overall": self.overall,
                "strict": self.strict,
                "exit_status": self.exit_status,
                "properties": [dataclasses.asdict(p) for p in self.properties],
            }
        )

    def to_json(self) -> str:
        """`to_dict` as JSON text, with a newline at its end."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
