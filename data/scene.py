"""Scenes: directions and channels that matter, their weights, and the tolerated error of the radiance.

    gonio_scene = 1
    name = "a car under low sun"
    tolerance = 0.05                # rms error of the radiance over its rms

    [[light]]
    theta = [70, 85]                # degrees from the surface's normal; a light somewhere in there
    weight = 0.8                    # irradiance on a plane that faces it

    [[light]]
    theta = [0, 90]
    fills = true                    # light from all of it at once, as from a sky
    weight = 0.2

    [[view]]
    theta = [0, 80]                 # phi = [0, 360] unless given; weight = 1

Beyond 90° lights and views are behind the sample: light from there reaches views in front through it, and ``theta =
[0, 180]`` is the whole sphere. Optional: ``description``, and ``channels``, names of the channels that matter (all of
them if not given).
"""

import dataclasses
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gonio.data.channels import LONGEST_NAME
from gonio.data.files import check_keys, read_toml
from gonio.data.files import stem as file_stem
from gonio.data.highlights import MIN_TILT, facet_density, facet_direction
from gonio.models.display import Displayed, listed
from gonio.models.errors import GonioError, nearest, one_line
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.low_discrepancy import low_discrepancy
from gonio.models.geometry.sides import HORIZON, Sides, side_in_words

LARGEST = 1 << 20  # bytes
FOLDER = Path(__file__).parent / "scenes"
SKY = 8  # directions of a light that fills its range, for each view
TURNS = (0.6180339887498949, 0.4142135623730951)  # of one direction of a sky to the next: irrational, so even
MAX_THETA = 89.0  # degrees from the normal of a side: beyond, a surface sends nothing that a table could hold
GRAZING = math.cos(math.radians(MAX_THETA))
MOST_RANGES = 256  # lights, or views
_KEYS = {
    "name": (str, "a text"), "description": (str, "a text"), "tolerance": (object, ""), "light": (list, "[[light]]"),
    "channels": (list, "a list of names, such as ['R', 'G', 'B']"), "view": (list, "[[view]]"),
}  # fmt: skip
_VIEW_KEYS = {"theta": (object, ""), "phi": (object, ""), "weight": (object, "")}
_LIGHT_KEYS = {**_VIEW_KEYS, "fills": (bool, "true or false")}


@dataclasses.dataclass(frozen=True)
class Range:
    """Directions of a light or of views: theta and phi from, to (radians), their weight, whether light fills them."""

    theta: tuple[float, float]
    phi: tuple[float, float]
    weight: float
    fills: bool = False

    @property
    def sides(self) -> frozenset[int]:
        """1 where some of it is in front of the sample, −1 where some is behind."""
        ends = zip((1, -1), self.theta, strict=True)
        return frozenset(side for side, theta in ends if side * math.cos(theta) > HORIZON)

    @property
    def _left_out(self) -> float:
        """Of the cosines: the band about the horizon, where the range goes across it."""
        return 2 * GRAZING if len(self.sides) > 1 else 0.0

    def directions(self, u: np.ndarray, v: np.ndarray) -> Direction:
        """Directions even over the solid angle of the range, for u and v in [0, 1)."""
        low, high = (math.cos(t) for t in self.theta)
        z = low + (high - low + self._left_out) * u
        z = np.where(z < GRAZING, z - self._left_out, z)
        phi = self.phi[0] + (self.phi[1] - self.phi[0]) * v
        s = np.sqrt(np.maximum(0.0, 1.0 - z * z))
        return Direction(s * np.cos(phi), s * np.sin(phi), z)

    def __str__(self) -> str:
        low, high, first, last = (math.degrees(a) for a in (*self.theta, *self.phi))
        text = f"θ {low:g}–{high:g}°" + ("" if last - first == 360 else f", φ {first:g}–{last:g}°")
        return f"{text}{', filled' * self.fills}, weight {self.weight:g}"

    @property
    def solid_angle(self) -> float:
        """Steradians; 0 for a single angle."""
        return (math.cos(self.theta[0]) - math.cos(self.theta[1]) - self._left_out) * (self.phi[1] - self.phi[0])

    def contains(self, w: Direction) -> np.ndarray:
        """Which directions lie in the range."""
        theta = np.arctan2(np.hypot(w.x, w.y), w.z)
        phi = (np.arctan2(w.y, w.x) - self.phi[0]) % (2 * math.pi)
        inside = (theta >= self.theta[0]) & (theta <= self.theta[1]) & (phi <= self.phi[1] - self.phi[0] + 1e-12)
        return inside & (np.abs(w.z) >= self._left_out / 2)


@dataclasses.dataclass(frozen=True)
class ScenePairs:
    """N pairs of directions that make up the K radiances of a scene's views.

    The radiance of view k is Σ amount·f over the pairs with `view` == k; it counts with `share` (K,), which sums to 1.
    """

    wi: Direction
    wo: Direction
    view: np.ndarray
    amount: np.ndarray
    share: np.ndarray

    def radiances(self, f: np.ndarray) -> np.ndarray:
        """(K, channels) from f (N, channels), 1/sr."""
        each = [np.bincount(self.view, self.amount * f[:, c], minlength=self.share.size) for c in range(f.shape[1])]
        return np.stack(each, axis=1)

    def rms(self, f: np.ndarray) -> float:
        """Root mean square of the radiances that f (N, channels), 1/sr, makes, each counted by its share."""
        return float(np.sqrt(np.sum(self.share[:, None] * self.radiances(f) ** 2) / f.shape[1]))

    def error(self, f: np.ndarray, truth: np.ndarray) -> float:
        """The rms error of the radiance that f (N, channels) makes over the rms of the true; NaN where that is 0."""
        whole = self.rms(truth)
        return self.rms(f - truth) / whole if whole > 0 else float("nan")

    def mirrored(self) -> "ScenePairs":
        """The same with all lights and views mirrored into the front."""
        wi, wo = (w._replace(z=np.abs(w.z)) for w in (self.wi, self.wo))
        return dataclasses.replace(self, wi=wi, wo=wo)

    def by_side(self) -> "dict[tuple[int, int], tuple[np.ndarray, ScenePairs]]":
        """Numbers of the pairs between each two sides, and these, mirrored into the front: radiances are their sum."""
        light, detector = (np.where(w.z > 0, 1, -1) for w in (self.wi, self.wo))
        parts = {}
        for pair in sorted({*zip(light.tolist(), detector.tolist(), strict=True)}, reverse=True):
            here = np.flatnonzero((light == pair[0]) & (detector == pair[1]))
            wi, wo = (Direction(w.x[here], w.y[here], np.abs(w.z[here])) for w in (self.wi, self.wo))
            parts[pair] = here, ScenePairs(wi, wo, self.view[here], self.amount[here], self.share)
        return parts


@dataclasses.dataclass(frozen=True, repr=False)
class Scene(Displayed):
    """Lights, views, channels that matter (None: all) and the tolerance on the radiance."""

    name: str
    tolerance: float
    lights: tuple[Range, ...]
    views: tuple[Range, ...]
    channels: tuple[str, ...] | None = None
    description: str = ""

    def facts(self) -> dict[str, str]:
        """Name, tolerance, lights, views and channels."""
        return {
            "name": self.name,
            "tolerance": f"{self.tolerance:g} of the rms radiance",
            "lights": "; ".join(map(str, self.lights)),
            "views": "; ".join(map(str, self.views)),
            "channels": listed(self.channels or ["all"]),
            "description": self.description,
        }

    def channels_of(self, names: Sequence[str]) -> list[str] | None:
        """The channels of a table that matter in the scene, None for all; GonioError where the table lacks one."""
        if self.channels is None:
            return None
        missing = [c for c in self.channels if c not in names]
        if missing:
            raise GonioError(
                f"the scene '{self.name}' looks at channel {missing[0]!r}, and the table has {', '.join(names)}; "
                "change the scene's channels"
            )
        return list(self.channels)

    @property
    def sides(self) -> Sides:
        """Sides of (light, view) between which it looks, 1 in front and −1 behind."""
        lights, views = (frozenset[int]().union(*(e.sides for e in many)) for many in (self.lights, self.views))
        return frozenset((a, b) for a in lights for b in views)

    def require_sides(self, read: Sides, name: str) -> None:
        """Raises GonioError where a table called `name`, read between the sides `read`, leaves out what it looks at."""
        if missing := sorted(self.sides - read, reverse=True):
            lit = " --lit both" if any(light < 0 for light, _ in missing) else ""
            raise GonioError(
                f"the scene '{self.name}' looks at {'; '.join(side_in_words(*pair) for pair in missing)}, which {name} "
                f"does not hold; measure that: gonio measure SUBJECT --hemisphere both{lit} -o T.h5"
            )

    def pairs(self, count: int, index: float = 1.0) -> ScenePairs:
        """About `count` pairs of directions, the same in every call.

        A light of small extent stands at one place for each view, one that fills its range at `SKY` places at once.
        Half of the views are even over their ranges, half look where facets of every tilt mirror or refract a small
        light, which few even ones would; each counts by what it stands for. `index`: refractive index behind the sample
        over that in front, 1 where light goes straight through.
        """
        filling, small = ([e for e in self.lights if e.fills is fills] for fills in (True, False))
        number = max(2, count // (len(small) + SKY * len(filling)))
        u, v, *rest = low_discrepancy(number, 2 + 2 * len(self.lights)).T
        lights = [e.directions(rest[2 * n], rest[2 * n + 1]) for n, e in enumerate(small)]
        wo, share = self._views(u, v, lights, index)
        visible = share > 0
        wo, share = Direction(*(c[visible] for c in wo)), share[visible] / np.sum(share)
        views = np.arange(share.size)
        incident = [Direction(*(c[visible] for c in w)) for w in lights]
        view, weight = [views] * len(small), [e.weight for e in small]
        for n, e in enumerate(filling, len(small)):
            # Each view sees a whole sky: strata of it in u, turned from view to view by axes of their own.
            a, b = (
                ((c[visible][:, None] + t * np.arange(SKY)) % 1.0).ravel()
                for c, t in zip(rest[2 * n : 2 * n + 2], TURNS, strict=True)
            )
            incident.append(e.directions((np.tile(np.arange(SKY), views.size) + a) / SKY, b))
            view.append(np.repeat(views, SKY))
            weight.append(e.weight / SKY)
        wi = Direction(*(np.concatenate(c) for c in zip(*incident, strict=True)))
        amount = np.repeat(weight, [k.size for k in view]) * np.abs(wi.z)
        view = np.concatenate(view)
        return ScenePairs(wi, Direction(*(c[view] for c in wo)), view, amount, share)

    def _views(
        self, u: np.ndarray, v: np.ndarray, lights: list[Direction], index: float
    ) -> tuple[Direction, np.ndarray]:
        """Directions of views (K,) and what each stands for: 0 where it is not one of the scene's."""
        k, total = np.arange(u.size), sum(e.weight for e in self.views)
        edges = np.cumsum([e.weight / total for e in self.views])[:-1]
        which = np.searchsorted(edges, (k + 0.5) / u.size, side="right")
        even = _chosen(which, [e.directions(u, v) for e in self.views])
        if not lights or any(e.solid_angle == 0 for e in self.views):
            # A pixel sees the surface foreshortened: how much of it lies at an angle goes with that angle's cosine.
            return even, np.abs(even.z)
        tilt = MIN_TILT * (math.pi / 2 / MIN_TILT) ** u
        h = from_spherical(tilt, 2 * math.pi * v, np)
        wi = _chosen((k // 2) % len(lights), lights)
        sides = sorted(frozenset[int]().union(*(e.sides for e in self.views)), reverse=True)
        sent = [_sent(wi, h, side, index) for side in sides]
        highlights = _chosen((k // (2 * len(lights))) % len(sides), sent)
        lit = (k % 2 == 1) & np.isfinite(highlights.z)
        wo = Direction(*(np.where(lit, a, b) for a, b in zip(highlights, even, strict=True)))
        target = sum(e.weight / total / e.solid_angle * e.contains(wo) for e in self.views)
        density = 0.5 * target + 0.5 * np.mean([_density(w, wo, index) for w in lights], axis=0) / len(sides)
        return wo, np.where((k % 2 == 0) | lit, target * np.abs(wo.z) / np.where(target > 0, density, 1.0), 0.0)


def _bends(wi: Direction, side: np.ndarray | int, index: float) -> np.ndarray:
    """Index on the light's side over that on `side`, shape of wi; 1 where these are the same."""
    behind = wi.z < 0
    return np.where(behind == (np.asarray(side) < 0), 1.0, np.where(behind, index, 1.0 / index))


def _sent(wi: Direction, h: Direction, side: int, index: float) -> Direction:
    """Where facets h (K,) send lights on either side of the sample, to a side of it; below the horizon or NaN: nowhere.

    As if on the side itself, such a view stands for nothing.
    """
    bends, upright = _bends(wi, side, index), wi._replace(z=np.abs(wi.z))
    wo = Direction(*(np.full(wi.z.shape, np.nan) for _ in range(3)))
    for bend in np.unique(bends):
        there = facet_direction(upright, h, float(bend))
        wo = Direction(*(np.where((bends == bend) & (there.z > 0), a, b) for a, b in zip(there, wo, strict=True)))
    return wo._replace(z=side * wo.z)


def _density(wi: Direction, wo: Direction, index: float) -> np.ndarray:
    """Density, 1/sr, of views as facets send lights to the side that each is on."""
    bends = _bends(wi, np.sign(wo.z), index)
    upright = [w._replace(z=np.abs(w.z)) for w in (wi, wo)]
    every = {float(bend): facet_density(upright[0], upright[1], float(bend)) for bend in np.unique(bends)}
    return np.select([bends == bend for bend in every], list(every.values()))


def _chosen(which: np.ndarray, directions: Sequence[Direction]) -> Direction:
    """Of each of K directions the one of number `which`."""
    each = np.arange(which.size)
    return Direction(*(np.stack(components)[which, each] for components in zip(*directions, strict=True)))


def shipped_scenes() -> list[str]:
    """Names of the scenes that come with gonio."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_scene(scene: str | os.PathLike[str] | Scene) -> Scene:
    """A scene from the name of a shipped one, or a .toml file. GonioError, in one sentence, for what is neither."""
    if isinstance(scene, Scene):
        return scene
    text = os.fspath(scene)
    if text in shipped_scenes():
        return read_scene(FOLDER / f"{text}.toml")
    if not Path(text).exists() and not Path(text).suffix and os.sep not in text:
        raise GonioError(f"there is no scene '{text}', nor a file of that name; {nearest(text, shipped_scenes())}")
    return read_scene(text)


def read_scene(path: str | os.PathLike[str]) -> Scene:
    """A scene file of format 1. Raises GonioError, in one sentence that names file and key, for anything else."""
    return read_toml(path, "scene", LARGEST, _KEYS, lambda data: _scene(data, file_stem(path)))


def _scene(data: dict[str, Any], stem: str) -> Scene:
    tolerance = _number(data.get("tolerance"), "tolerance", 0.0, 1.0)
    if tolerance == 0.0:
        raise GonioError("tolerance is 0; give a share of the radiance above 0, such as 0.05")
    channels = data.get("channels")
    if channels is not None and not (channels and all(isinstance(c, str) for c in channels)):
        raise GonioError(f"channels is {channels!r}; give {_KEYS['channels'][1]}")
    lights, views = (_ranges(data, key) for key in ("light", "view"))
    channels = None if channels is None else tuple(channels)
    name = one_line(data.get("name", stem), LONGEST_NAME)
    return Scene(name, tolerance, lights, views, channels, data.get("description", ""))


def _ranges(data: dict[str, Any], key: str) -> tuple[Range, ...]:
    entries = data.get(key)
    if not entries or not all(isinstance(e, dict) for e in entries):
        raise GonioError(f"it has no [[{key}]]; give at least one, with theta = [from, to] in degrees")
    if len(entries) > MOST_RANGES:
        raise GonioError(f"it has {len(entries)} [[{key}]]; give at most {MOST_RANGES}, of wider ranges")
    ranges = []
    for n, e in enumerate(entries):
        where = f"{key} {n + 1}: "
        check_keys(e, _LIGHT_KEYS if key == "light" else _VIEW_KEYS, where)
        theta = _off_the_horizon(*_interval(e.get("theta"), f"{where}theta", 0.0, 180.0))
        phi = _interval(e.get("phi", [0, 360]), f"{where}phi", -360.0, 720.0)
        weight = _number(e.get("weight", 1.0), f"{where}weight", 0.0, 1e12)
        ranges.append(Range(theta, (math.radians(phi[0]), math.radians(phi[1])), weight, e.get("fills", False)))
    if sum(e.weight for e in ranges) == 0:
        raise GonioError(f"every {key} has the weight 0; give at least one above it")
    return tuple(e for e in ranges if e.weight > 0)


def _off_the_horizon(first: float, last: float) -> tuple[float, float]:
    """Radians of a range of polar angles, degrees, whose ends are no nearer to the horizon than `MAX_THETA`."""
    first = max(first, 180.0 - MAX_THETA) if first > 90.0 else min(first, MAX_THETA)
    last = max(last, 180.0 - MAX_THETA) if last > 90.0 else min(last, MAX_THETA)
    return math.radians(first), math.radians(last)


def _number(value: Any, name: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        came = "not given" if value is None else f"{value!r}"
        raise GonioError(f"{name} is {came}; give a number from {low:g} to {high:g}")
    return float(value)


def _interval(value: Any, name: str, low: float, high: float) -> tuple[float, float]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = [value, value]
    if not isinstance(value, list) or len(value) != 2:
        came = "not given" if value is None else f"{value!r}"
        raise GonioError(f"{name} is {came}; give an angle in degrees, or [from, to]")
    first, last = (_number(v, name, low, high) for v in value)
    if last < first:
        raise GonioError(f"{name} goes from {first:g} to {last:g}; give the smaller angle first")
    return first, last
