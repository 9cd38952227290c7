"""Colour of a surface by its reflectances: CIE 1931 2° observer, illuminant D65, linear sRGB."""

from typing import NamedTuple

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.residuals.colour_difference import LINEAR_SRGB, observer
from gonio.models.display import percent

VISIBLE = np.arange(380.0, 780.5, 1.0)
"""nm."""
FEWEST = 3
"""Wavelengths within the visible from which on reflectances have a colour."""
WIDEST = 120.0
"""Gap, nm, between neighbouring wavelengths over which a reflectance may be taken as linear."""
UNSEEN = 0.6
"""Share of a white surface's X, Y or Z beyond the wavelengths, above which a guess would decide the colour."""
D65_STEP = 10.0
# Relative power of CIE standard illuminant D65 from 380 nm to 780 nm, linear between [ISO/CIE 11664-2:2022].
D65 = (
    49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354,
    107.802, 104.790, 107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886,
    83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.3490, 61.6040, 69.8856, 75.0870, 63.5927, 46.4182,
    66.8054, 63.3828,
)  # fmt: skip


class ChannelColour(NamedTuple):
    """How channels become a colour: the matrix (3, C) from reflectances to linear sRGB, None where they have none."""

    matrix: np.ndarray | None
    words: str
    """What was taken for granted."""


def channel_colour(channels: Channels) -> ChannelColour:
    """The colour of reflectances in these channels, white for a perfect diffuser.

    A spectrum is linear between its wavelengths and constant beyond the outermost and towards those that are
    farther than `WIDEST` outside of the visible; one light is assumed, D65.
    """
    if channels.wavelengths_nm is None:
        if channels.names == ("R", "G", "B"):
            return ChannelColour(np.eye(3), "R, G and B as linear sRGB")
        return ChannelColour(None, "its channels are no spectrum" if len(channels) > 1 else "one channel has no colour")
    wavelengths = np.asarray(channels.wavelengths_nm, float)
    order = np.argsort(wavelengths, kind="stable")
    nodes = wavelengths[order]
    inside = nodes[(nodes >= VISIBLE[0]) & (nodes <= VISIBLE[-1])]
    if np.unique(inside).size < inside.size:
        return ChannelColour(None, "several channels of one wavelength tell no colour")
    if inside.size:
        near = (nodes >= inside[0] - WIDEST) & (nodes <= inside[-1] + WIDEST)
        order, nodes = order[near], nodes[near]
    weight = observer(VISIBLE) * np.interp(VISIBLE, VISIBLE[0] + D65_STEP * np.arange(len(D65)), D65)
    weight /= weight[1].sum()
    outside = (nodes[0] > VISIBLE) | (nodes[-1] < VISIBLE)
    unseen = float((weight[:, outside].sum(axis=1) / weight.sum(axis=1)).max())
    gap = float(np.diff(inside).max()) if inside.size > 1 else 0.0
    if np.unique(inside).size < FEWEST or gap > WIDEST or unseen > UNSEEN:
        return ChannelColour(None, f"{inside.size} wavelengths within the visible, {gap:.0f} nm apart, tell no colour")
    shares = np.stack([np.interp(VISIBLE, nodes, row) for row in np.eye(nodes.size)], axis=1)
    matrix = np.zeros((3, wavelengths.size))
    matrix[:, order] = np.linalg.inv(LINEAR_SRGB) @ weight @ shares
    words = "colour of the spectrum: CIE 1931 2° observer, illuminant D65, sRGB"
    if unseen > 5e-4:
        ends = [f"below {nodes[0]:.4g} nm"] * bool(nodes[0] > VISIBLE[0])
        ends += [f"above {nodes[-1]:.4g} nm"] * bool(nodes[-1] < VISIBLE[-1])
        words += f", taken as constant {' and '.join(ends)} (up to {percent(unseen)} of a white's X, Y or Z)"
    return ChannelColour(matrix, words)
