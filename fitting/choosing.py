"""From readings without a model to the model they ask for, spelled, with the numbers where its fit begins."""

from collections.abc import Callable

import numpy as np

from gonio.data.layout import Layout
from gonio.fitting.samples import Readings
from gonio.fitting.selection import Choice, choose
from gonio.fitting.sketch import numbers_of
from gonio.fitting.structure import with_defaults
from gonio.models.paths import changed
from gonio.models.spelling import Term, Value, parse


def turned(layout: Layout, readings: Readings) -> bool:
    """Whether readings tell of the surface's own azimuth: the light comes from more than one."""
    if layout.name in ("isotropic", "in_plane"):
        return False
    if layout.name == "half_difference":
        return layout.axes.get("phi_h", np.zeros(1)).size > 1
    x, y = (np.asarray(c, float) for c in (readings.wi.x, readings.wi.y))
    off = np.hypot(x, y) > 1e-6
    return bool(off.any()) and np.unique(np.round(np.arctan2(y[off], x[off]), 4)).size > 1


def chosen_model(
    layout: Layout, readings: Readings, loss: str, sigma: np.ndarray | None, seed: int, say: Callable[[str], None]
) -> tuple[str, tuple[Term, ...], Choice]:
    """(spelling, terms with their starts, how it was chosen) of the model that readings ask for.

    With a loss that needs a noise that is not known yet (relative to the model's own f), the structure is chosen by the
    cube root; the noise is seen in the readings either way.
    """
    if loss == "sigma" and sigma is None:
        loss = "cbrt"
    found = choose(readings, loss, sigma, turned(layout, readings), seed, say)
    text = found.chosen.spelled
    return text, _started(with_defaults(parse(text)), found, readings.f.shape[1]), found


def _started(terms: tuple[Term, ...], found: Choice, channels: int) -> tuple[Term, ...]:
    seen = found.channels
    said: dict[tuple[int, str], list[float]] = {}
    per_channel: set[tuple[int, str]] = set()
    for u, p in zip(numbers_of(found.chosen.parts, seen), found.chosen.p, strict=True):
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
