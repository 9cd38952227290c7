"""The instrument: a disc source, a disc detector, a counting signal chain, and their systematic errors."""

import dataclasses
import math

import numpy as np

from gonio.data.stated import ANGLE_TERMS, TERMS, StatedUncertainty
from gonio.instrument.pace import AXES, Angles, Pace
from gonio.models.display import Displayed
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction, from_spherical

HALF_ANGLE_MAX = math.radians(45)
PHOTONS_MAX = 1e15
"""Counts are floating-point numbers: float64 holds whole numbers up to 2^53 = 9e15."""


@dataclasses.dataclass(frozen=True)
class Systematic:
    """Errors that stay the same for all readings of one measurement.

    The arms stand at theta_i + `theta_i`, theta_o + `theta_o` and an azimuth difference larger by `phi` than
    the table says; the sample's normal is turned by `tilt_x` about the x axis, then by `tilt_y` about the y axis
    (all radians). The irradiance is reckoned from the table's angle. Every reading is multiplied by `gain`, and its
    signal has `offset` added, as a share of the white diffuser's at normal incidence.
    """

    tilt_x: float = 0.0
    tilt_y: float = 0.0
    theta_i: float = 0.0
    theta_o: float = 0.0
    phi: float = 0.0
    gain: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        domains = {"gain": "give a factor above 0", "offset": "give a share"}
        for name, value in dataclasses.asdict(self).items():
            limit = 1e6 if name in domains else math.pi / 2
            if not (math.isfinite(value) and abs(value) <= limit and (name != "gain" or value > 0)):
                domain = domains.get(name, "give radians within ±π/2")
                raise GonioError(f"the systematic error {name} is {value!r}; {domain}")

    @property
    def aligned(self) -> bool:
        """Whether the directions are what the table says."""
        return not (self.tilt_x or self.tilt_y or self.theta_i or self.theta_o or self.phi)

    def to_dict(self) -> dict[str, float]:
        """For a table's provenance: angles in degrees."""
        values = dataclasses.asdict(self)
        gain, offset = values.pop("gain"), values.pop("offset")
        degrees = {f"{name}_deg": math.degrees(angle) for name, angle in values.items()}
        return degrees | {"gain": gain} | ({"offset": offset} if offset else {})

    def true_directions(self, angles: Angles) -> tuple[Direction, Direction]:
        """(wi, wo) in the sample's own frame where the table states (theta_i, phi_i, theta_o, phi_o), radians."""
        theta_i, phi_i, theta_o, phi_o = angles
        return (
            self._in_sample_frame(theta_i + self.theta_i, phi_i),
            self._in_sample_frame(theta_o + self.theta_o, phi_o + self.phi),
        )

    def _in_sample_frame(self, theta: np.ndarray, phi: np.ndarray) -> Direction:
        x, y, z = from_spherical(theta, phi, np)
        # The normal is R_y R_x e_z, so a direction of the room is R_x⁻¹ R_y⁻¹ w for the sample.
        cos_y, sin_y = math.cos(self.tilt_y), math.sin(self.tilt_y)
        x, z = cos_y * x - sin_y * z, sin_y * x + cos_y * z
        cos_x, sin_x = math.cos(self.tilt_x), math.sin(self.tilt_x)
        return Direction(x, cos_x * y + sin_x * z, cos_x * z - sin_x * y)


ANGLES = ("source_half_angle", "detector_half_angle", "misalignment", "shadow")
"""Radians; users read degrees beside them."""
LIMITS = {
    "source_half_angle": HALF_ANGLE_MAX, "detector_half_angle": HALF_ANGLE_MAX, "shadow": math.pi,
    "misalignment": math.pi / 4, "calibration": 0.3, "noise": 1.0, "ambient": 1e6, "photons": math.inf,
    "dark": PHOTONS_MAX, "read_noise": PHOTONS_MAX, "saturation": math.inf, "tolerance": 1.0, "seconds": 1e7,
    "illuminated_radius": 1e5, "viewed_radius": 1e5,
}  # fmt: skip
"""Largest values; the smallest is 0."""
INDEX_RANGE = (0.1, 10.0)
"""Refractive indices of media that an arm may be in."""
SYSTEMATIC_TERMS = (*ANGLE_TERMS, "gain", "solid_angle", "polarization", "dark", "ambient")
"""In the order in which they are drawn."""
USUAL_PACE = Pace()
EVERYWHERE = ((0.0, math.pi), (0.0, 2 * math.pi)) * 2


@dataclasses.dataclass(frozen=True, repr=False)
class Instrument(Displayed):
    """A gonioreflectometer; the default is ideal: point apertures, no noise, no error.

    A reading is the detector's radiance over the sample's irradiance: with apertures the average of f over both discs,
    each on its side of the horizon, weighted by |cosθi| dωi and |cosθo| dωo. The detector looks at an evenly lit patch,
    so that its signal is proportional to radiance: a reading of f in an irradiance E counts
    photons·π·f·E/E(normal incidence). Light that is there without the source is read with the source off and
    subtracted: f = dL/dE.

    Domains: half-angles in [0, π/4] and `shadow` in [0, π], radians; standard deviations and counts ≥ 0. Raises
    GonioError outside them, and where counts are asked for without `photons`.
    """

    source_half_angle: float = 0.0
    """Half-angle of the source's disc as the sample sees it, radians; 0 is a point."""
    detector_half_angle: float = 0.0
    """Half-angle of the detector's disc as the sample sees it, radians; 0 is a point."""
    photons: float | None = None
    """Counts expected of the perfect white diffuser at normal incidence, per reading; None: no shot noise."""
    ambient: float = 0.0
    """Light that is there without the source, as a share of `photons`."""
    dark: float = 0.0
    """Dark counts expected, per reading."""
    read_noise: float = 0.0
    """Standard deviation of the reading-out, counts."""
    noise: float = 0.0
    """Relative standard deviation of the source from reading to reading."""
    misalignment: float = 0.0
    """Standard deviation of each of the five angles of `Systematic`, radians; drawn once, from the seed."""
    calibration: float = 0.0
    """Relative standard deviation of the calibration factor; drawn once, from the seed."""
    saturation: float | None = None
    """Counts at which the detector is full; None: never."""
    shadow: float = 0.0
    """The detector blocks the source where the arms are closer than this angle, radians."""
    systematic: Systematic | None = None
    """The systematic errors themselves, instead of drawing them."""
    seconds: float = 1.0
    """Counting time of a reading, in which `photons` and `dark` are expected; a scan may state another for each."""
    pace: Pace = USUAL_PACE
    """How fast its axes move and settle."""
    ranges: tuple[tuple[float, float], ...] = EVERYWHERE
    """From where to where the axes theta_i, phi_i, theta_o, phi_o go, radians; nothing is read elsewhere. Polar angles
    beyond π/2 are behind the sample."""
    tolerance: float = 1e-3
    """Error allowed to the average over the apertures, relative to the reading, as two rules differ: what the finer of
    them is wrong by is commonly a hundredth of that."""
    illuminated_radius: float | None = None
    """Radius of the evenly lit spot on the sample, mm, whatever the angle; with `viewed_radius`, translucent samples
    lose what leaves beside the viewed spot. None: both spots are far wider than light travels below the surface."""
    viewed_radius: float | None = None
    """Radius of the viewed spot, mm, concentric with the lit one but in a scan of offsets."""
    media: tuple[float, float] | None = None
    """Refractive indices of the media in front of the sample and behind it, in which the arms are: those of entrance
    and exit for light from the front. None: the material's, of one that refracts, else air."""
    stated: tuple[StatedUncertainty, ...] = ()
    """What is stated of single terms, in place of `misalignment` and `calibration`; drawn once, from the seed."""

    def __post_init__(self) -> None:
        for name, high in LIMITS.items():
            value = getattr(self, name)
            if value is None:
                continue
            if not (isinstance(value, int | float | np.number) and 0 <= value <= high):
                came, most = (_with_unit(name, v) for v in (value, high))
                raise GonioError(f"the instrument's {name} is {came}; give from 0 to {most}")
            object.__setattr__(self, name, float(value))
        if self.photons == math.inf:
            object.__setattr__(self, "photons", None)
        if self.photons is not None and not 0 < self.photons <= PHOTONS_MAX:
            raise GonioError(
                f"photons is {self.photons:g}; give more than 0 and at most {PHOTONS_MAX:g}, or none for no shot noise"
            )
        counted = [n for n in ("dark", "read_noise", "saturation") if getattr(self, n) != getattr(Instrument, n)]
        if self.photons is None and counted:
            raise GonioError(f"{', '.join(counted)} is in counts; give photons too, which says what a count is")
        if (self.illuminated_radius is None) != (self.viewed_radius is None):
            raise GonioError("one of illuminated_radius and viewed_radius came; give both, in mm")
        if self.media is not None:
            object.__setattr__(self, "media", _two_indices(self.media))
        if not self.seconds > 0:
            raise GonioError("the instrument's seconds is 0; give the counting time of a reading, such as 1")
        for name, (low, high), (least, most) in zip(AXES, self.ranges, EVERYWHERE, strict=True):
            if not least <= low <= high <= most + 1e-12:
                came, whole = (f"{math.degrees(a):g}° to {math.degrees(b):g}°" for a, b in ((low, high), (least, most)))
                raise GonioError(f"the range of {name} is {came}; give a smaller and a larger angle of {whole}")
        if not self.tolerance > 0:
            raise GonioError("the instrument's tolerance is 0; give the relative error that is allowed, such as 1e-3")

    def facts(self) -> dict[str, str]:
        """Apertures, noise and systematic errors, as far as they are not ideal."""
        values = self.to_dict()
        groups = {
            "apertures": ("source_half_angle", "detector_half_angle", "shadow"),
            "noise": ("photons", "ambient", "dark", "read_noise", "noise", "saturation"),
            "errors": ("misalignment", "calibration", "tolerance"),
            "times": ("seconds", "settling"),
            "spots, mm": ("illuminated_radius", "viewed_radius"),
        }
        media = {"media": "" if self.media is None else f"{self.media[0]:g} in front, {self.media[1]:g} behind"}
        facts = {group: _listed({n: v for n, v in values.items() if n.removesuffix("_deg") in names})
                 for group, names in groups.items()}  # fmt: skip
        errors = {n: v for n, v in values.get("systematic", {}).items() if v != (n == "gain")}
        kind = {"kind": "" if values else "ideal: points, no noise, no error"}
        stated = ", ".join(f"{name} {text}" for name, text in values.get("uncertainty", {}).items())
        return kind | facts | media | {"stated": stated, "systematic": _listed(errors)}

    @property
    def has_apertures(self) -> bool:
        """Whether the source or the detector is larger than a point."""
        return self.source_half_angle > 0 or self.detector_half_angle > 0

    @property
    def has_noise(self) -> bool:
        """Whether a repeated reading differs."""
        return self.photons is not None or self.noise > 0

    def systematic_errors(self, seed: int) -> Systematic:
        """The errors of a measurement with this seed: `systematic` if given, else drawn with the stated deviations."""
        if self.systematic is not None:
            return self.systematic
        # A separate stream: noise is drawn by cell, from other keys.
        draw = np.random.default_rng([seed, 0x5EED]).standard_normal(len(SYSTEMATIC_TERMS))
        known = self.uncertainties
        z = dict(zip(SYSTEMATIC_TERMS, draw, strict=True)) | {"gain": np.clip(draw[5], -3.0, 3.0)}
        errors = {name: float(s.errors(z[name])) if (s := known.get(name)) else 0.0 for name in SYSTEMATIC_TERMS}
        angles = {name: errors[name] for name in ANGLE_TERMS}
        factors = [1.0 + errors[name] for name in SYSTEMATIC_TERMS if TERMS[name].acts == "factor"]
        offset = sum(errors[name] for name in SYSTEMATIC_TERMS if TERMS[name].acts == "offset")
        return Systematic(**angles, gain=math.prod(factors), offset=offset)

    @property
    def uncertainties(self) -> dict[str, StatedUncertainty]:
        """What is known of the systematic terms, by name: stated ones before `misalignment` and `calibration`."""
        usual = dict.fromkeys(ANGLE_TERMS, self.misalignment) | {"gain": self.calibration}
        known = {name: StatedUncertainty(name, u) for name, u in usual.items() if u}
        return known | {s.name: s for s in self.stated}

    def to_dict(self) -> dict:
        """The fields that are not ideal, for JSON: angles in degrees, counts and shares as given."""
        values: dict = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        values = {f.name: values[f.name] for f in dataclasses.fields(self) if values[f.name] != f.default}
        if self.systematic is not None:
            values["systematic"] = values.pop("systematic").to_dict()
        if "stated" in values:
            values["uncertainty"] = {s.name: s.text for s in values.pop("stated")}
        if "pace" in values:
            values |= {
                "settling": self.pace.settling,
                "axis_speed_deg": np.degrees(values.pop("pace").axis_speed).tolist(),
            }
        if "media" in values:
            values["media"] = list(values["media"])
        if "ranges" in values:
            values["ranges_deg"] = np.degrees(values.pop("ranges")).tolist()
        return {f"{n}_deg" if n in ANGLES else n: math.degrees(v) if n in ANGLES else v for n, v in values.items()}

    def reaches(self, angles: Angles) -> np.ndarray:
        """Whether the axes go to (theta_i, phi_i, theta_o, phi_o), radians: four arrays of one shape."""
        inside = [(low - 1e-9 <= a) & (a <= high + 1e-9) for a, (low, high) in zip(angles, self.ranges, strict=True)]
        return np.all(inside, axis=0)

    def solid_angles(self) -> tuple[float, float]:
        """Solid angles of source and detector, sr; 0 for points."""
        half_angles = self.source_half_angle, self.detector_half_angle
        source, detector = (4 * math.pi * math.sin(s / 2) ** 2 for s in half_angles)
        return source, detector


def _two_indices(media: object) -> tuple[float, float]:
    try:
        if any(isinstance(n, bool | str) for n in media):  # pyright: ignore[reportGeneralTypeIssues]
            raise TypeError
        front, behind = (float(n) for n in media)  # pyright: ignore[reportGeneralTypeIssues]
    except (TypeError, ValueError):
        raise GonioError(
            f"media is {media!r}; give two refractive indices, [in front, behind], such as [1, 1.5]"
        ) from None
    if not all(INDEX_RANGE[0] <= n <= INDEX_RANGE[1] for n in (front, behind)):
        raise GonioError(
            f"media is [{front:g}, {behind:g}]; give indices from {INDEX_RANGE[0]:g} to {INDEX_RANGE[1]:g}"
        )
    return front, behind


def _with_unit(name: str, value: object) -> str:
    if not isinstance(value, int | float | np.number):
        return repr(value)
    return f"{value:.6g} rad ({math.degrees(value):.6g}°)" if name in ANGLES else f"{value:g}"


def _listed(values: dict[str, float]) -> str:
    """Names with their values, angles in degrees."""
    units = {name: "°" if name.endswith("_deg") else "" for name in values}
    return ", ".join(f"{n.removesuffix('_deg').replace('_', ' ')} {v:g}{units[n]}" for n, v in values.items())
