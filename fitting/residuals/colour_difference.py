"""Colour difference CIEDE2000 between a lit sphere of the model and one of the readings.

Every reading is a pixel of a sphere seen from afar under a distant light. Such a sphere shows all pairs of directions
at the phase angle between light and eye, each over an area in proportion to cosθo and to its share of all pairs.
Radiance is f cosθi, exposed so that a perfect white diffuser facing the light is white, and clipped above.
"""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from gonio.data.layouts import Layout
from gonio.data.table import Channels
from gonio.fitting.problem.readings import Readings

PHASES = (30.0, 60.0)  # degrees between light and eye
MIN_PIXELS, MAX_PIXELS = 10, 20_000
MAX_GAP = 60.0  # nm between wavelengths
LINEAR_SRGB = np.array(  # to XYZ, D65 [IEC 61966-2-1]
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
OBSERVER = Path(__file__).parent / "cie_1931_2deg.csv"


def sphere_difference(
    channels: Channels, readings: Readings, model_f: np.ndarray, layout: Layout | None, seed: int = 0
) -> dict[str, Any] | None:
    """Mean and 95th percentile of CIEDE2000 over lit spheres at phase angles of 30° to 60°.

    Args:
        channels: RGB (taken as linear sRGB) or wavelengths over the visible range (under an equal-energy illuminant).
        readings: f of shape (n, C), 1/sr.
        model_f: the model at the same directions.
        layout: where the readings come from; its cells' solid angles weigh the pixels.
        seed: of the choice among more than 20,000 pixels.

    Returns:
        {name, mean, p95, pixels}, or None where the channels have no colour or fewer than ten readings are pixels.
    """
    to_xyz = colour_matrix(channels)
    if to_xyz is None:
        return None
    pixels, first = list[np.ndarray](), 0
    for part in readings.parts():
        pixels.append(first + _pixels(part))
        first += part.f.shape[0]
    pixels = np.concatenate(pixels)
    if pixels.size > MAX_PIXELS:
        pixels = np.sort(np.random.default_rng(seed).choice(pixels, MAX_PIXELS, replace=False))
    shown = readings.part(pixels)
    area = np.abs(np.asarray(shown.wo.z, float))
    if layout is not None and layout.gridded and pixels.size:
        area = area * layout.solid_angles(shown.wi, shown.wo)
    if pixels.size < MIN_PIXELS or not area.sum() > 0:
        return None
    exposure = np.pi * shown.cos_i[:, None]
    white = to_xyz.sum(axis=1)
    lab = [to_lab(np.clip(f * exposure, 0.0, 1.0) @ to_xyz.T, white) for f in (model_f[pixels], shown.f)]
    difference = ciede2000(*lab)
    order = np.argsort(difference)
    quantile = np.cumsum(area[order]) / area.sum()
    return {
        "name": "CIEDE2000",
        "mean": float(np.sum(area * difference) / area.sum()),
        "p95": float(difference[order[min(int(np.searchsorted(quantile, 0.95)), pixels.size - 1)]]),
        "pixels": int(pixels.size),
    }


def _pixels(readings: Readings) -> np.ndarray:
    """Numbers of the readings that are seen on the spheres, in all channels."""
    cos_phase = sum(np.asarray(i) * np.asarray(o) for i, o in zip(readings.wi, readings.wo, strict=True))
    near, far = np.cos(np.radians(PHASES))
    return np.flatnonzero((cos_phase <= near) & (cos_phase >= far) & readings.valid.all(axis=1))


def colour_matrix(channels: Channels) -> np.ndarray | None:
    """Matrix (3, C) from reflectances of the channels to XYZ with white at Y = 1; None where they have no colour."""
    if channels.wavelengths_nm is None:
        return LINEAR_SRGB if channels.names == ("R", "G", "B") else None
    wavelengths = np.asarray(channels.wavelengths_nm)
    order = np.argsort(wavelengths, kind="stable")
    # What lies beyond the visible says nothing of it, however far the gap to there.
    order = order[(wavelengths[order] >= 380) & (wavelengths[order] <= 780)]
    visible = wavelengths[order]
    if visible.size < 5 or visible[0] > 450 or visible[-1] < 640 or np.max(np.diff(visible)) > MAX_GAP:
        return None
    matrix = np.zeros((3, wavelengths.size))
    matrix[:, order] = observer(visible) * np.gradient(visible)
    return matrix / matrix[1].sum()


def observer(wavelengths: np.ndarray) -> np.ndarray:
    """x̄, ȳ, z̄ (3, n) of the CIE 1931 2° standard observer at wavelengths in nm, linear between its 5 nm steps."""
    nodes, *functions = _observer_table().T
    return np.stack([np.interp(wavelengths, nodes, values, left=0.0, right=0.0) for values in functions])


@functools.cache
def _observer_table() -> np.ndarray:
    return np.loadtxt(OBSERVER, delimiter=",", skiprows=2)


def to_lab(xyz: np.ndarray, white: np.ndarray) -> np.ndarray:
    """CIE 1976 L*a*b* (n, 3) of tristimulus values (n, 3)."""
    t = xyz / white
    linear_below = (6 / 29) ** 3
    f = np.where(t > linear_below, np.cbrt(np.maximum(t, linear_below)), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


def ciede2000(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """CIEDE2000 (n,) of colours in L*a*b*, (n, 3) each [Sharma, Wu & Dalal 2005]."""
    chroma = (np.hypot(a[:, 1], a[:, 2]) + np.hypot(b[:, 1], b[:, 2])) / 2
    g = 0.5 * (1 - np.sqrt(chroma**7 / (chroma**7 + 25.0**7)))
    c1, c2 = (np.hypot((1 + g) * v[:, 1], v[:, 2]) for v in (a, b))
    h1, h2 = (np.degrees(np.arctan2(v[:, 2], (1 + g) * v[:, 1])) % 360 for v in (a, b))
    grey = c1 * c2 == 0
    turn = (h2 - h1 + 180) % 360 - 180
    # For opposite hues the sum decides the side, as the published case distinction does.
    turn = np.where(grey, 0.0, np.where((turn == -180) & (h2 > h1), 180.0, turn))
    dl, dc = b[:, 0] - a[:, 0], c2 - c1
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2))
    l, c = (a[:, 0] + b[:, 0]) / 2, (c1 + c2) / 2  # noqa: E741 -- the symbols of the source
    opposite = np.abs(h1 - h2) > 180
    h = np.where(grey, h1 + h2, np.where(opposite, (h1 + h2 + np.where(h1 + h2 < 360, 360, -360)) / 2, (h1 + h2) / 2))
    cosines = [np.cos(np.radians(k * h + shift)) for k, shift in ((1, -30), (2, 0), (3, 6), (4, -63))]
    t = 1 - 0.17 * cosines[0] + 0.24 * cosines[1] + 0.32 * cosines[2] - 0.20 * cosines[3]
    s_l = 1 + 0.015 * (l - 50) ** 2 / np.sqrt(20 + (l - 50) ** 2)
    s_c, s_h = 1 + 0.045 * c, 1 + 0.015 * c * t
    r_t = -np.sin(np.radians(60 * np.exp(-(((h - 275) / 25) ** 2)))) * 2 * np.sqrt(c**7 / (c**7 + 25.0**7))
    return np.sqrt((dl / s_l) ** 2 + (dc / s_c) ** 2 + (dh / s_h) ** 2 + r_t * (dc / s_c) * (dh / s_h))
