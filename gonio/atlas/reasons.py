"""Why a silent failure that is known is left: method, model, where (in setting, column or precision), reason."""

from gonio.atlas.cell import Cell

KNOWN: tuple[tuple[str, str, str, str], ...] = ()


def reason_of(cell: Cell) -> str:
    """The reason that is known for a cell's failure, or nothing."""
    where = f"{cell.row} {cell.column} {cell.precision}"
    return next((why for m, n, at, why in KNOWN if m == cell.method and n == cell.model and at in where), "")
