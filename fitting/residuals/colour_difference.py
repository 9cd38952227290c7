"""How different a sphere of the model and one of the readings look: CIEDE2000.

Every reading is a pixel of a lit sphere: seen from afar and lit by a distant light, a sphere shows all pairs of
directions that the phase angle lies between, each over an area in proportion to cosθo times its share of all pairs.
Radiance is f cosθi, exposed so that a perfect white diffuser which faces the light is white; beyond that it is cut off.
"""

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.problem.cell_measure import pair_measure
from gonio.fitting.problem.readings import Readings

PHASES = (30.0, 60.0)  # degrees between light and eye of the spheres that count
FEWEST, MOST = 10, 20_000  # pixels
WIDEST_GAP = 60.0  # nm between wavelengths
LINEAR_SRGB = np.array(  # to XYZ, D65 [IEC 61966-2-1]
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
# Amplitude, centre, width below and above it, nm: the CIE 1931 observer [Wyman, Sloan & Shirley 2013, table 1].
OBSERVER = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)


def sphere_difference(channels: Channels, readings: Readings, model_f: np.ndarray, layout, seed: int = 0):
    """{name, mean, p95, pixels} of CIEDE2000 over lit spheres at phase angles of 30° to 60°, or None.

    None where the channels have no colour (neither RGB, taken as linear sRGB, nor wavelengths over the visible range,
    under light of equal energy), or where fewer than ten readings lie at such phase angles.
    """
    to_xyz = colour_matrix(channels)
    if to_xyz is None:
        return None
    cosine = sum(np.asarray(i) * np.asarray(o) for i, o in zip(readings.wi, readings.wo, strict=True))
    near, far = np.cos(np.radians(PHASES))
    at = np.flatnonzero((cosine <= near) & (cosine >= far) & readings.valid.all(axis=1))
    if at.size > MOST:
        at = np.sort(np.random.default_rng(seed).choice(at, MOST, replace=False))
    part = readings.part(at)
    area = np.asarray(part.wo.z, float)
    if layout is not None and layout.name != "scattered" and at.size:
        area = area * pair_measure(layout, part.wi, part.wo)
    if at.size < FEWEST or not area.sum() > 0:
        return None
    white = to_xyz.sum(axis=1)
    shown = np.pi * np.asarray(part.wi.z)[:, None]
    lab = [to_lab(np.clip(f * shown, 0.0, 1.0) @ to_xyz.T, white) for f in (model_f[at], part.f)]
    difference = ciede2000(*lab)
    order = np.argsort(difference)
    passed = np.cumsum(area[order]) / area.sum()
    return {
        "name": "CIEDE2000",
        "mean": float(np.sum(area * difference) / area.sum()),
        "p95": float(difference[order[min(int(np.searchsorted(passed, 0.95)), at.size - 1)]]),
        "pixels": int(at.size),
    }


def colour_matrix(channels: Channels) -> np.ndarray | None:
    """From reflectances of the channels to XYZ with white at Y = 1, (3, C); None where they have no colour."""
    if channels.wavelengths_nm is None:
        return LINEAR_SRGB if channels.names == ("R", "G", "B") else None
    wavelengths = np.asarray(channels.wavelengths_nm)
    order = np.argsort(wavelengths)
    inside = np.sort(wavelengths[(wavelengths >= 380) & (wavelengths <= 780)])
    if inside.size < 5 or inside[0] > 450 or inside[-1] < 640 or np.max(np.diff(inside)) > WIDEST_GAP:
        return None
    matrix = np.zeros((3, wavelengths.size))
    matrix[:, order] = observer(wavelengths[order]) * np.gradient(wavelengths[order])
    return matrix / matrix[1].sum()


def observer(wavelengths: np.ndarray) -> np.ndarray:
    """x̄, ȳ, z̄ (3, n) of the CIE 1931 standard observer at wavelengths in nm, right to about 1 % of their maxima."""
    found = []
    for lobes in OBSERVER:
        total = np.zeros(wavelengths.size)
        for amplitude, centre, below, above in lobes:
            t = (wavelengths - centre) / np.where(wavelengths < centre, below, above)
            total += amplitude * np.exp(-0.5 * t * t)
        found.append(total)
    return np.stack(found)


def to_lab(xyz: np.ndarray, white: np.ndarray) -> np.ndarray:
    """CIE 1976 L*a*b* (n, 3) of tristimulus values (n, 3)."""
    t = xyz / white
    cut = (6 / 29) ** 3
    f = np.where(t > cut, np.cbrt(np.maximum(t, cut)), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


def ciede2000(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """CIEDE2000 (n,) of colours in L*a*b*, (n, 3) each, as Sharma, Wu & Dalal [2005] write it."""
    chroma = (np.hypot(a[:, 1], a[:, 2]) + np.hypot(b[:, 1], b[:, 2])) / 2
    g = 0.5 * (1 - np.sqrt(chroma**7 / (chroma**7 + 25.0**7)))
    c1, c2 = (np.hypot((1 + g) * v[:, 1], v[:, 2]) for v in (a, b))
    h1, h2 = (np.degrees(np.arctan2(v[:, 2], (1 + g) * v[:, 1])) % 360 for v in (a, b))
    grey = c1 * c2 == 0
    turn = (h2 - h1 + 180) % 360 - 180
    # Opposite hues: the sum says to which side, as the published case distinction does.
    turn = np.where(grey, 0.0, np.where((turn == -180) & (h2 > h1), 180.0, turn))
    dl, dc = b[:, 0] - a[:, 0], c2 - c1
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2))
    l, c = (a[:, 0] + b[:, 0]) / 2, (c1 + c2) / 2  # noqa: E741 -- the symbols of the source
    apart = np.abs(h1 - h2) > 180
    h = np.where(grey, h1 + h2, np.where(apart, (h1 + h2 + np.where(h1 + h2 < 360, 360, -360)) / 2, (h1 + h2) / 2))
    cosines = [np.cos(np.radians(k * h + shift)) for k, shift in ((1, -30), (2, 0), (3, 6), (4, -63))]
    t = 1 - 0.17 * cosines[0] + 0.24 * cosines[1] + 0.32 * cosines[2] - 0.20 * cosines[3]
    s_l = 1 + 0.015 * (l - 50) ** 2 / np.sqrt(20 + (l - 50) ** 2)
    s_c, s_h = 1 + 0.045 * c, 1 + 0.015 * c * t
    bend = -np.sin(np.radians(60 * np.exp(-(((h - 275) / 25) ** 2)))) * 2 * np.sqrt(c**7 / (c**7 + 25.0**7))
    return np.sqrt((dl / s_l) ** 2 + (dc / s_c) ** 2 + (dh / s_h) ** 2 + bend * (dc / s_c) * (dh / s_h))
