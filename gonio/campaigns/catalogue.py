"""The catalogue: one row for each task, in one Parquet file, made from the records whenever that is asked for."""

import json
from collections.abc import Iterable, Sequence
from typing import Any

from gonio.campaigns.store import CATALOGUE, PART, Record, Store
from gonio.campaigns.tasks import LABELS
from gonio.data.files import new_file
from gonio.models.errors import GonioError

MOST_NUMBERS = 400
"""Different free numbers that get columns; of more the files of the fits have all."""
NUMBERS = (
    "converged", "reduced_chi2", "relative_rms", "bic", "largest_albedo", "undetermined", "readings", "channels",
    "promised",
)  # fmt: skip
TEXTS = ("sentence", "expression", "remarks")


def rows_of(records: Iterable[Record], planned: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of the catalogue: names, status, verdicts, numbers with their uncertainties as `NAME` and `u(NAME)`."""
    current, rows = set(planned), []
    for r in (r for r in records if r.kind != PART):
        row: dict[str, Any] = {"key": r.key, "kind": r.kind, "current": r.key in current, **r.labels}
        row |= {"status": r.status, "good": r.good, "verdict": r.row.get("verdict")}
        row |= {name: r.row.get(name) for name in (*NUMBERS, *TEXTS)} | {"of": r.row.get("of")}
        row |= {f"check.{name}": verdict for name, verdict in r.row.get("verdicts", {}).items()}
        for label, value, uncertainty, *_ in r.row.get("parameters", []):
            row |= {label: value, f"u({label})": uncertainty}
        rows.append(row | {"seconds": r.seconds, "cpu_seconds": r.cpu_seconds, "error": r.error, "file": r.file})
    return rows


def write_catalogue(store: Store) -> list[dict[str, Any]]:
    """Writes the catalogue of a campaign's folder, and returns its rows.

    Raises:
        GonioError: the folder has no records, or pyarrow is not installed.
    """
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise GonioError("a catalogue needs pyarrow; install it by pip install 'gonio[campaign]'") from None
    recipe, planned = store.plan()
    rows = rows_of(store.records(), planned)
    names = list(dict.fromkeys(name for row in rows for name in row))
    fixed = _types(arrow)
    numbers = [n for n in names if n not in fixed and not n.startswith("check.")]
    dropped = set(numbers[2 * MOST_NUMBERS :])
    tail = ("seconds", "cpu_seconds", "error", "file")
    order = [n for n in names if n not in dropped and n not in tail] + list(tail)
    kinds = {n: fixed.get(n, arrow.string() if n.startswith("check.") else arrow.float64()) for n in order}
    table = arrow.table(
        {name: arrow.array([row.get(name) for row in rows], kinds[name]) for name in order},
        metadata={"gonio_campaign": json.dumps({"recipe": recipe, "numbers_without_columns": len(dropped) // 2})},
    )
    with new_file(store.folder / CATALOGUE, force=True) as path:
        parquet.write_table(table, path, compression="zstd")
    return rows


def _types(arrow: Any) -> dict[str, Any]:
    texts = (*LABELS, "key", "kind", "status", "verdict", *TEXTS, "of", "error", "file")
    types = dict.fromkeys(texts, arrow.string()) | dict.fromkeys(("current", "good", "converged"), arrow.bool_())
    types |= dict.fromkeys(("undetermined", "readings", "channels"), arrow.int64())
    return (
        types
        | {
            "photons": arrow.float64(),
            "seed": arrow.int64(),
            "seconds": arrow.float64(),
            "cpu_seconds": arrow.float64(),
        }
        | dict.fromkeys(("reduced_chi2", "relative_rms", "bic", "largest_albedo", "promised"), arrow.float64())
    )
