"""Stated uncertainties of an instrument: of what is the same in all readings, and how people write them.

gain = "0.5 %"                       # one standard uncertainty
tilt = "0.05 deg rectangular"        # half-width of a rectangular distribution
solid_angle = "0.4 % k 2 dof 12"     # an expanded uncertainty with k = 2, of 12 degrees of freedom
"""

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gonio.models.errors import GonioError, nearest


class Term(NamedTuple):
    """What a source of error is, and how it acts: a `factor` on all readings, an `angle` of the instrument, an `offset`
    added to the signal, as a share of the white diffuser's at normal incidence, or `random`, new in each reading."""

    acts: str
    meaning: str


TERMS = {
    "gain": Term("factor", "calibration factor"),
    "solid_angle": Term("factor", "solid angle of the detector's aperture"),
    "polarization": Term("factor", "polarization of source and detector"),
    "dark": Term("offset", "dark signal left after its subtraction"),
    "ambient": Term("offset", "ambient light left after its subtraction"),
    "tilt_x": Term("angle", "tilt of the sample about x"),
    "tilt_y": Term("angle", "tilt of the sample about y"),
    "theta_i": Term("angle", "zero of theta_i"),
    "theta_o": Term("angle", "zero of theta_o"),
    "phi": Term("angle", "zero of the azimuth difference"),
    "repeatability": Term("random", "scatter of repeated readings"),
}  # fmt: skip
BOTH_TILTS = "tilt"
ANGLE_TERMS = tuple(name for name, term in TERMS.items() if term.acts == "angle")
SHAPES = {"normal": 1.0, "rectangular": math.sqrt(3.0), "triangular": math.sqrt(6.0), "u-shaped": math.sqrt(2.0)}
"""Distributions, and what their half-width (of the normal one: its standard deviation) is divided by."""
UNITS = {"angle": {"deg": math.radians(1.0), "°": math.radians(1.0), "mrad": 1e-3, "rad": 1.0}}
SHARES = {"%": 0.01, "": 1.0}
LARGEST = {"angle": math.pi / 4, "factor": 0.5, "offset": 10.0, "random": 1.0}
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"


class StatedUncertainty(NamedTuple):
    """A standard uncertainty, in radians or as a share, with its distribution and degrees of freedom."""

    name: str
    standard: float
    shape: str = "normal"
    dof: float = math.inf

    @property
    def text(self) -> str:
        """The same as people write it, and `stated_uncertainties` reads it."""
        angle = TERMS[self.name].acts == "angle"
        size = self.standard * SHAPES[self.shape]
        number = f"{math.degrees(size):.12g} deg" if angle else f"{100 * size:.12g} %"
        shape = "" if self.shape == "normal" else f" {self.shape}"
        return number + shape + (f" dof {self.dof:g}" if math.isfinite(self.dof) else "")

    def errors(self, z: np.ndarray) -> np.ndarray:
        """Errors of this distribution, by standard normal numbers of any shape."""
        if self.shape == "normal" and math.isinf(self.dof):
            return self.standard * z
        from scipy import special

        p = special.ndtr(z)
        if self.shape == "normal":
            return self.standard * special.stdtrit(self.dof, p)
        if self.shape == "rectangular":
            unit = 2 * p - 1
        elif self.shape == "triangular":
            unit = np.where(p < 0.5, np.sqrt(2 * p) - 1, 1 - np.sqrt(2 * (1 - p)))
        else:
            unit = np.sin(np.pi * (p - 0.5))
        return self.standard * SHAPES[self.shape] * unit


def stated_uncertainties(given: Mapping[str, object]) -> dict[str, StatedUncertainty]:
    """Stated uncertainties by the names of their terms; `tilt` stands for both tilts.

    Args:
        given: by name a text such as "0.05 deg rectangular dof 12", or a number: degrees of angles, else a share.

    Raises:
        GonioError: an unknown term, or a text that is none of these.
    """
    result = {}
    for key, value in given.items():
        names = ("tilt_x", "tilt_y") if key == BOTH_TILTS else (key,)
        if names[0] not in TERMS:
            raise GonioError(f"uncertainty has no term {key!r}; {nearest(key, [*TERMS, BOTH_TILTS])}")
        result |= {name: _stated(key, name, value) for name in names}
    return result


def _stated(key: str, name: str, value: object) -> StatedUncertainty:
    acts = TERMS[name].acts
    units = UNITS.get(acts, SHARES)
    text = f"{value!r} {next(iter(units))}" if isinstance(value, int | float) and acts == "angle" else str(value)
    match = re.fullmatch(rf"\s*({_NUMBER})\s*(%|°|deg|mrad|rad)?((?:\s+[a-z-]+(?:\s+{_NUMBER})?)*)\s*", text)
    words = dict(re.findall(rf"([a-z-]+)(?:\s+({_NUMBER}))?", match[3])) if match else {}
    shapes = [word for word in words if word in SHAPES and not words[word]]
    known = len(shapes) <= ("k" not in words) and all(
        word in shapes or (word in ("k", "dof") and words[word]) for word in words
    )
    example = "0.05 deg" if acts == "angle" else "0.5 %"
    unit = (match[2] or "") if match else None
    if match is None or unit not in units or not known or isinstance(value, bool):
        known_units = ", ".join(u for u in units if u)
        raise GonioError(
            f"the uncertainty of {key} is {str(value)!r}; give a number with its unit ({known_units}) and, if need be, "
            f"{', '.join(SHAPES)}, k and dof, such as '{example} rectangular' or '{example} k 2 dof 12'"
        )
    shape, factor, dof = shapes[0] if shapes else "normal", float(words.get("k", 1.0)), float(words.get("dof", "inf"))
    standard = float(match[1]) * units[unit] / SHAPES[shape] / factor if factor > 0 else -1.0
    if not 0 <= standard <= LARGEST[acts] or not dof >= 1:
        most = f"{math.degrees(LARGEST[acts]):g} deg" if acts == "angle" else f"{100 * LARGEST[acts]:g} %"
        raise GonioError(
            f"the uncertainty of {key} is {text!r}; give from 0 to {most}, with k above 0 and dof from 1 up"
        )
    return StatedUncertainty(name, standard, shape, dof)
