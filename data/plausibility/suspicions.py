"""What the numbers of a table say against what they are taken for: radians, f cos(theta), a saturated detector."""

import math

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.geometry.sides import side_in_words

MOST_ROWS = 200_000
"""Readings that are looked at."""
RADIANS_LIMIT = 3.15
"""Degrees: polar angles all below it are radians, or a scan of nothing but the normal."""
FULL_TURN = 6.2833
"""Degrees: azimuths all below it may be radians."""
HALF_TURN, FEWEST_AZIMUTHS = 0.005, 4
"""How near to π an azimuth has to be, or how many different ones there are, for them to be radians."""
ZERO = 1e-3
"""Degrees up to which an azimuth is 0, in either unit."""
TOO_BRIGHT = 1.25
"""π f of most directions, from which readings cannot be f of anything that makes no light."""
WIDE = math.pi / 4
"""Spread of the detector's polar angles from which directions stand for the hemisphere."""
FEWEST_PAIRS, LEAST_RATIO = 6, 0.1
"""Exchanged pairs from which they tell f from f cos(theta), each of at least this |log| of the ratio of cosines."""
PAIR_CELL = math.radians(0.02)
"""Angles that differ by less are one."""
TURNED_RATIO = 3.0
"""Of the brightest readings back to the light and to the mirror side, from which their places may be exchanged."""
USUAL = 0.75
"""Share of all readings that the brightest ones must outshine."""
QUANTITY_REMEDY = "if these are reflectance factors (π f), state --quantity reflectance_factor, else --quantity brdf"
"""What a sentence on too bright readings ends in."""
FEWEST_EQUAL = 5
"""Geometries of one largest reading from which a detector may have been saturated."""
NEXT_LARGEST = 5
"""Readings below the largest that are as often equal, where they were rounded."""
LOBE = 2.0
"""Ratio of the largest to the median reading from which a peak may be cut off."""
MIRROR_ANGLE = math.radians(10)
"""Least polar angle at which the mirror direction and the way back to the light are told apart."""


def suspicions(table: Table, angles_unknown: bool = False, quantity_unknown: bool = False) -> list[str]:
    """Sentences on what the readings are probably not; each ends in how to state it.

    Args:
        table: readings, taken as degrees and as f.
        angles_unknown: whether nobody says the unit of the angles.
        quantity_unknown: whether nobody says that the readings are f.
    """
    cells = table.valid_cells()
    if not cells.size:
        return []
    theta_i, _, theta_o, _ = (a[cells] for a in table.layout.angles())
    largest = max(theta_i.max(), theta_o.max())
    if angles_unknown and 0 < largest <= math.radians(RADIANS_LIMIT):
        return [
            f"no polar angle is above {math.degrees(largest):.4g}, taken as degrees: if these are radians, state "
            "--angles radians, else --angles degrees"
        ]
    result = _azimuths_in_radians(table, cells, largest) if angles_unknown else []
    for sides, part in table.parts().items():
        where = "" if sides == (1, 1) else f"{side_in_words(*sides)}: "
        result += [where + sentence for sentence in _of_part(part, sides[0] == sides[1], quantity_unknown)]
    return result


def _azimuths_in_radians(table: Table, cells: np.ndarray, largest: float) -> list[str]:
    """Whether azimuths, taken as degrees, are within a turn of radians, while polar angles are degrees."""
    azimuths = np.degrees(np.stack(table.layout.angles())[[1, 3]][:, cells])
    away = np.abs(np.mod(azimuths + 180, 360) - 180)
    different = np.unique(np.round(away[away > ZERO], 4))
    widest = float(different.max(initial=0.0))
    half_turn = bool(np.any(np.abs(different - math.pi) < HALF_TURN))
    if (not half_turn and different.size < FEWEST_AZIMUTHS) or not 0 < widest < FULL_TURN < math.degrees(largest):
        return []
    return [
        f"no azimuth is more than {widest:.4g} from 0, taken as degrees like the polar angles: if azimuths are "
        "radians, write [rad] behind their names, else state --angles degrees"
    ]


def _of_part(table: Table, reflection: bool, quantity_unknown: bool) -> list[str]:
    """The same of one side of the sample."""
    cells = table.valid_cells()
    if cells.size > MOST_ROWS:
        cells = cells[:: -(-cells.size // MOST_ROWS)]
    if not cells.size:
        return []
    theta_i, phi_i, theta_o, phi_o = (a[cells] for a in table.layout.angles())
    values = table.values_at(cells)
    f = np.mean(values["f"], axis=1, where=values["flag"] == Flag.VALID)
    delta = (phi_o - phi_i) % (2 * math.pi)
    result = _turned_azimuth(theta_i, theta_o, delta, f) if reflection else []
    result += _saturated(theta_i, theta_o, delta, np.where(values["flag"] == Flag.VALID, values["f"], np.nan))
    if quantity_unknown:
        result += _cosine_ratio(theta_i, theta_o, delta, f) or _too_bright(theta_i, theta_o, delta, f)
    return result


def _cosine_ratio(theta_i: np.ndarray, theta_o: np.ndarray, delta: np.ndarray, f: np.ndarray) -> list[str]:
    """Whether values with the directions exchanged differ by the ratio of the cosines."""
    keys = [
        np.round(a / PAIR_CELL).astype(np.int64) for a in (theta_i, theta_o, np.minimum(delta, 2 * math.pi - delta))
    ]
    base = int(max(k.max() for k in keys)) + 1
    code, exchanged = ((a * base + b) * base + keys[2] for a, b in ((keys[0], keys[1]), (keys[1], keys[0])))
    order = np.argsort(code)
    partner = order[np.minimum(np.searchsorted(code[order], exchanged), code.size - 1)]
    cosines = np.cos(theta_i), np.cos(theta_o)
    usable = (code[partner] == exchanged) & (f > 0) & (f[partner] > 0) & (np.minimum(*cosines) > 0.02)
    expected = np.log(cosines[1][usable] / cosines[0][usable])
    measured = np.log(f[usable]) - np.log(f[partner][usable])
    telling = expected > LEAST_RATIO
    if telling.sum() < FEWEST_PAIRS:
        return []
    x, y = expected[telling], measured[telling]
    slope = float(np.median(y / x))
    if abs(abs(slope) - 1) > 0.15 or np.median(np.abs(y - math.copysign(1, slope) * x)) > 0.25 * np.median(x):
        return []
    quantity, angle = ("brdf_cos", "theta_o") if slope > 0 else ("brdf_cos_i", "theta_i")
    return [
        f"{int(telling.sum())} pairs of exchanged directions differ by the ratio of their cosines: if the values are "
        f"f cos({angle}), state --quantity {quantity}, else --quantity brdf"
    ]


def _turned_azimuth(theta_i: np.ndarray, theta_o: np.ndarray, delta: np.ndarray, f: np.ndarray) -> list[str]:
    """Whether the light comes back to its source where it should go to the mirror side."""
    near = (theta_i >= MIRROR_ANGLE) & (np.abs(theta_o - theta_i) <= MIRROR_ANGLE)
    mirror, back = near & (np.cos(delta) < -0.95), near & (np.cos(delta) > 0.95)
    if not mirror.any() or not back.any():
        return []
    # Readings of the dark, and of a diffuser, have no brightest direction: noise must not be taken for one.
    usual = float(np.quantile(np.abs(f), USUAL))
    if float(f[back].max()) <= TURNED_RATIO * max(float(f[mirror].max()), usual):
        return []
    return [
        "the brightest readings go back to the light, and few to the mirror side: unless this surface returns light to "
        "its source, an azimuth is off by 180° (state --mirror-azimuth 0 where azimuths differ by 0 at the mirror "
        "side), or a polar angle has the wrong sign"
    ]


def _saturated(theta_i: np.ndarray, theta_o: np.ndarray, delta: np.ndarray, f: np.ndarray) -> list[str]:
    """Whether the peak of a channel, f (n, channels), is cut off: one largest value of many different geometries."""
    polar, other = np.maximum(theta_i, theta_o), np.minimum(theta_i, theta_o)
    turn = np.where(np.sin(theta_i) * np.sin(theta_o) > PAIR_CELL, np.minimum(delta, 2 * math.pi - delta), 0.0)
    geometry = np.round(np.stack([polar, other, turn], axis=1) / PAIR_CELL)
    for of_channel in f.T:
        values = np.unique(of_channel[np.isfinite(of_channel)])[::-1][: NEXT_LARGEST + 1]
        rounded = np.array([float(f"{value:.2e}") for value in values])
        if values.size <= NEXT_LARGEST or values[0] <= LOBE * np.nanmedian(of_channel):
            continue
        if np.allclose(values, rounded, rtol=1e-6, atol=0):  # so few digits make equal readings themselves
            continue
        count = [len(np.unique(geometry[of_channel == value], axis=0)) for value in values]
        if count[0] >= FEWEST_EQUAL * max(1, *count[1:]):
            return [
                f"{int(np.sum(of_channel == values[0]))} readings share the largest value, {values[0]:.6g}, as where a "
                "detector is saturated: leave these out of the file, unless the peak is flat"
            ]
    return []


def _too_bright(theta_i: np.ndarray, theta_o: np.ndarray, delta: np.ndarray, f: np.ndarray) -> list[str]:
    """Whether most of the hemisphere sends back more light than a surface that keeps none.

    Of each twelfth of each of six rings of equal projected solid angle the smallest reading counts, at each incidence.
    """
    if np.ptp(np.where(np.cos(delta) < 0, -theta_o, theta_o)) < WIDE:
        return []
    incidence = np.unique(np.round(theta_i / PAIR_CELL), return_inverse=True)[1].reshape(-1)
    ring = np.minimum((np.sin(theta_o) ** 2 * 6).astype(int), 5)
    part = (incidence * 6 + ring) * 12 + (delta / (2 * math.pi) * 12).astype(int) % 12
    least = np.full(part.max() + 1, np.inf)
    np.minimum.at(least, part, f)
    usual = float(np.quantile(least[np.isfinite(least)], 0.25))
    if usual * math.pi < TOO_BRIGHT:
        return []
    return [
        f"three quarters of all directions send back more than {usual:.3g} 1/sr, and a surface that keeps no light "
        f"0.318: {QUANTITY_REMEDY}"
    ]
