"""Scans: which directions an instrument goes to. Each is a layout, made by name; angles in radians."""

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np

from gonio.data import layouts
from gonio.data.layouts import Layout
from gonio.instrument.instrument import Instrument
from gonio.instrument.pace import AXES
from gonio.models.brdf import AbstractBRDF
from gonio.models.catalog import is_ours
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.sides import TWO_SIDED, Hemispheres

MAX_CELLS = 1 << 31
"""A table of so many cells fills tens of gigabytes in one channel."""
REFLECTION, TRANSMISSION, BOTH = "reflection", "transmission", "both"
THROUGH = Hemispheres.TRANSMISSION
HEMISPHERES, LIT = (REFLECTION, TRANSMISSION, BOTH), ("front", "back", BOTH)
SAME = 1e-9
DEGREE_1, DEGREES_5, DEGREES_10 = (math.radians(degrees) for degrees in (1, 5, 10))
"""Default steps."""
THETA_MAX = math.radians(85)
"""Beyond, the lit patch of a real instrument is more than eleven times as long as it is wide."""
INCIDENCES = tuple(math.radians(t) for t in (0, 15, 30, 45, 60, 75))


def isotropic(
    step: float = DEGREES_5,
    theta_max: float = THETA_MAX,
    phi_step: float | None = None,
    hemisphere: str = REFLECTION,
    lit: str = "front",
) -> Layout:
    """A grid for isotropic surfaces: both polar angles, and the difference of the azimuths once round.

    Args:
        step: of the polar angles, from 0, radians.
        theta_max: largest polar angle; behind the sample it is counted from the other normal.
        phi_step: of delta_phi; by default `step`.
        hemisphere, lit: as of `scan`.

    Raises:
        GonioError: steps or limits that make no grid, or one of more than `MAX_CELLS`.
    """
    light, detector = _sides(_polar(step, theta_max), hemisphere, lit)
    return _checked(layouts.isotropic(light, detector, _azimuth(phi_step or step)))


def spherical(
    step: float = DEGREES_10,
    theta_max: float = THETA_MAX,
    phi_step: float | None = None,
    hemisphere: str = REFLECTION,
    lit: str = "front",
) -> Layout:
    """A grid over all four angles, for anisotropic surfaces too.

    Args:
        step: of the polar angles, from 0, radians.
        theta_max: largest polar angle; behind the sample it is counted from the other normal.
        phi_step: of both azimuths, once round; by default `step`.
        hemisphere, lit: as of `scan`.

    Raises:
        GonioError: steps or limits that make no grid, or one of more than `MAX_CELLS`.
    """
    light, detector = _sides(_polar(step, theta_max), hemisphere, lit)
    azimuth = _azimuth(phi_step or step)
    return _checked(layouts.spherical(light, azimuth, detector, azimuth))


def half_difference(step: float = DEGREES_5, phi_step: float | None = None) -> Layout:
    """MERL's spacing, square in theta_h, with other numbers of nodes: theta_d and phi_d by `step`.

    `phi_step`: also turns the half vector about the normal, for anisotropic surfaces.
    """
    counts = _count(math.pi / 2, step), _count(math.pi / 2, step), _count(math.pi, step)
    turns = None if phi_step is None else _azimuth(phi_step)
    return _checked(layouts.half_difference(**layouts.merl(counts=counts).axes, phi_h=turns))


def merl() -> Layout:
    """MERL's own grid of 90 × 90 × 180 cells."""
    return layouts.merl()


def in_plane(
    step: float = DEGREE_1,
    theta_max: float = THETA_MAX,
    theta_i: Sequence[float] = INCIDENCES,
    hemisphere: str = REFLECTION,
    lit: str = "front",
) -> Layout:
    """The plane of incidence, in which the detector goes from −`theta_max` to `theta_max`.

    Args:
        step: of the detector, radians.
        theta_max: its largest polar angle.
        theta_i: polar angles of the light, at most π/2.
        hemisphere, lit: as of `scan`.

    Raises:
        GonioError: incidences beyond π/2; steps or limits that make no grid, or one of more than `MAX_CELLS`.
    """
    if max(theta_i, default=0.0) > math.pi / 2:
        raise GonioError(f"theta_i has {_angle(max(theta_i))}; give at most 90°, and lit back for light from behind")
    light, _ = _sides(np.array(sorted(theta_i)), hemisphere, lit)
    _, detector = _sides(_polar(step, theta_max), hemisphere, lit)
    return _checked(layouts.in_plane(light, np.unique(np.concatenate([-detector, detector])) + 0.0))


def listed(path: str | os.PathLike[str]) -> Layout:
    """The directions of a CSV file, one sample a row: the columns that `gonio eval` reads."""
    from gonio.data.formats.csv.table_file import read_directions

    wi, wo, _ = read_directions(path)
    return layouts.scattered(*layouts.spherical_angles(*wi), *layouts.spherical_angles(*wo))


def listed_seconds(scan: str | os.PathLike[str]) -> np.ndarray | None:
    """Counting times (n,), the column `seconds` of a CSV file of directions; None for a scan without them."""
    from gonio.data.formats.csv.table_file import read_seconds

    return read_seconds(scan) if is_file(scan) else None


def is_file(scan: str | os.PathLike[str]) -> bool:
    """Whether a scan's name stands for a file: it is no known name, and looks like a path or is there."""
    named = os.fspath(scan).replace("_", "-") in SCANS
    return not named and bool(Path(scan).suffix or os.sep in os.fspath(scan) or Path(scan).exists())


def default_name(brdf: AbstractBRDF) -> str:
    """The default scan: isotropic for a material that looks the same all round, else spherical."""
    return "isotropic" if is_isotropic(brdf) else "spherical"


def isotropy_remark(grid: Layout, brdf: AbstractBRDF) -> str | None:
    """A remark on a scan that never turns an anisotropic sample; None for all others."""
    if grid.has_azimuth_of_light or is_isotropic(brdf):
        return None
    return (
        f"the material is anisotropic, but a scan of layout {grid.name} never turns the sample: the table holds one "
        "orientation of it; the spherical scan, or a phi_step for half-difference, turns it"
    )


def is_isotropic(brdf: AbstractBRDF) -> bool:
    """Whether f stays the same when both directions are turned about the normal: by 64 pairs for a foreign model."""
    if is_ours(brdf):  # narrow lobes would be missed by all pairs
        return brdf.isotropic
    rng = np.random.default_rng(0)
    z = rng.uniform(0.1, 0.98, (2, 64))
    phi, turn = rng.uniform(0, 2 * math.pi, (2, 64)), rng.uniform(0.3, 6.0, 64)
    # Some pairs near mirror reflection, where a narrow lobe is.
    phi[1, :48], z[1, :48] = phi[0, :48] + math.pi + rng.normal(0, 0.1, 48), z[0, :48]
    azimuth = np.stack([phi, phi + turn])  # (as it is or turned, wi or wo, pairs)
    r = np.sqrt(1 - z**2)
    x, y = r * np.cos(azimuth), r * np.sin(azimuth)
    pairs = [Direction(x[:, k], y[:, k], np.broadcast_to(z[k], (2, 64))) for k in (0, 1)]
    still, turned = np.nan_to_num(np.asarray(evaluate(brdf, *pairs)))
    return bool(np.allclose(still, turned, rtol=1e-3, atol=1e-9))


class ScanOptions(TypedDict, total=False):
    """Angles of a named scan, radians: steps of all angles or of azimuths, the largest polar angle, incidences.

    `hemisphere`: where the detector goes, "reflection" (the light's side of the sample), "transmission" or "both";
    `lit`: the sides that the light goes to, "front", "back" or "both".
    """

    step: float | None
    phi_step: float | None
    theta_max: float | None
    theta_i: Sequence[float] | None
    hemisphere: str | None
    lit: str | None


SAME = 1e-6
"""Radians between directions that are the same."""
SIDES = ("hemisphere", "lit")
SCANS: dict[str, tuple[Callable[..., Layout], tuple[str, ...]]] = {
    "isotropic": (isotropic, ("step", "phi_step", "theta_max", *SIDES)),
    "spherical": (spherical, ("step", "phi_step", "theta_max", *SIDES)),
    "half-difference": (half_difference, ("step", "phi_step")),
    "merl": (merl, ()),
    "in-plane": (in_plane, ("step", "theta_max", "theta_i", *SIDES)),
}
"""Constructor and options of each scan."""


def scan(name: str | os.PathLike[str], **options: Unpack[ScanOptions]) -> Layout:
    """The layout of a named scan, or of a CSV file of directions.

    Args:
        name: "isotropic", "spherical", "half-difference", "merl", "in-plane", or the path of a file.
        step: of all angles, radians.
        phi_step: of azimuths, radians; by default `step`.
        theta_max: the largest polar angle, radians.
        theta_i: polar angles of the light in the plane of incidence, radians.
        hemisphere: where the detector goes: "reflection" (the light's side), "transmission" or "both".
        lit: the sides that the light goes to: "front", "back" or "both".

    Returns:
        The layout: what `gonio.measure` takes as its scan.

    Raises:
        GonioError: for an unknown name, an option that the scan does not have, an angle out of range, and more than
            `MAX_CELLS` cells.
    """
    usual = {"hemisphere": REFLECTION, "lit": "front"}
    given = {option: value for option, value in options.items() if value not in (None, usual.get(option))}
    text = os.fspath(name).replace("_", "-")
    if text in SCANS:
        make, known = SCANS[text]
    elif is_file(name):
        make, known = (lambda: listed(name)), ()
    else:
        raise GonioError(f"scan {os.fspath(name)!r} is unknown; give {', '.join(SCANS)}, or a CSV file of directions")
    if given.keys() & {*SIDES} and not {*SIDES} & {*known}:
        why = "half vectors hold reflection from the front alone" if text in SCANS else "its directions are the file's"
        raise GonioError(f"scan {text} has no other hemispheres: {why}; give isotropic, spherical or in-plane")
    if unknown := sorted(given.keys() - {*known}):
        takes = f"it takes {', '.join(known)}" if known else "its directions are fixed"
        raise GonioError(f"scan {text} has no {', '.join(unknown)}; {takes}")
    return make(**given)


def default_hemisphere(name: str | os.PathLike[str], brdf: AbstractBRDF) -> str | None:
    """Where the detector goes if nothing is said: into the hemispheres that the surface scatters into.

    None for a scan that does not choose, and for a surface that scatters into that of the light alone.
    """
    known = SCANS.get(os.fspath(name).replace("_", "-"), (None, ()))[1]
    if "hemisphere" not in known or Hemispheres.TRANSMISSION not in brdf.hemispheres:
        return None
    return BOTH if brdf.hemispheres & TWO_SIDED else TRANSMISSION


def hemisphere_remark(grid: Layout, brdf: AbstractBRDF) -> str | None:
    """A remark on a scan that leaves out a hemisphere that the surface scatters into, or reads one that stays dark."""
    remarks = []
    for hemisphere, verb, noun in ((TWO_SIDED, "reflects", REFLECTION), (THROUGH, "transmits", TRANSMISSION)):
        scatters, read = (bool(hemisphere & h) for h in (brdf.hemispheres, grid.hemispheres))
        if scatters and not read:
            remarks.append(
                f"the material {verb}, but the scan leaves its {noun} out: nothing was looked at there; the isotropic, "
                "spherical and in-plane scans read both hemispheres"
            )
        if read and not scatters:
            remarks.append(f"nothing says that the material {verb}: all readings of its {noun} are 0")
    return "; ".join(remarks) or None


def mirror_remark(grid: Layout) -> str | None:
    """A remark on a scan of grid angles that leaves out mirror directions of light in front; None for all others."""
    axes = grid.axes
    turned = axes.get("delta_phi", axes.get("phi_o"))  # None of lists, planes and half vectors
    if turned is None or (1, 1) not in grid.sides:
        return None
    theta_i = axes["theta_i"][(axes["theta_i"] > 0) & (axes["theta_i"] < math.pi / 2)]
    phi_i = axes.get("phi_i", np.zeros(1))
    along = np.abs(axes["theta_o"] - theta_i[:, None]).min(axis=1) < SAME
    across = np.abs(np.cos((turned - phi_i[:, None]) / 2)).min(axis=1) < SAME
    incidences = along.size * across.size
    left_out = incidences - int(along.sum() * across.sum())
    if not left_out:
        return None
    return (
        f"the scan leaves out the mirror direction of {left_out} of {incidences} incidences: narrow lobes there are "
        "not seen, and `gonio check` may be unable to decide on energy; an even number of azimuths reads it"
    )


def out_of_reach(grid: Layout, instrument: Instrument) -> str | None:
    """A remark where the instrument's arms do not go behind the sample, and the scan does."""
    ranges: dict[str, tuple[float, float]] = dict(zip(AXES, instrument.ranges, strict=True))
    arms = {"theta_i": {light for light, _ in grid.sides}, "theta_o": {detector for _, detector in grid.sides}}
    short = [name for name, sides in arms.items() if -1 in sides and ranges[name][1] <= math.pi / 2]
    if not short:
        return None
    return f"the range of the instrument's {' and '.join(short)} ends in front: nothing is measured behind the sample"


def _sides(polar: np.ndarray, hemisphere: str, lit: str) -> tuple[np.ndarray, np.ndarray]:
    """Polar angles of light and detector: those in front, those behind, or both."""
    for name, value, known in (("hemisphere", hemisphere, HEMISPHERES), ("lit", lit, LIT)):
        if value not in known:
            raise GonioError(f"{name} is {value!r}; give {', '.join(known[:-1])} or {known[-1]}")
    if lit == BOTH and hemisphere != BOTH:
        raise GonioError("a grid that is lit from both sides reads both hemispheres; give hemisphere both too")
    behind = (math.pi - polar)[::-1]
    of_side = {
        "front": polar,
        "back": behind,
        BOTH: np.concatenate([polar, behind[behind > polar.max(initial=0) + SAME]]),
    }
    same = {REFLECTION: lit, TRANSMISSION: "back" if lit == "front" else "front", BOTH: BOTH}
    return of_side[lit], of_side[same[hemisphere]]


def _polar(step: float, theta_max: float) -> np.ndarray:
    if not 0 < theta_max <= math.pi / 2:
        raise GonioError(f"theta_max is {_angle(theta_max)}; give more than 0 and at most π/2 rad (90°)")
    _require_step(step, theta_max)
    # A step that divides theta_max reaches it, whatever the rounding.
    polar = np.arange(math.floor(theta_max / step + 1e-9) + 1) * step
    return np.minimum(polar, math.pi / 2)


def _azimuth(step: float) -> np.ndarray:
    return np.arange(_count(2 * math.pi, step)) * step


def _count(whole: float, step: float) -> int:
    """Steps that make up a whole; a grid that does not close would measure one seam more densely than the rest."""
    _require_step(step, whole)
    count = round(whole / step)
    if abs(count * step - whole) > 1e-9 * whole:
        raise GonioError(
            f"a step of {_angle(step)} does not divide {math.degrees(whole):g}°; give one that does, such as "
            f"{_angle(whole / count)}"
        )
    return count


def _require_step(step: float, whole: float) -> None:
    if not whole / 1e6 <= step <= whole:
        most = f"{math.degrees(whole):g}°"
        raise GonioError(f"a step of {_angle(step)} came; give one above 0, from a millionth of {most} to {most}")


def _angle(value: float) -> str:
    return f"{math.degrees(value):g}° ({value:.6g} rad)"


def _checked(layout: Layout) -> Layout:
    if layout.size > MAX_CELLS:
        raise GonioError(f"this scan has {layout.size:.3g} cells, more than {MAX_CELLS:.3g}; give a larger step")
    return layout
