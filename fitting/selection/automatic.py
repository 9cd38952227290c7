"""From readings without a model to the model they ask for, spelled, with the numbers where its fit begins."""

import dataclasses
from collections.abc import Callable

import numpy as np

from gonio.data.layouts import Layout
from gonio.fitting.problem.parameterisation import with_defaults
from gonio.fitting.problem.readings import Readings
from gonio.fitting.selection.candidate import Choice, Tried
from gonio.fitting.selection.candidate_model import numbers_of
from gonio.fitting.selection.scene_selection import FAR, Allowed, Seen, allowed, cheapest
from gonio.fitting.selection.stepwise import choose
from gonio.models.expression.parser import Term, Value, parse
from gonio.models.expression.paths import changed


def turned(layout: Layout, readings: Readings) -> bool:
    """Whether readings tell of the surface's own azimuth: the light comes from more than one."""
    if not layout.has_azimuth_of_light:
        return False
    x, y = (np.asarray(c, float) for c in (readings.wi.x, readings.wi.y))
    off = np.hypot(x, y) > 1e-6
    return bool(off.any()) and np.unique(np.round(np.arctan2(y[off], x[off]), 4)).size > 1


def chosen_model(
    layout: Layout, readings: Readings, loss: str, sigma: np.ndarray | None, seed: int, say: Callable[[str], None]
) -> tuple[str, tuple[Term, ...], Choice]:
    """(expression, terms with their starts, how it was chosen) of the model that readings ask for.

    With a loss that needs a noise that is not known yet (relative to the model's own f), the structure is chosen by the
    cube root; the noise is seen in the readings either way.
    """
    if loss == "sigma" and sigma is None:
        loss = "cbrt"
    found = choose(readings, loss, sigma, turned(layout, readings), seed, say)
    text = found.chosen.spelled
    return text, _started(with_defaults(parse(text)), found.chosen, found.channels, readings.f.shape[1]), found


@dataclasses.dataclass(frozen=True)
class SceneChoice:
    """How a model was chosen for a scene: what was tried, with its error there, and the one that was taken."""

    options: list[Allowed]
    taken: Allowed
    asked_for: Allowed  # what the data ask for, whatever the scene
    met: bool
    choice: Choice
    tolerance: float

    def rows(self) -> list[dict]:
        """What was tried as plain data, cheapest first."""
        known = {row["model"]: row for row in self.choice.rows()}

        def verdict(a: Allowed) -> str:
            if a is self.taken:
                return "chosen: the cheapest within the tolerance" if self.met else "chosen: what the data ask for"
            if a.error > self.tolerance:
                return "beyond the tolerance"
            return "within the tolerance, dearer" if a.tried.size <= self.choice.chosen.size else "not asked for"

        extra = lambda a: {"scene_error": a.error, "cost_ns": a.cost, "verdict": verdict(a)}  # noqa: E731
        return [{**known[a.tried.spelled], **extra(a)} for a in self.options]

    def words(self, look: Seen, error: float, noise: float) -> str:
        """What the scene had to say, in a sentence; `error` of the final fit beside the readings' noise."""
        tolerance = look.scene.tolerance
        if self.met:
            said = f"the cheapest model tried that meets it; the data themselves ask for {self.asked_for.tried.spelled}"
            if self.taken.tried.spelled == self.asked_for.tried.spelled:
                said = "the cheapest model tried that meets it, and what the data themselves ask for"
            elif self.asked_for.error > tolerance:
                said += f" (error {self.asked_for.error:.2g})"
        else:
            least = min(a.error for a in self.options)
            said = f"which no model tried meets (least error {least:.2g}); this is what the data ask for"
        return f"{scene_words(look, error, noise)}: {said}"


def scene_words(look: Seen, error: float, noise: float) -> str:
    """The error for a scene, beside its tolerance."""
    beside = f", beside {100 * noise:.2g} % of noise in the readings" if noise > error / 10 else ""
    far = f", by readings {look.distance:.2g}° away from what it sees" if look.distance > FAR else ""
    return (
        f"for the scene '{look.scene.name}' the error of the reflected radiance is {100 * error:.2g} %{beside}{far} "
        f"(tolerance {100 * look.scene.tolerance:g} %)"
    )


def chosen_for_scene(
    layout: Layout,
    readings: Readings,
    loss: str,
    sigma: np.ndarray | None,
    look: Seen,
    seed: int,
    say: Callable[[str], None],
) -> tuple[str, tuple[Term, ...], SceneChoice]:
    """(expression, terms with their starts, how it was chosen) of the cheapest model within a scene's tolerance."""
    if loss == "sigma" and sigma is None:
        loss = "cbrt"
    found = choose(readings, loss, sigma, turned(layout, readings), seed, say, look.cells)
    options = allowed(found, look)
    asked_for = next(a for a in options if a.tried.parts == found.chosen.parts)
    taken = cheapest(found, options, look.scene.tolerance)
    best = taken or asked_for
    text = best.tried.spelled
    terms = _started(with_defaults(parse(text)), best.tried, found.channels, readings.f.shape[1])
    return text, terms, SceneChoice(options, best, asked_for, taken is not None, found, look.scene.tolerance)


def _started(terms: tuple[Term, ...], t: Tried, seen: int, channels: int) -> tuple[Term, ...]:
    said: dict[tuple[int, str], list[float]] = {}
    per_channel: set[tuple[int, str]] = set()
    for u, p in zip(numbers_of(t.parts, seen), t.p, strict=True):
        said.setdefault((u.part, u.name), []).append(float(p))
        if u.channel is not None:
            per_channel.add((u.part, u.name))

    def started(part: int, path: str, value: Value) -> Value:
        numbers = said.get((part, path))
        if not value.free or numbers is None:
            return value
        if (part, path) not in per_channel:
            return Value(numbers[0], free=True, each=value.each)
        # Channels beyond those that were looked at begin where the data put them.
        return Value(tuple(numbers), free=True) if seen == channels else value

    return tuple(changed(t, lambda path, v, k=k: started(k, path, v)) for k, t in enumerate(terms))
