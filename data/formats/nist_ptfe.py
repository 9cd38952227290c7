"""NIST's Mueller BRDF of sintered PTFE [Germer 2017]: a CSV of scattered geometries at several wavelengths."""

import os

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.formats.csv_columns import CsvText
from gonio.data.table import Table
from gonio.models.errors import GonioError

NAMES = ("lambda", "thetai", "phii", "thetar", "phir", "f_r11")
ALIASES = {"phi": "phii", "fr11": "f_r11"}
"""Other names of the columns."""
WAVELENGTH_TOLERANCE_NM = 0.5


def columns_of(names: list[str]) -> dict[str, str]:
    """The columns of a header by our names for them; empty for a header that is not of NIST's files."""
    columns = {ALIASES.get(name, name): name for name in reversed(names)}
    return {key: columns[key] for key in NAMES} if set(NAMES) <= set(columns) else {}


def read_nist(path: str | os.PathLike[str], wavelength_nm: float | None = None) -> Table:
    """The scattered table of a NIST PTFE file; f = f_r11, the unpolarised BRDF, 1/sr.

    One channel a wavelength, if all were measured at the same geometries, or only that of `wavelength_nm`.
    The files store theta_i negative and put the specular side at phi_r = phi_i: delta_phi = 180° − (phi_r −
    phi_i) here. Raises GonioError for a wavelength that the file does not have, and for whatever is no
    number.
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
    delta_phi = np.pi - (phi_r - phi_i)
    # A negative polar angle on the detector's side would turn its azimuth by half a circle.
    delta_phi = np.where(theta_r < 0, delta_phi + np.pi, delta_phi)
    turn = 2 * np.pi
    grid = layouts.scattered(np.abs(theta_i), phi_i % turn, np.abs(theta_r), (phi_i + delta_phi) % turn)
    f = np.stack([data["f_r11"][r] for r in rows], axis=-1)
    provenance = {
        "format": "NIST PTFE CSV",
        "source": os.path.basename(path),
        "material": "sintered PTFE",
        "ignored_columns": [n for n in text.names if n not in columns.values()],
        "assumptions": [
            "theta_i is stored negative: its magnitude was taken",
            "delta_phi = 180 degrees - (phi_r - phi_i): the file has the specular side at phi_r = phi_i",
        ],
    }
    flag = np.zeros(f.shape, np.uint8)
    return Table(grid, f, flag, Channels.of_wavelengths(wavelengths), provenance=provenance, name=stem(path))
