"""The description of a real instrument in a TOML file, which measure, plan and chart share.

    gonio_instrument = 1
    name = "the goniometer in the cellar"
    axis_speed = [10, 20, 10, 20]   # degrees/s of theta_i, phi_i, theta_o, phi_o, or one number for all
    settling = 0.3                  # s, from arrival to reading
    count_rate = 1e6                # counts/s of the perfect white diffuser at normal incidence
    dark_rate = 20                  # dark counts/s
    seconds = 1                     # counting time of a reading, where a scan does not say another
    source_half_angle = 0.1         # degrees; detector_half_angle and shadow (source blocked) likewise
    theta_i = [0, 80]               # range of an axis, degrees, beyond 90 behind; likewise phi_i, theta_o, phi_o
    misalignment = 0.02             # degrees: standard uncertainty of each arm angle and tilt
    calibration = 0.005             # relative standard uncertainty of the calibration factor
    noise = 0.001                   # relative standard deviation of the source from reading to reading
    media = [1.0, 1.5]              # refractive indices in front of the sample and behind it, of what the arms are in
    illuminated_radius = 5          # mm on the sample, for translucent ones; viewed_radius likewise

    [uncertainty]                   # of single terms, see `gonio.data.stated`
    gain = "0.5 %"
    tilt = "0.05 deg rectangular"

Every key but the first is optional; `read_noise`, `ambient` and `saturation` are those of `Instrument`.
"""

import math
import os
from typing import Any

from gonio.data.files import check_keys, read_toml
from gonio.data.stated import stated_uncertainties
from gonio.instrument.instrument import ANGLES, EVERYWHERE, LIMITS, Instrument
from gonio.instrument.pace import AXES, Pace
from gonio.models.errors import GonioError

LARGEST = 1 << 16  # bytes
NUMBERS = (
    *ANGLES,
    "calibration",
    "noise",
    "ambient",
    "read_noise",
    "saturation",
    "seconds",
    "illuminated_radius",
    "viewed_radius",
)
KEYS: dict[str, Any] = {
    "name": (str, "a text"), "description": (str, "a text"), "axis_speed": (object, ""),
    **dict.fromkeys((*NUMBERS, "settling", "count_rate", "dark_rate"), (int | float, "a number")),
    "media": (list, "[in front, behind]"),
    **dict.fromkeys(AXES, (list, "[from, to] in degrees")), "uncertainty": (dict, "a table of terms"),
}  # fmt: skip


def read_instrument(path: str | os.PathLike[str]) -> Instrument:
    """The instrument that a TOML file describes.

    Raises:
        GonioError: in one sentence that names the file and the key, for anything else.
    """
    return read_toml(path, "instrument", LARGEST, KEYS, _instrument)


def instrument_from(entries: dict[str, Any], where: str = "") -> Instrument:
    """The instrument of the entries of such a file, without its first. `where`: the beginning of a sentence."""
    check_keys(entries, KEYS, where)
    return _instrument(entries)


def _instrument(data: dict[str, Any]) -> Instrument:
    speed = data.get("axis_speed", 10.0)
    speeds = speed if isinstance(speed, list) else [speed]
    if not all(_is_number(v) for v in speeds) or len(speeds) not in (1, len(AXES)):
        raise GonioError(f"axis_speed is {speed!r}; give degrees/s, one number or four: of {', '.join(AXES)}")
    booleans = [key for key, value in data.items() if isinstance(value, bool)]
    if booleans:
        raise GonioError(f"{booleans[0]} is {data[booleans[0]]!r}; give a number")
    radians = tuple(math.radians(v) for v in speeds)
    numbers = {n: float(data[n]) for n in NUMBERS if n in data}
    numbers |= {n: math.radians(v) for n, v in numbers.items() if n in ANGLES}
    seconds, rate = numbers.get("seconds", 1.0), data.get("count_rate")
    pace = {"settling": float(data["settling"])} if "settling" in data else {}
    pace |= {} if rate is None else {"count_rate": float(rate)}
    counts = {} if rate is None else {"photons": rate * seconds}
    counts |= {"dark": float(data["dark_rate"]) * seconds} if "dark_rate" in data else {}
    ranges = tuple(_range(data[n], n) if n in data else e for n, e in zip(AXES, EVERYWHERE, strict=True))
    axis_speed = radians if len(radians) == len(AXES) else math.radians(speeds[0])
    counts |= {"media": tuple(data["media"])} if "media" in data else {}
    stated = tuple(stated_uncertainties(data.get("uncertainty", {})).values())
    return Instrument(pace=Pace(axis_speed=axis_speed, **pace), ranges=ranges, stated=stated, **numbers, **counts)


def instrument_of(provenance: dict[str, Any]) -> Instrument | None:
    """The simulated instrument that a table's provenance describes, but for its pace, its ranges and its actual errors.

    None where the table was not simulated, or not by an instrument that this gonio knows.
    """
    known = provenance.get("instrument")
    if known == "ideal":
        return Instrument()
    if not isinstance(known, dict):
        return None
    values = {n: known[n] for n in ("photons", *LIMITS) if n in known}
    values |= {"media": tuple(known["media"])} if isinstance(known.get("media"), list) else {}
    values |= {n: math.radians(known[f"{n}_deg"]) for n in ANGLES if _is_number(known.get(f"{n}_deg"))}
    try:
        stated = stated_uncertainties(known.get("uncertainty", {}))
        return Instrument(stated=tuple(stated.values()), **values)
    except (GonioError, AttributeError):
        return None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _range(value: list[Any], name: str) -> tuple[float, float]:
    if len(value) != 2 or not all(map(_is_number, value)):
        raise GonioError(f"{name} is {value!r}; give [from, to] in degrees")
    return math.radians(value[0]), math.radians(value[1])
