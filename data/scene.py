"""Scenes: which directions and channels matter, how much, and what error of the reflected radiance is tolerable.

    gonio_scene = 1
    name = "a car under low sun"
    tolerance = 0.05                # rms error of the reflected radiance over its rms

    [[light]]
    theta = [70, 85]                # degrees from the surface's normal; a light somewhere in there
    weight = 0.8                    # irradiance on a plane that faces it

    [[light]]
    theta = [0, 90]
    fills = true                    # light from all of it at once, as from a sky
    weight = 0.2

    [[view]]
    theta = [0, 80]                 # phi = [0, 360] unless said; weight = 1

Optional: ``description``, and ``channels``, names of the channels that matter (all of them if not given).
"""

import dataclasses
import math
import os
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from gonio.data.files import input_size
from gonio.models.errors import GonioError, nearest
from gonio.models.geometry.directions import Direction

FORMAT = 1
LARGEST = 1 << 20  # bytes
FOLDER = Path(__file__).parent / "scenes"
SKY = 8  # directions of a light that fills its range, for each view
FLATTEST = 1e-3  # radians: tilt of the facets that views of highlights begin with
HIGHEST = 89.0  # degrees: beyond, a surface reflects nothing that a table could hold
_KEYS = ("gonio_scene", "name", "description", "tolerance", "channels", "light", "view")


@dataclasses.dataclass(frozen=True)
class Range:
    """Directions of a light or of views: theta and phi from, to (radians), their weight, whether light fills them."""

    theta: tuple[float, float]
    phi: tuple[float, float]
    weight: float
    fills: bool = False

    def directions(self, u: np.ndarray, v: np.ndarray) -> Direction:
        """Directions even over the solid angle of the range, for u and v in [0, 1)."""
        low, high = (math.cos(t) for t in self.theta)
        z = low + (high - low) * u
        phi = self.phi[0] + (self.phi[1] - self.phi[0]) * v
        s = np.sqrt(np.maximum(0.0, 1.0 - z * z))
        return Direction(s * np.cos(phi), s * np.sin(phi), z)

    @property
    def solid_angle(self) -> float:
        """Steradians; 0 for a single angle."""
        return (math.cos(self.theta[0]) - math.cos(self.theta[1])) * (self.phi[1] - self.phi[0])

    def holds(self, w: Direction) -> np.ndarray:
        """Which directions lie in the range."""
        theta = np.arctan2(np.hypot(w.x, w.y), w.z)
        turned = (np.arctan2(w.y, w.x) - self.phi[0]) % (2 * math.pi)
        return (theta >= self.theta[0]) & (theta <= self.theta[1]) & (turned <= self.phi[1] - self.phi[0] + 1e-12)


@dataclasses.dataclass(frozen=True)
class Pairs:
    """What is seen in a scene: N pairs of directions that make up K radiances.

    The radiance k is Σ amount·f over its pairs (`of` == k); it counts with `share` (K,), which sums to 1.
    """

    wi: Direction
    wo: Direction
    of: np.ndarray
    amount: np.ndarray
    share: np.ndarray

    def radiances(self, f: np.ndarray) -> np.ndarray:
        """(K, channels) from f (N, channels), 1/sr."""
        each = [np.bincount(self.of, self.amount * f[:, c], minlength=self.share.size) for c in range(f.shape[1])]
        return np.stack(each, axis=1)

    def rms(self, radiances: np.ndarray) -> float:
        """Root mean square of radiances (K, channels), each counted by its share."""
        return float(np.sqrt(np.sum(self.share[:, None] * radiances**2) / radiances.shape[1]))

    def error(self, f: np.ndarray, truth: np.ndarray) -> float:
        """The rms error of the radiance that f (N, channels) makes over the rms of the true; NaN where that is 0."""
        size = self.rms(self.radiances(truth))
        return self.rms(self.radiances(f - truth)) / size if size > 0 else float("nan")


@dataclasses.dataclass(frozen=True)
class Scene:
    """Lights, views, channels that matter (None: all) and the tolerance on the reflected radiance."""

    name: str
    tolerance: float
    lights: tuple[Range, ...]
    views: tuple[Range, ...]
    channels: tuple[str, ...] | None = None
    description: str = ""

    def channels_of(self, names: tuple[str, ...]) -> list[str] | None:
        """The channels of a table that the scene looks at, None for all; GonioError where the table lacks one."""
        if self.channels is None:
            return None
        missing = [c for c in self.channels if c not in names]
        if missing:
            raise GonioError(
                f"the scene '{self.name}' looks at channel {missing[0]!r}, and the table has {', '.join(names)}; "
                "change the scene's channels"
            )
        return list(self.channels)

    def pairs(self, count: int) -> Pairs:
        """About `count` pairs of directions, the same in every call.

        A light of small extent stands at one place for each view, one that fills its range at `SKY` places at once.
        Half of the views are even over their ranges, half look where facets of every tilt mirror a small light, which
        few even ones would; each counts by what it stands for.
        """
        filling, small = ([e for e in self.lights if e.fills is yes] for yes in (True, False))
        number = max(2, count // (len(small) + SKY * len(filling)))
        u, v, *more = _even(number, 2 + 2 * len(small), 0)
        lights = [e.directions(more[2 * n], more[2 * n + 1]) for n, e in enumerate(small)]
        wo, share = self._views(u, v, lights)
        seen = share > 0
        wo, share = Direction(*(c[seen] for c in wo)), share[seen] / np.sum(share)
        k = np.arange(share.size)
        found = [(Direction(*(c[seen] for c in w)), k, e.weight) for w, e in zip(lights, small, strict=True)]
        for n, e in enumerate(filling):
            a, b = _even(k.size * SKY, 2, 1 + n)
            # Each view sees a whole sky: strata of it in u, turned from view to view.
            sky = e.directions((np.tile(np.arange(SKY), k.size) + a) / SKY, b)
            found.append((sky, np.repeat(k, SKY), e.weight / SKY))
        wi = Direction(*(np.concatenate(c) for c in zip(*(d for d, _, _ in found), strict=True)))
        of = np.concatenate([at for _, at, _ in found])
        amount = np.concatenate([np.full(at.size, weight) for _, at, weight in found]) * wi.z
        return Pairs(wi, Direction(*(c[of] for c in wo)), of, amount, share)

    def _views(self, u: np.ndarray, v: np.ndarray, lights: list[Direction]) -> tuple[Direction, np.ndarray]:
        """Directions of views (K,) and what each stands for: 0 where it is not one of the scene's."""
        k, total = np.arange(u.size), sum(e.weight for e in self.views)
        edges = np.cumsum([e.weight / total for e in self.views])[:-1]
        mirrored = (k % 2 == 1) if lights and all(e.solid_angle > 0 for e in self.views) else np.zeros(u.size, bool)
        which = np.searchsorted(edges, (k + 0.5) / u.size, side="right")
        even = [e.directions(u, v) for e in self.views]
        wo = [np.choose(which, c) for c in zip(*even, strict=True)]
        if not mirrored.any():
            # A pixel sees the surface foreshortened: how much of it lies at an angle goes with that angle's cosine.
            return Direction(*wo), wo[2]
        tilt = FLATTEST * (math.pi / 2 / FLATTEST) ** u
        h = (np.sin(tilt) * np.cos(2 * math.pi * v), np.sin(tilt) * np.sin(2 * math.pi * v), np.cos(tilt))
        of = (k // 2) % len(lights)
        wi = [np.choose(of, c) for c in zip(*lights, strict=True)]
        twice = 2 * sum(a * b for a, b in zip(wi, h, strict=True))
        wo = Direction(*(np.where(mirrored, twice * b - a, c) for a, b, c in zip(wi, h, wo, strict=True)))
        target = sum(e.weight / total / e.solid_angle * e.holds(wo) for e in self.views)
        drawn = 0.5 * target + 0.5 * np.mean([_mirror_density(w, wo) for w in lights], axis=0)
        return wo, np.where(wo.z > 0, target * wo.z / drawn, 0.0)


def _mirror_density(wi: Direction, wo: Direction) -> np.ndarray:
    """Density, 1/sr, of wo as wi mirrored in facets whose tilt is even in its logarithm."""
    h = [a + b for a, b in zip(wi, wo, strict=True)]
    length = np.sqrt(sum(c * c for c in h))
    sine, cosine = np.hypot(h[0], h[1]) / length, h[2] / length
    tilt = np.maximum(np.arctan2(sine, cosine), FLATTEST)
    per_facet = 1.0 / (2 * math.pi * np.sin(tilt) * tilt * math.log(math.pi / 2 / FLATTEST))
    return np.where(sine >= np.sin(FLATTEST), per_facet / np.maximum(2.0 * length, 1e-9), 0.0)


def _even(count: int, dimensions: int, shift: int) -> list[np.ndarray]:
    # Kronecker's sequence with the generalised golden ratio [Roberts 2018]: even in every number of points.
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    k = np.arange(1, count + 1) + 7919 * shift
    return [(0.5 + k * ratio ** -(d + 1.0)) % 1.0 for d in range(dimensions)]


def shipped_scenes() -> list[str]:
    """Names of the scenes that come with gonio."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_scene(what: "str | os.PathLike | Scene") -> Scene:
    """A scene from the name of a shipped one, or a .toml file. GonioError, in one sentence, for what is neither."""
    if isinstance(what, Scene):
        return what
    text = os.fspath(what)
    if text in shipped_scenes():
        return read_scene(FOLDER / f"{text}.toml")
    if not Path(text).exists() and not Path(text).suffix and os.sep not in text:
        raise GonioError(f"there is no scene '{text}', nor a file of that name; {nearest(text, shipped_scenes())}")
    return read_scene(text)


def read_scene(path: str | os.PathLike) -> Scene:
    """A scene file of format 1. Raises GonioError, in one sentence that names file and key, for anything else."""
    size = input_size(path)
    if size > LARGEST:
        raise GonioError(f"{path} has {size} bytes; a scene file has at most {LARGEST}")
    try:
        data = tomllib.loads(Path(path).read_bytes().decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        first = (str(error).splitlines() or [type(error).__name__])[0]
        raise GonioError(f"{path} is not a TOML file ({first}); expected a scene") from None
    try:
        return _scene(data, Path(path).stem)
    except GonioError as error:
        raise GonioError(f"{path}: {error}") from None


def _scene(data: dict[str, Any], stem: str) -> Scene:
    if type(data.get("gonio_scene")) is not int:
        raise GonioError("it has no integer gonio_scene; a scene file begins with 'gonio_scene = 1'")
    if data["gonio_scene"] != FORMAT:
        raise GonioError(f"scene format {data['gonio_scene']} is not known; this gonio reads format {FORMAT}")
    _require_known(data, _KEYS, "")
    tolerance = _number(data.get("tolerance"), "tolerance", 0.0, 1.0)
    if tolerance == 0.0:
        raise GonioError("tolerance is 0; give a share of the radiance above 0, such as 0.05")
    channels = data.get("channels")
    if channels is not None and not (
        isinstance(channels, list) and channels and all(isinstance(c, str) for c in channels)
    ):
        raise GonioError(f"channels is {channels!r}; give a list of names, such as ['R', 'G', 'B']")
    for key in ("name", "description"):
        if not isinstance(data.get(key, ""), str):
            raise GonioError(f"{key} is {data[key]!r}; give a text")
    lights, views = (_ranges(data, key) for key in ("light", "view"))
    return Scene(
        data.get("name", stem), tolerance, lights, views,
        None if channels is None else tuple(channels), data.get("description", ""),
    )  # fmt: skip


def _ranges(data: dict, key: str) -> tuple[Range, ...]:
    entries = data.get(key)
    if not isinstance(entries, list) or not entries or not all(isinstance(e, dict) for e in entries):
        raise GonioError(f"it has no [[{key}]]; say at least one, with theta = [from, to] in degrees")
    found = []
    for n, e in enumerate(entries):
        where = f"{key} {n + 1}: "
        allowed = ("theta", "phi", "weight", "fills") if key == "light" else ("theta", "phi", "weight")
        _require_known(e, allowed, where)
        theta = _pair(e.get("theta"), f"{where}theta", 0.0, 90.0)
        phi = _pair(e.get("phi", [0, 360]), f"{where}phi", -360.0, 720.0)
        weight = _number(e.get("weight", 1.0), f"{where}weight", 0.0, 1e12)
        if not isinstance(e.get("fills", False), bool):
            raise GonioError(f"{where}fills is {e['fills']!r}; give true or false")
        theta = tuple(math.radians(min(t, HIGHEST)) for t in theta)
        found.append(Range(theta, tuple(map(math.radians, phi)), weight, e.get("fills", False)))
    if sum(e.weight for e in found) == 0:
        raise GonioError(f"every {key} has the weight 0; give at least one above it")
    return tuple(e for e in found if e.weight > 0)


def _require_known(data: dict, known: tuple[str, ...], where: str) -> None:
    for key in data:
        if key not in known:
            raise GonioError(f"{where}unknown key '{key}'; {nearest(key, known)}")


def _number(value: Any, what: str, low: float, high: float) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high
    if not good:
        came = "not given" if value is None else f"{value!r}"
        raise GonioError(f"{what} is {came}; give a number from {low:g} to {high:g}")
    return float(value)


def _pair(value: Any, what: str, low: float, high: float) -> tuple[float, float]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = [value, value]
    if not isinstance(value, list) or len(value) != 2:
        came = "not given" if value is None else f"{value!r}"
        raise GonioError(f"{what} is {came}; give an angle in degrees, or [from, to]")
    first, last = (_number(v, what, low, high) for v in value)
    if last < first:
        raise GonioError(f"{what} goes from {first:g} to {last:g}; give the smaller angle first")
    return first, last
