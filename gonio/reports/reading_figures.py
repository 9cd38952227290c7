"""Few readings as readings: over the angle that varies, over the wavelength, and as a list."""

from typing import Any

import numpy as np

from gonio.data.flags import Flag
from gonio.figures.reading_plots import (
    LABELS,
    MOST_GROUPS,
    Points,
    draw_over_angle,
    draw_over_wavelength,
    settings,
    varying_angle,
)
from gonio.figures.style import colour_of, picture, size_for
from gonio.reports.evaluation import ReportFigure, rounded
from gonio.reports.subject import ReportSubject

MOST_DRAWN = 400
"""Directions that were read, above which the pictures of a grid show more."""
MOST_LISTED = 40
"""Directions that were read, above which a list of them is no help."""
MOST_COLUMNS = 6
"""Channels of a list."""
FEWEST_WAVELENGTHS = 4


class _Read:
    """The valid readings of a table: angles, degrees, by name; f and u, (n, channels), NaN where not valid."""

    def __init__(self, s: ReportSubject) -> None:
        assert s.table is not None
        cells = s.table.valid_cells()
        block = s.table.values_at(cells)
        valid = block["flag"] == Flag.VALID
        self.f = np.where(valid, np.asarray(block["f"], float), np.nan)
        self.u = np.where(valid, np.asarray(block["u_f"], float), np.nan)
        theta_i, phi_i, theta_o, phi_o = (np.degrees(a)[cells] for a in s.table.layout.angles())
        # At the normal a direction has no azimuth.
        phi_i = np.where(theta_i > 1e-6, phi_i, 0.0)
        turn = np.round(np.where(theta_o > 1e-6, phi_o - phi_i, 0.0), 9) % 360.0
        self.angles = {"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "delta_phi": turn}

    @property
    def in_plane(self) -> bool:
        """Whether all readings are in the plane of incidence."""
        return bool((np.abs(np.sin(np.radians(self.angles["delta_phi"]))) < 1e-3).all())


def figures(s: ReportSubject) -> list[ReportFigure]:
    """The pictures of a table of few readings; none of one that has many."""
    if s.table is None or not 0 < s.read <= MOST_DRAWN:
        return []
    read = _Read(s)
    # In the plane of incidence the usual picture shows them all.
    return ([] if read.in_plane and _one_azimuth(read) else _over_angle(s, read)) + _over_wavelength(s, read)


def _one_azimuth(read: _Read) -> bool:
    return settings(read.angles["phi_i"]).size == 1


def _over_angle(s: ReportSubject, read: _Read) -> list[ReportFigure]:
    angle, groups = varying_angle(read.angles)
    x, f, u = read.angles[angle], read.f[:, s.shown], read.u[:, s.shown]
    points = [
        Points(x[of], f[of], u[of], name, colour_of(s.number + k).colour) for k, (name, of) in enumerate(groups.items())
    ]
    points = [p for p in points if np.isfinite(p.f).any()]
    if not points:
        return []
    where = LABELS[angle].split(" (")[0]
    bars = " with their standard uncertainties" * bool(np.isfinite(u).any())
    caption = f"All readings{bars} over {where}, {s.in_channel}."
    data = {
        "channel": s.channel, "angle": f"{angle}_deg",
        "sets": [{"name": p.label, "angle_deg": rounded(p.x), "f_per_sr": rounded(p.f), "u_f_per_sr": rounded(p.u)}
                 for p in points],
    }  # fmt: skip
    label = f"Readings of {s.name} over {where}, {s.in_channel}"
    image = picture(label, draw_over_angle, points, angle, size=size_for([p.label for p in points]))
    return [ReportFigure("readings", caption, image, data)]


def _over_wavelength(s: ReportSubject, read: _Read) -> list[ReportFigure]:
    wavelengths = s.channels.wavelengths_nm
    if wavelengths is None or len(wavelengths) < FEWEST_WAVELENGTHS:
        return []
    x, number = np.asarray(wavelengths, float), len(read.f)
    chosen = np.unique(np.linspace(0, number - 1, min(number, MOST_GROUPS)).round().astype(int))
    points = [
        Points(x, read.f[k], read.u[k], _place(read, k), colour_of(s.number + n).colour, joined=True)
        for n, k in enumerate(chosen)
    ]
    caption = f"Readings over the wavelength at {len(chosen)} of {number} pairs of directions."
    data = {
        "wavelengths_nm": list(wavelengths),
        "sets": [{"name": p.label, "f_per_sr": rounded(p.f), "u_f_per_sr": rounded(p.u)} for p in points],
    }
    size = size_for([p.label for p in points])
    image = picture(f"Spectra of {s.name}", draw_over_wavelength, points, size=size)
    return [ReportFigure("spectra", caption, image, data)]


def _place(read: _Read, k: int) -> str:
    theta_i, phi_i, theta_o, turn = (read.angles[name][k] for name in ("theta_i", "phi_i", "theta_o", "delta_phi"))
    azimuth = "" if _one_azimuth(read) else f", φᵢ {phi_i:.4g}°"
    return f"θᵢ {theta_i:.4g}°{azimuth}, θₒ {theta_o:.4g}°, Δφ {turn:.4g}°"


def listed(s: ReportSubject) -> dict[str, Any] | None:
    """The readings one by one, where they are few; of many channels some, evenly chosen."""
    if s.table is None or not 0 < s.read <= MOST_LISTED:
        return None
    read, count = _Read(s), len(s.channels)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_COLUMNS)).round().astype(int))
    known = bool(np.isfinite(read.u).any())
    columns = zip(zip(*read.angles.values(), strict=True), read.f, read.u, strict=True)
    rows = [
        {"angles_deg": rounded(angles), "f_per_sr": rounded(f[chosen])}
        | ({"u_f_per_sr": rounded(u[chosen], 3)} if known else {})
        for angles, f, u in columns
    ]
    return {"channels": [s.channels.names[k] for k in chosen], "all_channels": count, "known": known, "rows": rows}
