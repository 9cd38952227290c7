"""NIST's Mueller BRDF of sintered PTFE [Germer 2017]: a CSV of scattered geometries at several wavelengths."""

import os

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.formats.csv.columns import CsvText
from gonio.data.table import Table
from gonio.models.errors import GonioError

NAMES = ("lambda", "thetai", "phii", "thetar", "phir", "f_r11")
ALIASES = {"phi": "phii", "fr11": "f_r11"}
"""Other names of the columns."""
WAVELENGTH_TOLERANCE_NM = 0.5
OBLIQUE = np.radians(50.0)
"""Polar angle beyond which a matte surface scatters more to the mirror side than back to the light."""
FORWARD_RATIO = 1.1
FEWEST = 5
"""Readings of a side, at least, to compare."""


def columns_of(names: list[str]) -> dict[str, str]:
    """The columns of a header by our names for them; empty for a header that is not of NIST's files."""
    columns = {ALIASES.get(name, name): name for name in reversed(names)}
    return {key: columns[key] for key in NAMES} if set(NAMES) <= set(columns) else {}


def read_nist(path: str | os.PathLike[str], wavelength_nm: float | None = None) -> Table:
    """The scattered table of a NIST PTFE file; f = f_r11, the unpolarised BRDF, 1/sr.

    One channel a wavelength, if all were measured at the same geometries, or only that of `wavelength_nm`. Which side
    is the mirror's is told by the sign of theta_i, see `_delta_phi`. Raises GonioError for a wavelength that the file
    does not have, for signs of theta_i that leave the mirror side open, and for whatever is no number.
    """
    text = CsvText(path)
    columns = columns_of(text.names)
    if not columns:
        raise GonioError(f"{path} is no NIST PTFE file: expected columns lambda, thetai, phi, thetar, phir, f_r11")
    numbers = text.numbers(columns.values())
    data = {key: numbers[name] for key, name in columns.items()}
    for key in ("thetai", "thetar"):
        outside = np.abs(data[key]) >= 90
        if outside.any():
            row = int(np.argmax(outside))
            text.fail(row, f"{key} = {data[key][row]:g} is at or below the horizon; expected less than 90 degrees")
    nm = np.round(data["lambda"] * 1000.0, 6)
    wavelengths = np.unique(nm)
    if wavelength_nm is not None:
        near = wavelengths[np.abs(wavelengths - wavelength_nm) <= WAVELENGTH_TOLERANCE_NM]
        if near.size != 1:
            there = ", ".join(f"{w:g}" for w in wavelengths)
            raise GonioError(f"{path} has no wavelength {wavelength_nm:g} nm; choose one of {there} nm")
        wavelengths = near
    geometry = np.stack([data[key] for key in ("thetai", "phii", "thetar", "phir")])
    rows = [np.flatnonzero(nm == w) for w in wavelengths]
    same = all(r.size == rows[0].size and (geometry[:, r] == geometry[:, rows[0]]).all() for r in rows)
    if not same:
        raise GonioError(f"{path} has other geometries for each wavelength; choose one with wavelength_nm")
    theta_i, phi_i, theta_r, phi_r = np.radians(geometry[:, rows[0]])
    f = np.stack([data["f_r11"][r] for r in rows], axis=-1)
    delta_phi, understood = _delta_phi(text, theta_i, theta_r, phi_r - phi_i, f.mean(1))
    turn = 2 * np.pi
    grid = layouts.scattered(np.abs(theta_i), phi_i % turn, np.abs(theta_r), (phi_i + delta_phi) % turn)
    provenance = {
        "format": "NIST PTFE CSV",
        "source": os.path.basename(path),
        "material": "sintered PTFE",
        "ignored_columns": [n for n in text.names if n not in columns.values()],
        "understood": understood,
    }
    flag = np.zeros(f.shape, np.uint8)
    table = Table(grid, f, flag, Channels.of_wavelengths(wavelengths), provenance=provenance, name=stem(path))
    if (ratio := _forward_ratio(delta_phi, theta_i, theta_r, f.mean(1))) is not None and ratio < 1:
        provenance["warnings"] = [
            f"beyond 50° the readings on the mirror side are {ratio:.3g} of those back to the light: if that is wrong, "
            "the sign of theta_i is the wrong one"
        ]
    return table


def _delta_phi(
    text: CsvText, theta_i: np.ndarray, theta_r: np.ndarray, difference: np.ndarray, f: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """(azimuth of the detector minus that of the light, what was understood), radians.

    The regular set stores theta_i negative and has the mirror side at phi_r = phi_i, the random set stores it positive
    and has the mirror side at phi_r = phi_i + 180° [Germer 2017]: by either, a negative polar angle on one side turns
    its azimuth by half a circle. Where both signs occur the readings decide, as light is scattered forward at oblique
    angles; raises GonioError where they do not.
    """
    stored_negative = theta_i < 0
    by_row = np.where(stored_negative ^ (theta_r < 0), np.pi - difference, difference)
    if not (stored_negative.any() and (theta_i > 0).any()):
        if stored_negative.any():
            return by_row, ["theta_i is negative: the mirror side is phi_r = phi_i"]
        return by_row, ["theta_i is positive: the mirror side is phi_r = phi_i + 180°"]
    choices = {"by the sign of each row": by_row}
    for name, turned in (("phi_r = phi_i", True), ("phi_r = phi_i + 180°", False)):
        choices[name] = np.where(turned ^ (theta_r < 0), np.pi - difference, difference)
    ratios = {name: _forward_ratio(delta, theta_i, theta_r, f) or 0.0 for name, delta in choices.items()}
    best = max(ratios, key=lambda name: ratios[name])
    if sum(ratio >= FORWARD_RATIO for ratio in ratios.values()) != 1:
        text.refuse(
            "thetai has both signs, and the readings do not tell the mirror side; write thetai negative where that is "
            "phir = phii, positive where it is phir = phii + 180"
        )
    return choices[best], [f"thetai has both signs: by the readings beyond 50° the mirror side is told {best}"]


def _forward_ratio(delta_phi: np.ndarray, theta_i: np.ndarray, theta_r: np.ndarray, f: np.ndarray) -> float | None:
    """Mean of the readings beyond 50° within 45° of the mirror side over that of those back to the light, or None."""
    oblique = np.minimum(np.abs(theta_i), np.abs(theta_r)) > OBLIQUE
    forward, back = (oblique & (side * np.cos(delta_phi) > np.sqrt(0.5)) for side in (-1, 1))
    if min(forward.sum(), back.sum()) < FEWEST or not (f[back] > 0).all():
        return None
    return float(f[forward].mean() / f[back].mean())
