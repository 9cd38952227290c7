"""Directional albedos with the bounds on their errors, and what they say: energy conservation, and uniform light."""

import dataclasses
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from gonio.checks.certificate import FAIL, PASS, UNDECIDED, Property, verdict_of
from gonio.checks.hidden_lobes import ALPHAS, Features, at_width

SENTENCE = {
    PASS: "The surface {does} no more than it receives",
    FAIL: "The surface {does} more than it receives",
    UNDECIDED: "The error of the albedo is too large for a verdict",
}
CLOSER = "Readings alone bound {n} of the albedos more closely: there the model is left out."
MOST_NAMED = 8
"""Channels whose albedos are told each."""
DOES = {"reflectance": "reflects", "transmittance": "transmits"}


@dataclasses.dataclass
class Albedos:
    """Directional albedos (n, channels) of n incidences; how much larger and smaller they may be; how they came."""

    theta_i: np.ndarray
    phi_i: np.ndarray
    value: np.ndarray
    above: np.ndarray
    """(n, channels): bound on how much larger an albedo may be."""
    below: np.ndarray
    method: str
    channels: tuple[str, ...] = ()
    """Their names, where known."""
    noise: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    """(n, channels): standard uncertainty that the readings' own make; of tables only, as what follows."""
    unseen: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, bool))
    """(n,): whether the readings leave out the mirror direction, so that a narrow lobe may hide there."""
    step_needed: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    """(n,): about the step, radians, at which a lobe such as the readings suggest would be resolved; NaN: unknown."""
    partial: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, bool))
    """(n,): whether the readings cover too little of the hemisphere: the albedo is that of what was read, at least."""
    hidden: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0, 0)))
    """(n, K, channels): the most energy that a lobe hides which is at least as wide as each of `ALPHAS`."""
    shares: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    """(n, channels) each: the reflectance and the transmittance that an albedo of both hemispheres is the sum of; NaN
    where one was not read. Nothing for albedos of reflection alone."""

    @property
    def does(self) -> str:
        """What the surface does with the light that the albedos count, in words."""
        return " and ".join(DOES[name] for name in self.shares) or "reflects"

    def with_closer(self, other: "Albedos") -> "Albedos":
        """The same with the albedos that another way to them bounds more closely; itself where incidences differ."""
        alike = self.value.shape == other.value.shape and all(
            np.allclose(getattr(self, name), getattr(other, name)) for name in ("theta_i", "phi_i")
        )
        closer = other.above < self.above if alike else np.zeros(self.value.shape, bool)
        if not closer.any():
            return self
        names = ("value", "above", "below", "noise")
        taken = {name: np.where(closer, getattr(other, name), getattr(self, name)) for name in names}
        hidden = np.where(closer[:, None], other.hidden, self.hidden)
        return dataclasses.replace(
            self, **taken, hidden=hidden, method=f"{self.method} {CLOSER.format(n=closer.sum())}"
        )

    def deciding(self, tolerance: float) -> tuple[int, int]:
        """(incidence, channel) of what decides: not finite; else surely above 1; else the one that may be largest."""
        with np.errstate(invalid="ignore"):
            surely, perhaps = self.value - self.below, self.value + self.above
        surely = np.nan_to_num(surely, nan=-np.inf)
        wild = ~np.isfinite(self.value)
        if wild.any():
            deciding = wild
        elif surely.max() > 1 + tolerance:
            deciding = surely
        else:
            deciding = np.where(perhaps == perhaps.max(), self.value, -np.inf)
        i, c = np.unravel_index(np.argmax(deciding), self.value.shape)
        return int(i), int(c)


class Incidence(NamedTuple):
    """The albedo of one incidence of a table, (channels,), its bound, and the standard uncertainty of the readings."""

    theta_i: float
    phi_i: float
    value: np.ndarray
    bound: np.ndarray
    noise: np.ndarray
    hidden: np.ndarray | None = None
    """Where the mirror direction was not read: as of `gonio.checks.hidden_lobes.hidden_energy`; None where it was."""
    step_needed: float = np.nan
    partial: bool = False


def albedos_of(rows: Iterable[Incidence], method: str, features: Features) -> Albedos | str:
    """The albedos of the incidences; or why there are none.

    Where the mirror direction was not read an albedo may be larger by what a lobe of the stated width hides, without
    one by any amount; likewise where much of the hemisphere was not read.
    """
    known = list(rows)
    if not known:
        return "no incidence was read"
    every: dict[str, Any] = {
        n: np.array([getattr(row, n) for row in known]) for n in Incidence._fields if n != "hidden"
    }
    unseen = np.array([row.hidden is not None for row in known]) & ~every["partial"]
    shape = len(known), ALPHAS.size, every["value"].shape[1]
    hidden = np.broadcast_to(0.0, shape)
    if unseen.any():
        hidden = np.stack([np.broadcast_to(0.0 if row.hidden is None else row.hidden, shape[1:]) for row in known])
    bound, more = every.pop("bound"), at_width(hidden, features.width)
    above = np.where(every["partial"][:, None], np.inf, bound + np.where(unseen[:, None], more, 0.0))
    return Albedos(above=above, below=bound, method=method, unseen=unseen, hidden=hidden, **every)


def energy_property(albedos: Albedos, tolerance: float) -> Property:
    """Energy conservation: how far a directional albedo exceeds 1, with the bound on its error at that side."""
    value, worst = albedos.value, albedos.deciding(tolerance)
    finite = np.isfinite(value)
    fails = finite.all() and value[worst] - albedos.below[worst] > 1 + tolerance
    bound = np.inf if not finite.all() else float((albedos.below if fails else albedos.above)[worst])
    residual = float(value[worst] - 1)
    verdict = verdict_of(residual, bound, tolerance) if finite.all() else UNDECIDED
    where: dict[str, Any] = {
        "theta_i": float(np.degrees(albedos.theta_i[worst[0]])),
        "phi_i": float(np.degrees(albedos.phi_i[worst[0]]) % 360),
    }
    if value.shape[1] > 1:
        where["channel"] = albedos.channels[worst[1]] if albedos.channels else worst[1]
    least = np.unravel_index(np.nanargmin(np.where(finite, value, np.inf)), value.shape)
    facts = {
        "incidences": len(value),
        "largest_albedo": float(np.max(np.where(finite, value, -np.inf))),
        "least_albedo": float(value[least]),
        "largest_loss": float(1 - value[least]),
        "loss_at_theta_i_deg": float(np.degrees(albedos.theta_i[least[0]])),
    }
    size = f"±{bound:.2g}" if np.isfinite(bound) else "with an error that has no bound"
    known = not bound >= max(abs(value[worst]), 0.01)
    albedo = f"{value[worst]:.6g} ({size})" if known else f"not known ({value[worst]:.3g} {size})"
    detail = (
        f"{SENTENCE[verdict].format(does=albedos.does)}: albedo {albedo} at θi {where['theta_i']:.4g}°; it loses up to"
        f" {max(facts['largest_loss'], 0.0):.3g} (at θi {facts['loss_at_theta_i_deg']:.4g}°). {albedos.method}"
    )
    if albedos.shares:
        facts |= _shares_at(albedos, worst)
        detail += _shares_in_words(facts)
    return Property("energy", verdict, residual, bound, tolerance, where, detail, facts)


def _shares_at(albedos: Albedos, place: tuple[int, int]) -> dict[str, Any]:
    """Reflectance, transmittance and what is left, at one incidence and channel; None for what was not read."""
    known = {name: float(albedos.shares[name][place]) if name in albedos.shares else np.nan for name in DOES}
    known["absorptance"] = 1 - known["reflectance"] - known["transmittance"]
    return {name: value if np.isfinite(value) else None for name, value in known.items()}


def _shares_in_words(facts: dict[str, Any]) -> str:
    """The shares there, and which hemisphere was not looked at."""
    named = zip(("R", "T", "absorbed"), (facts[k] for k in (*DOES, "absorptance")), strict=True)
    words = ", ".join(f"{symbol} {value:.4g}" for symbol, value in named if value is not None)
    unread = {"reflectance": "Reflection", "transmittance": "Transmission"}
    return f" There {words}." + "".join(f" {unread[k]} was not looked at." for k in DOES if facts[k] is None)


def with_hemispherical(judged: Property, albedos: Albedos) -> Property:
    """The same property with the albedo under uniform light, where all albedos are finite and its error has a bound."""
    if not np.isfinite(albedos.value).all():
        return judged
    # Of light from both sides that from the front.
    lit = albedos.theta_i < np.pi / 2 if (albedos.theta_i < np.pi / 2).any() else np.full(albedos.theta_i.shape, True)
    bound = np.maximum(albedos.above, albedos.below)
    value, bound = hemispherical(albedos.theta_i[lit], albedos.value[lit], bound[lit])
    judged.facts |= {"hemispherical_albedo": value.tolist(), "hemispherical_bound": bound.tolist()}
    if np.isfinite(bound).all():
        judged.detail += f" Under uniform light its albedo is {_of_channels(value, bound)}."
    return judged


def _of_channels(value: np.ndarray, bound: np.ndarray) -> str:
    """Albedos (channels,) with their bounds; of many channels the least and the largest, and how many have which."""
    each = [_with_bound(float(v), float(b)) for v, b in zip(value, bound, strict=True)]
    if len(each) <= MOST_NAMED:
        return ", ".join(each)
    known = [k for k, text in enumerate(each) if not text.startswith("not")]
    if not known:
        return f"not known in any of {len(each)} channels (±{bound.min():.1g} at the least)"
    low, high = min(known, key=lambda k: value[k]), max(known, key=lambda k: value[k])
    others = f", and not known in {len(each) - len(known)}" if len(known) < len(each) else ""
    return f"{each[low]} to {each[high]} in {len(known)} of {len(each)} channels{others}"


def _with_bound(value: float, bound: float) -> str:
    """An albedo with its bound, or that it is not known, where the bound leaves nothing of it."""
    return f"{value:.4g} (±{bound:.1g})" if bound < max(value, 0.01) else f"not known (±{bound:.1g})"


def hemispherical(theta: np.ndarray, value: np.ndarray, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(bihemispherical albedo, bound), each (channels,): ∫ E d(sin²θ) over the incidences, and how far it may be off.

    `theta` (n,), radians, `value` and `bound` (n, channels), finite; incidences given several times (azimuths) are
    averaged. Monotone cubics between the incidences [Fritsch & Carlson 1980]; the error is that of every second one.
    Below the first incidence and beyond the last E is held constant, and may there be anything from 0 to 1, or to
    itself where it is larger. Fewer than four incidences have an infinite bound.
    """
    nodes, group = np.unique(np.round(np.minimum(theta, np.pi - theta), 9), return_inverse=True)
    count = np.bincount(group)[:, None]
    e, b = (np.stack([np.bincount(group, c) for c in v.T], -1) / count for v in (value, bound))
    if nodes.size < 4:
        return e.mean(axis=0), np.full(e.shape[1], np.inf)
    t = np.sin(nodes) ** 2
    beyond = t[0] + 1 - t[-1]
    total = _between(t, e) + t[0] * e[0] + (1 - t[-1]) * e[-1]
    rough = np.unique(np.append(np.arange(0, t.size, 2), t.size - 1))
    missed = np.abs(_between(t, e) - _between(t[rough], e[rough]))
    # Of a monotone cubic through twice as many nodes a quarter remains, at the least.
    edge = t[0] * np.maximum(np.abs(e[0]), 1) + (1 - t[-1]) * np.maximum(np.abs(e[-1]), 1)
    inner = np.sum((b[1:] + b[:-1]) / 2 * np.diff(t)[:, None], axis=0) + beyond * b.max(axis=0)
    return total, missed / 2 + edge + inner


def _between(t: np.ndarray, e: np.ndarray) -> np.ndarray:
    """The integral (channels,) of monotone cubics through e (n, channels) at t (n,), three at the least."""
    # By hand: SciPy's take a third of a second to import. Means of slopes by Fritsch & Butland 1984, as there.
    h = np.diff(t)[:, None]
    m = np.diff(e, axis=0) / h
    before, after = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    same = m[:-1] * m[1:] > 0
    safe = [np.where(same, a, 1.0) for a in (m[:-1], m[1:])]
    inner = np.where(same, (before + after) / (before / safe[0] + after / safe[1]), 0.0)
    ends = [_end_slope(h[k], h[n], m[k], m[n]) for k, n in ((0, 1), (-1, -2))]
    d = np.concatenate([ends[0][None], inner, ends[1][None]])
    return np.sum(h * (e[1:] + e[:-1]) / 2 + h**2 / 12 * (d[:-1] - d[1:]), axis=0)


def _end_slope(h: np.ndarray, next_h: np.ndarray, m: np.ndarray, next_m: np.ndarray) -> np.ndarray:
    """The slope of three points at the first one, which neither turns nor overshoots."""
    d = ((2 * h + next_h) * m - h * next_m) / (h + next_h)
    d = np.where(np.sign(d) == np.sign(m), d, 0.0)
    return np.where((np.sign(m) != np.sign(next_m)) & (np.abs(d) > 3 * np.abs(m)), 3 * m, d)
