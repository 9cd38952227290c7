"""The certificate: the verdict on each property, with its residual, the error of that residual, and the worst place."""

import dataclasses
import json
from typing import Any

import numpy as np

from gonio.checks.properties import PROPERTIES
from gonio.data.serialise import finite
from gonio.models.display import Displayed

PASS, FAIL, UNDECIDED, NOT_APPLICABLE = "pass", "fail", "undecided", "not applicable"
NOT_TESTABLE = "not testable"
"""What should hold, and of which nothing was read: the whole is then undecided at best."""
EXIT_STATUS = {PASS: 0, FAIL: 1, UNDECIDED: 3}
SYMBOLS = {"theta_i": "θi", "phi_i": "φi", "theta_o": "θo", "phi_o": "φo"}


def verdict_of(residual: float, bound: float, tolerance: float) -> str:
    """pass if residual + bound ≤ tolerance, fail if residual − bound > tolerance, else undecided (also NaN)."""
    if residual + bound <= tolerance:
        return PASS
    return FAIL if residual - bound > tolerance else UNDECIDED


def worst(verdicts: list[str]) -> str:
    """fail before undecided before pass; "not testable" is undecided, "not applicable" does not count.

    Nothing that counts is undecided.
    """
    if FAIL in verdicts:
        return FAIL
    return PASS if PASS in verdicts and not {UNDECIDED, NOT_TESTABLE} & {*verdicts} else UNDECIDED


def relative_difference(a: np.ndarray, b: np.ndarray, floor: float = 0.0) -> np.ndarray:
    """2|a − b| / (|a| + |b| + floor); 0 where both are 0."""
    scale = np.abs(a) + np.abs(b) + floor
    return np.where(scale > 0, 2 * np.abs(a - b) / np.where(scale > 0, scale, 1.0), 0.0)


def place_of(angles: np.ndarray, channel: int | str | None = None) -> dict[str, Any]:
    """Where a pair of directions is: its four angles, given in radians, in degrees, and the channel if there is one."""
    degrees = np.degrees(angles) % np.array([361.0, 360.0, 361.0, 360.0])
    place = dict(zip(SYMBOLS, (float(d) for d in degrees), strict=True))
    return place if channel is None else {**place, "channel": channel}


def place_in_words(place: dict[str, Any]) -> str:
    """θi 40°, φi 0°, ...; or the region θ 40–50° and 60–70°, Δφ 30–60°; then the channel. Empty for no place."""
    words = [f"{symbol} {place[name]:.4g}°" for name, symbol in SYMBOLS.items() if name in place]
    if "theta_from" in place:
        other = (
            f"{place['other_theta_from']:g}–{place['other_theta_to']:g}° and " if "other_theta_from" in place else ""
        )
        words.append(f"θ {other}{place['theta_from']:g}–{place['theta_to']:g}°")
    if "delta_phi_from" in place:
        words.append(f"Δφ {place['delta_phi_from']:g}–{place['delta_phi_to']:g}°")
    if "channel" in place:
        words.append(f"channel {place['channel']}")
    return ", ".join(words)


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
    series: dict[str, Any] = dataclasses.field(default_factory=dict, repr=False)
    assumes: str = ""
    """What the verdict takes for granted and no reading shows; empty where it stands by itself."""


def without_residual(name: str, verdict: str, tolerance: float, detail: str, **facts: Any) -> Property:
    """A property of which nothing could be computed, and why."""
    return Property(name, verdict, None, None, tolerance, detail=detail, facts=facts)


@dataclasses.dataclass(repr=False)
class Certificate(Displayed):
    """The judged properties of a model or a table (`kind`)."""

    subject: str
    kind: str
    properties: list[Property]
    strict: bool = False
    notes: list[str] = dataclasses.field(default_factory=list)
    """What the readings are suspected of, by which every verdict would change."""

    def facts(self) -> dict[str, str]:
        """The overall verdict and each property's, with residual, bound and tolerance."""
        rows = {}
        for p in self.properties:
            numbers = zip(("residual", "bound", "tolerance"), (p.residual, p.bound, p.tolerance), strict=True)
            known = ", ".join(f"{name} {value:.3g}" for name, value in numbers if value is not None)
            rows[p.name] = f"{p.verdict}: {known}" if known else p.verdict
        return {self.kind: f"{self.subject}: {self.verdict_in_words}", **rows}

    @property
    def assumptions(self) -> list[str]:
        """What the verdicts that make the overall one take for granted, without repeats."""
        return list(dict.fromkeys(a for name in self.counted if (a := self[name].assumes)))

    @property
    def verdict_in_words(self) -> str:
        """The overall verdict in capitals, and what it assumes."""
        assumed = self.assumptions if self.overall != UNDECIDED else []
        return self.overall.upper() + f", assuming that {'; and that '.join(assumed)}" * bool(assumed)

    @property
    def counted(self) -> list[str]:
        """Names of the properties that make the overall verdict."""
        counts = ("always", "strict") if self.strict else ("always",)
        return [p.name for p in self.properties if PROPERTIES[p.name].counts in counts]

    @property
    def overall(self) -> str:
        """The worst verdict of reciprocity, energy and agreement; of all but isotropy if `strict`."""
        return worst([self[name].verdict for name in self.counted])

    @property
    def basis(self) -> str:
        """What the overall verdict is the worst of, in words."""
        if self.strict:
            never = [name for name, spec in PROPERTIES.items() if spec.counts == "never"]
            return f"all properties but {', '.join(never)}"
        *first, last = self.counted
        return f"{', '.join(first)} and {last}" if first else last

    @property
    def exit_status(self) -> int:
        """0 pass, 1 fail, 3 undecided."""
        return EXIT_STATUS[self.overall]

    def __getitem__(self, name: str) -> Property:
        """The property of that name; KeyError where it was not judged."""
        for p in self.properties:
            if p.name == name:
                return p
        raise KeyError(name)

    def to_dict(self) -> dict[str, Any]:
        """The whole certificate as JSON can hold it: what is not a finite number is None, and "null" says why."""
        return finite(
            {
                "gonio_certificate": 1,
                "subject": self.subject,
                "kind": self.kind,
                "overall": self.overall,
                "assumptions": self.assumptions,
                "strict": self.strict,
                "exit_status": self.exit_status,
                "notes": self.notes,
                "properties": [dataclasses.asdict(p) for p in self.properties],
            }
        )

    def to_json(self) -> str:
        """`to_dict` as JSON text, with a newline at its end."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
