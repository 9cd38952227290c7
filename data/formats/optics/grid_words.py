"""What readers of grids about a direction have to tell of them, in sentences."""

import numpy as np

from gonio.data.formats.optics.angle_nodes import Nodes
from gonio.data.layouts import Layout

MOST_LINES = 20
"""Incidences whose totals are listed one by one."""


def repeats_in_words(nodes: Nodes) -> list[str]:
    """What became of directions that the lists of angles hold more than once."""
    if not nodes.repeated:
        return []
    text = f"{nodes.repeated} pairs of its angles stand for directions that it has already (such as 0° and 360°)"
    differ = f"; {nodes.disagreeing} of them have other values, whose mean is taken" if nodes.disagreeing else ""
    return [text + differ]


def copied_pole(layout: Layout, f: np.ndarray) -> bool:
    """Whether the values where the detector's azimuth has no meaning are the same for all azimuths."""
    names = list(layout.axes)
    for polar, azimuth in layout.pole_axes:
        for node in layout.pole_nodes(polar) if polar != "theta_i" and layout.axes[azimuth].size > 1 else ():
            pole = np.moveaxis(f, [names.index(polar), names.index(azimuth)], [0, 1])[node]
            if bool(np.array_equal(pole, np.broadcast_to(pole[:1], pole.shape), equal_nan=True)):
                return True
    return False


def all_zero_in_words(layout: Layout, f: np.ndarray) -> str:
    """A sentence on the incidences, the leading axis, at which all values are 0; nothing where there are none."""
    dark = (np.nan_to_num(f.reshape(f.shape[0], -1)) == 0).all(axis=1) & np.isfinite(f.reshape(f.shape[0], -1)).any(1)
    if not dark.any():
        return ""
    angles = ", ".join(f"{a:.4g}°" for a in np.degrees(layout.axes["theta_i"][dark])[:8])
    return f"all values are 0 with the light at θi {angles}: taken as readings of 0, as they stand"


def totals_in_words(name: str, theta_i: np.ndarray, stated: np.ndarray, ours: np.ndarray) -> list[str]:
    """A file's totals beside the integrals of its values.

    Args:
        name: what the file calls a total.
        theta_i: degrees, (n,).
        stated, ours: (n, channels); NaN where there is none.
    """
    if not np.isfinite(stated).any():
        return [f"the file states no {name}; the values' integrals are {ours.min():.4g} to {ours.max():.4g}"]
    if stated.size <= MOST_LINES and stated.shape[1] == 1:
        rows = zip(theta_i, stated[:, 0], ours[:, 0], strict=True)
        return [f"{name} at θi {t:.6g}°: {a:.6g}, the integral of the values {b:.6g}" for t, a, b in rows]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = stated / ours
    ratio = ratio[np.isfinite(ratio)]
    spread = f"{ratio.min():.4g} to {ratio.max():.4g} of the values' integrals" if ratio.size else "those of zeros"
    return [f"the {stated.size} {name}s of the file, {np.nanmin(stated):.4g} to {np.nanmax(stated):.4g}, are {spread}"]
