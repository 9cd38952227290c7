"""The columns of a CSV file by what their names say: direction, value, channel or wavelength, and unit."""

import itertools
import json
import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from gonio.data.channels import Channels
from gonio.models.errors import GonioError

ANGLES = ("theta_i", "phi_i", "theta_o", "phi_o")
VECTORS = ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z")
HALF_DIFFERENCE = ("theta_h", "theta_d", "phi_d")
POLAR = ("theta", "zenith", "polar", "polarangle", "zenithangle", "angle")
AZIMUTH = ("phi", "azimuth", "azimuthangle", "azimuthal")
LIGHT = ("i", "in", "inc", "incident", "incidence", "incoming", "light", "source", "illumination", "sun", "solar")
DETECTOR = (
    "o", "out", "outgoing", "r", "refl", "reflected", "reflection", "v", "view", "viewing", "det", "detector", "sensor",
    "sc", "scatter", "scattered", "obs", "observer", "emission", "receiver", "camera",
)  # fmt: skip
OTHER_NAMES = {
    "aoi": "theta_i", "angleofincidence": "theta_i", "incidenceangle": "theta_i", "incidentangle": "theta_i",
    "sza": "theta_i", "saa": "phi_i", "vza": "theta_o", "vaa": "phi_o", "viewangle": "theta_o",
    "detectorangle": "theta_o", "scatterangle": "theta_o", "raa": "delta_phi", "relativeazimuth": "delta_phi",
    "relaz": "delta_phi", "dphi": "delta_phi", "deltaphi": "delta_phi", "phidiff": "delta_phi",
    "azimuthdifference": "delta_phi", "thetah": "theta_h", "thetahalf": "theta_h", "phih": "phi_h", "thetad": "theta_d",
    "phid": "phi_d", "lambda": "wavelength", "wavelength": "wavelength", "wl": "wavelength", "flag": "flag",
}  # fmt: skip
ROLES = (
    OTHER_NAMES
    | {v.replace("_", ""): v for v in VECTORS}
    | {
        form: f"{angle}_{side}"
        for angle, stems in (("theta", POLAR), ("phi", AZIMUTH))
        for side, words in (("i", LIGHT), ("o", DETECTOR))
        for stem in stems
        for word in words
        for form in (stem + word, word + stem)
    }
)
"""The role of a direction's column by its name in small letters, without separators."""
QUANTITY_NAMES = {
    "f": None, "fr": None, "bsdf": None, "brdf": "brdf", "brdfvalue": "brdf",
    "brf": "reflectance_factor", "reff": "reflectance_factor", "reflectancefactor": "reflectance_factor",
    "bidirectionalreflectancefactor": "reflectance_factor", "beta": "reflectance_factor",
    **{f"{kind}factor": "reflectance_factor" for kind in ("radiance", "luminance", "spectralradiance")},
     "i/f": "i_over_f", "iof": "i_over_f", "radf": "i_over_f",
    "ccbrdf": "brdf_cos", "cosinecorrectedbrdf": "brdf_cos",
    **{f"{f}cos{t}": "brdf_cos" for f in ("f", "fr", "brdf") for t in ("", "ine", "theta", "thetao", "thetar", "o")},
    **{f"{f}cos{t}": "brdf_cos_i" for f in ("f", "fr", "brdf") for t in ("thetai", "i")},
}  # fmt: skip
"""The stored quantity by the name of a value's column; None where the name leaves it open."""
LABELLED = (("R", "G", "B"), ("X", "Y", "Z"))
"""Names of channels that are columns' own."""
COLOURS = {"r": "R", "g": "G", "b": "B", "red": "R", "green": "G", "blue": "B", "x": "X", "y": "Y", "z": "Z"}
ANGLE_UNITS = dict.fromkeys(("deg", "degs", "degree", "degrees", "°", "º"), "degrees")
ANGLE_UNITS |= dict.fromkeys(("rad", "rads", "radian", "radians"), "radians")
LENGTHS_NM = {"nm": 1.0, "um": 1e3, "µm": 1e3, "μm": 1e3, "micron": 1e3, "microns": 1e3, "m": 1e9, "å": 0.1}
PER_STERADIAN = frozenset(
    ("1/sr", "sr-1", "sr^-1", "sr^(-1)", "sr⁻¹", "/sr", "1/steradian", "persteradian", "persr", "sr**-1")
)
NO_UNIT = frozenset(("", "-", "1", "none", "unitless", "dimensionless", "n/a"))
LETTERS = {"θ": "theta", "ϑ": "theta", "φ": "phi", "ϕ": "phi", "Δ": "delta", "δ": "delta", "λ": "lambda", "β": "beta"}
GREEK = str.maketrans(LETTERS)
NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d{1,3})?"
LONGEST_NAME = 200
"""Characters of a name that are looked at: no name of a column is longer."""


class Column(NamedTuple):
    """One column of a header."""

    name: str
    """As in the file."""
    role: str
    """`theta_i`, ..., `f`, `u_f`, `flag`, `wavelength`; empty for what means nothing here."""
    unit: str
    """In small letters, without blanks; empty where none is written."""
    number: float | None = None
    """Of the channel: its place in a row, or its wavelength in `length`."""
    length: str = ""
    """Unit of the wavelength; empty where none is written."""
    label: str = ""
    """Name of a channel that has no number: R, G, B, X, Y, Z."""
    quantity: str | None = None
    """What a column of role `f` holds, where its name says so."""
    coverage: float | None = None
    """k of a column of role `u_f`, where its name says it; 2 of one that it calls expanded without a number."""
    relative: bool = False
    """Whether its name says that it is a share of f."""


def column_of(name: str, unit: str = "") -> Column:
    """What a name in a header says; `unit`: from a row of units below it."""
    if (of_f := _uncertainty_column(name[:LONGEST_NAME], unit)) is not None:
        return of_f._replace(name=name)
    stem, written = _split_unit(name[:LONGEST_NAME])
    unit = written or unit
    stem = stem.lower()
    key = re.sub(r"[\s_.\-]+", "", stem.translate(GREEK))
    if key in ROLES:
        return Column(name, ROLES[key], unit)
    if unit in ANGLE_UNITS and key in (*LIGHT, *DETECTOR):  # "Incidence [°]": of an angle the side is enough
        return Column(name, "theta_i" if key in LIGHT else "theta_o", unit)
    return _value_column(name, stem, unit) or Column(name, "", unit)


def columns_of(names: Sequence[str], units: Sequence[str] = ()) -> list[Column]:
    """The columns of a header; f_r is the red channel only where f_g or f_b stand beside it."""
    columns = [column_of(n, u) for n, u in zip(names, units or [""] * len(names), strict=True)]
    labels = {c.label for c in columns}
    if not labels & {"G", "B"}:
        columns = [c._replace(label="") if re.fullmatch(r"f[_ ]?r", c.name.strip().lower()) else c for c in columns]
    bare = [c for c in columns if c.role == "f" and not c.quantity and re.fullmatch("[a-z]+", c.name.strip().lower())]
    if {c.label for c in bare if c.label} and not {"R", "G", "B"} <= labels:
        # A lone column named R, X or y is whatever it is.
        columns = [c._replace(role="") if c in bare and c.label else c for c in columns]
    return columns


def value_names(channels: Channels, quantity: str = "f") -> list[str]:
    """Names of the columns of a quantity, one for each channel, as `columns_of` reads them.

    f_450nm, or f_R, f_G, f_B, where that says all of the channels; f for one; else f_1, f_2, ..., beside a comment.
    """
    wavelengths = channels.wavelengths_nm or ()
    plain = all(a < b for a, b in itertools.pairwise(wavelengths)) and all(w == round(w, 6) for w in wavelengths)
    if wavelengths and plain and channels.names == Channels.of_wavelengths(wavelengths).names:
        return [f"{quantity}_{w:.13g}nm" for w in wavelengths]
    if channels.names in LABELLED and not wavelengths:
        return [f"{quantity}_{name}" for name in channels.names]
    return [f"{quantity}_{k + 1}" if len(channels) > 1 else quantity for k in range(len(channels))]


def channel_comments(channels: Channels) -> list[str]:
    """Comments that list the channels where `value_names` cannot; none where it does."""
    if value_names(channels)[-1] not in ("f", f"f_{len(channels)}") or channels == Channels.grey():
        return []
    wavelengths = channels.wavelengths_nm
    return [
        f"channels: {json.dumps(list(channels.names))}",
        *([f"wavelengths_nm: {json.dumps(wavelengths)}"] if wavelengths else []),
    ]


def shown(names: Sequence[str], most: int = 80) -> str:
    """Names in a sentence, shortened to so many characters."""
    text = ", ".join(name[:40] for name in names[:20])
    return text if len(text) <= most and len(names) <= 20 else f"{text[:most]}... ({len(names)} columns)"


def sole(columns: Sequence[Column], role: str) -> Column | None:
    """The column of a role; of several the one of that very name. Raises GonioError where that cannot be known."""
    those = [c for c in columns if c.role == role]
    exact = [c for c in those if c.name == role]
    if len(those) > 1 and len(exact) != 1:
        raise GonioError(f"the columns {shown([c.name for c in those])} are all {role}; rename or remove all but one")
    return (exact or those or [None])[0]


def repeated_name(names: Sequence[str]) -> str | None:
    """A name that stands in a header twice."""
    return next((name for name, count in Counter(names).items() if count > 1 and name), None)


def _split_unit(name: str) -> tuple[str, str]:
    """(name, unit) of ``theta_i [deg]``, ``f (1/sr)``, ``theta_i_deg``, ``theta_i / rad``."""
    text = name.strip()
    bracket = re.fullmatch(r"(.*?)\s*[\[({]([^\[\](){}]*(?:\(-1\))?)[\])}]", text)
    if bracket and bracket[1]:
        if (known := re.fullmatch(rf"\s*({NUMBER})\s*(\S*)\s*", bracket[2].lower())) and known[2] in {"", *LENGTHS_NM}:
            return f"{bracket[1]}_{bracket[2].strip()}", ""
        if not re.search(r"(?i)cos\s*$", bracket[1]):  # f cos(theta_o) has no unit there
            return bracket[1], re.sub(r"\s+", "", bracket[2].lower())
        return text, ""
    words = "|".join(w for w in (*ANGLE_UNITS, "1/sr", "sr-1", r"sr\^-1", "nm", "um", "µm", "μm"))
    tail = re.fullmatch(rf"(.*?[^\W\d].*?)(?:\s*[_/,]\s*|\s+in\s+|\s+)({words})", text, re.IGNORECASE)
    if tail and not re.search(r"\d\s*$", tail[1]):
        return tail[1], tail[2].lower()
    return text, ""


def _uncertainty_column(name: str, unit: str) -> Column | None:
    """A column whose name says k, per cent, or that it is relative: ``U_k2_percent``, ``rel. uncertainty``, ``U95``.

    None for names that say none of it, or are no uncertainty's.
    """
    rest, words = name.strip().replace("²", "2"), []
    if not re.match(r"(?i)(?:u|unc|sigma|std|sd|rel|expanded|standard|combined)(?![a-z])|.*uncertainty", rest):
        return None
    for pattern in (
        r"(?i)[\s_(\[,;/]*(?<![a-z])k\s*[=_]?\s*(\d(?:\.\d+)?)\s*[)\]]?",
        r"(?i)(?<=u)[\s_]?(95)(?!\d)\s*%?|[\s_(\[]*(95)\s*%[)\]]?",
        r"(?i)[\s_(\[,;/]*(?:in\s+)?(percent|per cent|pct|%)\s*[)\]]?",
        r"(?i)[\s_]*(?<![a-z])(rel(?:ative)?)(?![a-z])\.?[\s_]*",
        r"(?i)[\s_]*(?<![a-z])(expanded|combined|standard)(?=[\s_]+(?:u|unc|uncertainty)\b)[\s_]*",
    ):
        match = re.search(pattern, rest)
        words.append(next((g for g in match.groups() if g), None) if match else None)
        rest = rest[: match.start()] + ("_" if rest[match.end() :] else "") + rest[match.end() :] if match else rest
    k, level, percent, relative, kind = words
    if not any(words):
        return None
    stem, written = _split_unit(rest.strip(" _"))
    made = _value_column(name, stem.lower(), "%" if percent else written or unit)
    if made is None or made.role != "u_f":
        return None
    usual = 2.0 if level or (kind or "").lower() == "expanded" else None
    return made._replace(coverage=float(k) if k else usual, relative=bool(relative))


def _value_column(name: str, stem: str, unit: str) -> Column | None:
    """The column of a value, a wavelength or an uncertainty; None for anything else."""
    if flag := re.fullmatch(rf"flag[_ ]?(?:({NUMBER})([a-zµμ]*)|([a-z]+))", stem):
        number = float(flag[1]) if flag[1] else None
        label = COLOURS.get(flag[3] or "", "")
        return Column(name, "flag", unit, number, flag[2] or "", label) if number is not None or label else None
    role, rest = "f", stem
    words = r"(?:uncertainty|unc|sigma|std|sd|u)"
    if before := re.fullmatch(rf"{words}[\s_(]*(.*?)\)?", stem):
        role, rest = "u_f", before[1]
    elif after := re.fullmatch(rf"(.*?)[\s_]+{words}", stem):
        role, rest = "u_f", after[1]
    match = re.fullmatch(rf"(.*?)[\s_@:\-]*(?:lambda|wl)?[\s_@:\-=]*({NUMBER})[\s_]*([a-zµμå]*)", rest.translate(GREEK))
    if match and (match[3] in LENGTHS_NM or not match[3]) and (known := _quantity(match[1], role)) is not None:
        if not (match[1] or match[3] or "." in match[2] or float(match[2]) >= 100 or role == "u_f"):
            return None
        return Column(name, role, unit, float(match[2]), match[3], quantity=known or None)
    head, _, tail = rest.rpartition("_") if "_" in rest else ("", "", rest)
    if tail in COLOURS and (known := _quantity(head, role)) is not None and (head or role == "f"):
        return Column(name, role, unit, label=COLOURS[tail], quantity=known or None)
    known = _quantity(rest, role)
    return None if known is None or (role == "f" and not rest) else Column(name, role, unit, quantity=known or None)


def _quantity(text: str, role: str) -> str | None:
    """The stored quantity by a value's name, "" where the name leaves it open, None where it is no value's name."""
    key = re.sub(r"[\s_.\-*·×()]+", "", text)
    if not key:
        return ""
    return None if key not in QUANTITY_NAMES else QUANTITY_NAMES[key] or ""
