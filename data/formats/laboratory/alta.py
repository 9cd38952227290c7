"""Text of ALTA, the library of BRDF fitting: header lines ``#KEY value``, then rows of coordinates and readings.

Coordinates are radians, in one of ALTA's parametrisations. Those that name no pair of directions, and the stereographic
one, whose formula there leaves the unit sphere, are refused.
"""

import os
import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.data.channels import Channels
from gonio.data.formats.csv.conventions import Convention, convention, coverage_factor
from gonio.data.formats.csv.directions import UNIT_TOLERANCE
from gonio.data.formats.csv.listed_rows import Listing, rounding_of, table_of_listing
from gonio.data.formats.laboratory.number_rows import number_rows, text_lines
from gonio.data.layouts import spherical_angles
from gonio.data.table import Table
from gonio.models.errors import GonioError, nearest

SIGNATURE = r"(?m)^[ \t\r]*+#(?:PARAM_IN|PARAM_OUT|DIM)[ \t]"
"""How such a file is known."""
OUTPUTS = {
    "INV_STERADIAN": "brdf",
    "INV_STERADIAN_COSINE_FACTOR": "brdf_cos",
    "RGB_COLOR": "brdf",
    "XYZ_COLOR": "brdf",
}
"""What PARAM_OUT says of the values, by keys of `gonio.data.quantities.QUANTITIES`."""
MOST_OUTPUTS = 1000
Vectors = tuple[np.ndarray, np.ndarray]
"""Directions to the light and to the viewer, (3, n)."""


def _polar(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def _projected(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The direction whose polar angle is the length of (x, y), and its azimuth theirs."""
    return _polar(np.hypot(x, y), np.arctan2(y, x))


def _mirrored(w: np.ndarray, axis: np.ndarray) -> np.ndarray:
    return 2 * np.sum(w * axis, axis=0) * axis - w


def _half(theta_h: np.ndarray, phi_h: np.ndarray, theta_d: np.ndarray, phi_d: np.ndarray) -> Vectors:
    """By half and difference angles; the latter are the viewer's."""
    x, y, z = _polar(theta_d, phi_d)
    tilted = x * np.cos(theta_h) + z * np.sin(theta_h)
    view = np.stack([
        tilted * np.cos(phi_h) - y * np.sin(phi_h),
        tilted * np.sin(phi_h) + y * np.cos(phi_h),
        z * np.cos(theta_h) - x * np.sin(theta_h),
    ])  # fmt: skip
    return _mirrored(view, _polar(theta_h, phi_h)), view


def _half_vectors(c: np.ndarray) -> Vectors:
    half, difference = c[:3] / np.linalg.norm(c[:3], axis=0), c[3:] / np.linalg.norm(c[3:], axis=0)
    angles = [a for w in (half, difference) for a in spherical_angles(*w)]
    return _half(*angles)


def _about_back(c: np.ndarray) -> Vectors:
    """By the viewer's angle from the light, and its azimuth about it, 0 towards the normal."""
    light, across = _polar(c[0], 0 * c[0]), np.stack([-np.cos(c[0]), 0 * c[0], np.sin(c[0])])
    angle, azimuth = np.hypot(c[1], c[2]), np.arctan2(c[2], c[1])
    sideways = np.stack([0 * angle, np.sin(azimuth), 0 * angle])
    return light, np.cos(angle) * light + np.sin(angle) * (np.cos(azimuth) * across + sideways)


def _about_back_vector(c: np.ndarray) -> Vectors:
    """By the vector half way between the viewer and the mirror direction [Schlick 1994]."""
    light = _polar(c[0], 0 * c[0])
    return light, _mirrored(light * np.array([[-1.0], [-1.0], [1.0]]), _projected(c[1], c[2]))


def _stark(c: np.ndarray) -> Vectors:
    """By the lengths of (L + V)/2, projected, and of (L − V)/2, and the azimuth between them [Stark 2005]."""
    half = np.stack([c[0], 0 * c[0], np.sqrt(np.maximum(1 - c[0] ** 2 - c[1] ** 2, 0.0))])
    back = c[1] * _polar(np.arctan2(half[2], -c[0] * np.cos(c[2])), c[2])
    return half + back, half - back


def _neumann(c: np.ndarray) -> Vectors:
    """By the projected lengths of (L + V)/2 and (L − V)/2, and the azimuth between them [Neumann 1996]."""
    half, back = np.stack([c[0], 0 * c[0]]), c[1] * np.stack([np.cos(c[2]), np.sin(c[2])])

    def on_hemisphere(xy: np.ndarray) -> np.ndarray:
        return np.stack([*xy, np.sqrt(np.maximum(1 - np.sum(xy**2, axis=0), 0.0))])

    return on_hemisphere(half + back), on_hemisphere(half - back)


PARAMETRISATIONS: dict[str, tuple[int, Callable[[np.ndarray], Vectors]]] = {
    "SPHERICAL_TL_PL_TV_PV": (4, lambda c: (_polar(c[0], c[1]), _polar(c[2], c[3]))),
    "ISOTROPIC_TV_TL_DPHI": (3, lambda c: (_polar(c[1], 0 * c[1]), _polar(c[0], -c[2]))),
    "ISOTROPIC_TL_TV_PROJ_DPHI": (3, lambda c: (_polar(c[0], 0 * c[0]), _projected(c[1], c[2]))),
    "RETRO_TL_TVL_PROJ_DPHI": (3, _about_back),
    "SCHLICK_TL_TK_PROJ_DPHI": (3, _about_back_vector),
    "RUSIN_TH_PH_TD_PD": (4, lambda c: _half(c[0], c[1], c[2], c[3])),
    "RUSIN_TH_TD_PD": (3, lambda c: _half(c[0], 0 * c[0], c[1], c[2])),
    "RUSIN_VH_VD": (6, _half_vectors),
    "STARK_3D": (3, _stark),
    "NEUMANN_3D": (3, _neumann),
    "CARTESIAN": (6, lambda c: (c[3:], c[:3])),
}
"""Count of coordinates, and the directions to light and viewer that they make."""
IN_ANGLES = ("SPHERICAL_TL_PL_TV_PV", "ISOTROPIC_TV_TL_DPHI")
"""Those whose coordinates are angles of both directions, which printing may have rounded."""


class _Header(NamedTuple):
    """What the header states."""

    stated: dict[str, str]
    inputs: int
    outputs: int

    @classmethod
    def of(cls, path: str | os.PathLike[str], lines: list[str]) -> "_Header":
        """Raises GonioError where the dimensions are none."""
        matches = [re.match(r"#([A-Za-z_]\w*)\s*(.*)", line) for line in lines if line.startswith("#")]
        stated = {m[1]: m[2].strip().strip('"')[:400] for m in matches[:100] if m}
        dimensions = re.fullmatch(r"(\d{1,4})\s+(\d{1,4})", stated.get("DIM", ""))
        inputs, outputs = (int(n) for n in dimensions.groups()) if dimensions else (0, 0)
        if not min(inputs, outputs) or outputs > MOST_OUTPUTS:
            raise GonioError(f"{path} has the dimensions {stated.get('DIM', '')[:40]!r}; expected #DIM inputs outputs")
        return cls(stated, inputs, outputs)


def read_alta(path: str | os.PathLike[str], quantity: str | None = None, coverage: float | None = None) -> Table:
    """The table of an ALTA file. Its confidence intervals become standard uncertainties.

    Args:
        path: the file.
        quantity: what the values are (a key of `gonio.data.quantities.QUANTITIES`); what PARAM_OUT says otherwise.
        coverage: standard uncertainties in half of an interval; 1 otherwise.

    Raises:
        GonioError: with the line, for whatever is no reading; a parametrisation that names no pair of directions.
    """
    lines = text_lines(path, "an ALTA file")
    header = _Header.of(path, lines)
    if header.stated.get("FORMAT") == "binary":
        raise GonioError(f"{path} is ALTA's binary form, which gonio does not read; write it as text with data2data")
    name = header.stated.get("PARAM_IN", "")
    if name not in PARAMETRISATIONS:
        raise GonioError(
            f"{path} has the parametrisation {name[:60]!r}, by which directions to light and viewer cannot be known; "
            f"{nearest(name, PARAMETRISATIONS)}"
        )
    count, directions = PARAMETRISATIONS[name]
    if count != header.inputs:
        raise GonioError(f"{path} has {header.inputs} coordinates, and {name} has {count}; correct its #DIM")
    how, sentence = _convention(path, header, quantity)
    start = next((k for k, line in enumerate(lines) if line.startswith("#DIM")), 0)
    width = _width(header, lines[start:])
    numbers = number_rows(path, lines[start:], width, "", start + 1)
    c, f = numbers[:, :count].T, numbers[:, count : count + header.outputs]
    with np.errstate(all="ignore"):
        light, view = directions(c)
        right = [np.abs(np.linalg.norm(w, axis=0) - 1) <= UNIT_TOLERANCE for w in (light, view)]
    if not np.logical_and(*right).all():
        row = int(np.argmin(np.logical_and(*right)))
        raise GonioError(f"{path}: row {row + 1} of its readings has coordinates that are no directions; correct them")
    angles = *spherical_angles(*light), *spherical_angles(*view)
    k = coverage_factor(coverage)
    u_f, sentences = _uncertainties(numbers[:, count + header.outputs :], header, k), [f"angles are radians, {name}"]
    sentences += [sentence, *([] if u_f is None else [f"half of an interval is taken as {k:g} standard uncertainties"])]
    rounding = rounding_of(c) if name in IN_ANGLES else 0.0
    listing = Listing(angles, f, _channels(header), u_f, rounding=rounding)
    about = {"format": "ALTA", "header": {k: v for k, v in header.stated.items() if v}, "understood": sentences}
    return table_of_listing(path, listing, how, about, header.stated.get("SAMPLE", ""))


def _convention(path: str | os.PathLike[str], header: _Header, quantity: str | None) -> tuple[Convention, str]:
    """What the values are, and the sentence on who says so."""
    output = header.stated.get("PARAM_OUT", "")
    if quantity is not None:
        return convention(quantity, None), "the caller says what the values are"
    if output in OUTPUTS:
        return Convention(OUTPUTS[output]), f"PARAM_OUT is {output}"
    if output.startswith("UNKNOWN") or not output:
        return Convention(quantity_known=False), "PARAM_OUT does not say what the values are: they are taken as f"
    raise GonioError(f"{path} holds {output[:40]!r}, which is no BRDF; {nearest(output, OUTPUTS)}")


def _channels(header: _Header) -> Channels:
    if header.stated.get("PARAM_OUT") == "XYZ_COLOR" and header.outputs == 3:
        return Channels(("X", "Y", "Z"))
    return Channels.of_count(header.outputs)


def _kinds(header: _Header) -> list[int]:
    """Of each output the numbers that its confidence interval has."""
    kinds = [int(k) for k in re.findall(r"\b[012]\b", header.stated.get("VS", ""))] or [0]
    return (kinds * header.outputs)[: header.outputs] if len(kinds) == 1 else kinds[: header.outputs]


def _width(header: _Header, lines: list[str]) -> int:
    """Numbers in a row: ALTA's own reader takes an interval of the first output alone, and its programs write none."""
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    kinds, least = _kinds(header), header.inputs + header.outputs
    return next((w for w in (least, least + kinds[0]) if len(first.split()) == w), least + sum(kinds))


def _uncertainties(extra: np.ndarray, header: _Header, coverage: float) -> np.ndarray | None:
    """Standard uncertainties (n, outputs) by the half widths of intervals, of which both sides are averaged."""
    if not extra.shape[1]:
        return None
    u, column = np.full((len(extra), header.outputs), np.nan), 0
    for k, count in enumerate(_kinds(header)):
        if count and column + count <= extra.shape[1]:
            u[:, k] = np.abs(extra[:, column : column + count]).mean(1) / coverage
        column += count
    return u
