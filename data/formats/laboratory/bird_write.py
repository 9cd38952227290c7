"""Writing BiRD JSON, schema 1.0: a row for each reading, with its uncertainty."""

import json
import os
from datetime import UTC, datetime
from typing import Any

import numpy as np

from gonio.data.files import new_file
from gonio.data.flags import Flag
from gonio.data.formats.csv.table_file import rounded_degrees, written_cells
from gonio.data.formats.laboratory.bird import read_bird
from gonio.data.formats.laboratory.bird_section import SECTION, section_of
from gonio.data.formats.laboratory.json_text import MOST_BYTES
from gonio.data.reflection_only import require_reflection
from gonio.data.round_trip import RoundTrip, compare
from gonio.data.table import Table
from gonio.models.errors import GonioError

SCHEMA = "https://raw.githubusercontent.com/BiRD-project/BiRD_view/master/BRDF_JSON_schema/brdf_json_schema_v1.0.json"
FACTS = {
    "theta_i": "Illumination light/beam incidence zenith angle.",
    "phi_i": "Illumination light/beam incidence azimuthal angle.",
    "theta_r": "Reflected light/beam observation zenith angle.",
    "phi_r": "Reflected light/beam observation azimuthal angle.",
}


def write_bird(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    """Writes the readings of a table, and returns what reading them again shows to be lost.

    Cells without a value have no row; gonio's section section keeps their flags, and the grid. Raises GonioError for a
    table that transmits, one without a valid reading, one too large, and where `path` cannot be written.
    """
    require_reflection(table, table.name or "the table", "a BiRD file")
    cells = written_cells(table)
    angles = [a[cells] for a in table.layout.angles()]
    degrees = {name: rounded_degrees(a) for name, a in zip(FACTS, angles, strict=True)}
    values = table.values_at(cells)
    valid = values["flag"] == Flag.VALID
    if not valid.any():
        raise GonioError(f"the table holds no valid reading; there is nothing to write to {path}")
    row, channel = np.nonzero(valid)
    f, u_f = (values[k][valid].astype(np.float64) for k in ("f", "u_f"))
    data: dict[str, Any] = {name: _variable(name, "deg", degrees[name][row], FACTS[name]) for name in FACTS}
    if (wavelengths := table.channels.wavelengths_nm) is not None:
        data["wavelength_i"] = _variable(
            "wavelength_i", "nm", np.array(wavelengths)[channel], "Illumination light wavelength."
        )
    data["BRDF"] = _variable("BRDF", "1/sr", f, "Bidirectional reflectance distribution function.")
    if not np.isnan(u_f).all():
        about = "Uncertainty of bidirectional reflectance distribution function."
        data["uBRDF"] = _variable("BRDF", "1/sr", np.nan_to_num(u_f), about)
        data["uBRDF"]["comments"] = "standard uncertainty, k = 1"
    numbers = row if not table.layout.gridded else cells[row]
    names = [table.channels.names[k] for k in channel]
    data["adhoc_variables"] = {
        "cell": _variable("cell", "", numbers, "Number of the cell in gonio's grid."),
        "channel": _variable("channel", "", names, "Name of the channel."),
    }
    content = {"metadata": _metadata(table, section_of(table, cells, valid, degrees)), "data": data}
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    if len(text) > MOST_BYTES:
        raise GonioError(
            f"the table has {row.size:,} readings, {len(text) >> 20} MiB of JSON, and at most {MOST_BYTES >> 20} are "
            "read again; thin it: gonio reduce"
        )
    with new_file(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")
        again = read_bird(temporary)
    return _compared(table, cells, again, f)


def _variable(name: str, unit: str, values: Any, description: str) -> dict[str, Any]:
    return {"name": name, "description": description, "unit": unit, "values": np.asarray(values).tolist()}


def _metadata(table: Table, section: dict[str, Any]) -> dict[str, Any]:
    """What a table knows of the metadata that the schema asks for."""
    measured = "instrument" not in table.provenance
    return {
        "schema": SCHEMA,
        "type": "BRDF",
        "timestamp": datetime.now(UTC).isoformat(timespec="seconds"),
        "description": str(table.provenance.get("material", "") or table.provenance.get("source", "")),
        "method": "measurement" if measured else "simulation",
        "sample": {"name": table.name},
        "adhoc_section": {SECTION: section},
    }


def _compared(table: Table, cells: np.ndarray, again: Table, f: np.ndarray) -> RoundTrip:
    values = table.values_at(cells)
    valid = values["flag"] == Flag.VALID
    read = again.values_at(cells) if again.layout.gridded else again.read_values()
    negative = int((f < 0).sum())
    notes = [f"{negative} negative readings kept, which the schema does not allow"] if negative else []
    return compare(values["f"], read["f"], valid, read["flag"] == Flag.VALID, "; ".join(notes))
