"""Whether a table holds the patches of a sheet's BSDF."""

from typing import TYPE_CHECKING

from gonio.data.table import Table

if TYPE_CHECKING:
    from gonio.data.interpolation.scattering_blocks import SheetBSDF


def sheet_of(table: Table) -> "SheetBSDF | None":
    """The sheet whose patches a table holds; None for all other tables."""
    if table.interpolant is None:
        return None
    from gonio.data.interpolation.scattering_blocks import SheetBSDF

    brdf = table.interpolant()
    return brdf if isinstance(brdf, SheetBSDF) else None
