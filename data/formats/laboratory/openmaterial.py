"""BRDF look-up tables of ASAM OpenMATERIAL 3D (``.xompt``): JSON rows of wavelength (m), angles (radians) and f."""

import os
from typing import Any

import numpy as np

from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.formats.csv.conventions import convention
from gonio.data.formats.csv.listed_rows import Listing, rounding_of, table_of_listing
from gonio.data.formats.csv.readings import Readings, by_channel
from gonio.data.formats.laboratory.json_text import JsonPart, read_json
from gonio.data.table import Table
from gonio.models.errors import GonioError

KIND = "a BRDF table of OpenMATERIAL"
COLUMNS = 5
FACTS = ("description", "license", "sources", "materialVersion", "typicalSensorTechnology", "uuid")


def is_openmaterial(start: bytes) -> bool:
    """Whether a file begins as such a table does."""
    return start.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and (
        b"material_brdf_schema" in start or (b'"lookupTable"' in start and b'"brdf"' in start)
    )


def read_openmaterial(
    path: str | os.PathLike[str], quantity: str | None = None, mirror_azimuth: float | None = None
) -> Table:
    """The table of a look-up table: one channel a wavelength; null is not measured.

    Args:
        path: the file.
        quantity: what the values are (a key of `gonio.data.quantities.QUANTITIES`); the BRDF otherwise.
        mirror_azimuth: exit azimuth of the mirror side, degrees: 180 or 0.

    Raises:
        GonioError: damaged JSON, rows of other than five numbers, wavelengths that are none.
    """
    how = convention(quantity, mirror_azimuth)
    data = JsonPart(path, read_json(path, KIND))
    brdf = data.part("brdf")
    rows = brdf.numbers("lookupTable", 2)
    if rows.shape[1:] != (COLUMNS,) or not rows.size:
        raise GonioError(f"{path}: brdf.lookupTable has rows of {rows.shape[1]} numbers, expected {COLUMNS} each")
    if np.isnan(rows[:, :4]).any():
        raise GonioError(f"{path}: brdf.lookupTable has null in place of a wavelength or an angle; leave that row out")
    nm, channel = np.unique(np.round(rows[:, 0] * 1e9, 6), return_inverse=True)
    theta_i, theta_o, phi_o = rows[:, 1:4].T
    flag = np.where(np.isnan(rows[:, 4:]), np.uint8(Flag.NOT_MEASURED), np.uint8(Flag.VALID))
    spread = by_channel(channel.reshape(-1), nm.size, rows[:, 1:4].T, Readings(rows[:, 4:], None, flag))
    if spread is None:
        raise GonioError(f"{path} has {nm.size} wavelengths, few of them at most geometries; split it by wavelength")
    first, readings = spread
    angles = theta_i[first], np.zeros(first.size), theta_o[first], phi_o[first]
    channels = Channels.of_wavelengths(nm)
    listing = Listing(angles, readings.f, channels, None, readings.flag, rounding_of(angles))
    about, solid_angle = _about(data, brdf)
    table = table_of_listing(path, listing, how, about, about["metadata"].get("name", ""))
    table.receiver_solid_angle = solid_angle
    return table


def _about(data: JsonPart, brdf: JsonPart) -> tuple[dict[str, Any], float | None]:
    """(provenance, solid angle of the receiver, sr, where that is one for all wavelengths)."""
    understood, solid_angle = ["wavelengths are in m, angles in radians; the light's azimuth is 0"], None
    if "receiverSolidAngles" in brdf:
        parts = [JsonPart(brdf.path, e, "brdf.receiverSolidAngles") for e in brdf.entries("receiverSolidAngles")]
        stated = {value for part in parts if isinstance(value := part.data.get("solidAngle"), float) and value > 0}
        solid_angle = stated.pop() if len(stated) == 1 else None
        if stated:
            understood.append("the receiver's solid angles differ with the wavelength, and are not used")
    metadata = JsonPart(data.path, data.data.get("metadata", {}), "metadata")
    stated = {key: metadata.text(key)[:400] for key in ("name", *FACTS) if metadata.text(key)}
    return {"format": "OpenMATERIAL", "metadata": stated, "understood": understood}, solid_angle
