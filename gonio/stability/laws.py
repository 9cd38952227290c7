"""Values and gradients of a model without a textbook form, judged by laws: finite, not negative, reciprocal."""

import numpy as np

from gonio.models.expression.builder import build
from gonio.stability.directions import COLUMNS, pairs
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, Cell
from gonio.stability.precision import PRECISIONS, cast, cast_directions
from gonio.stability.values_and_gradients import slopes_of, transmits, values_of

LAWS_ONLY = "no textbook form, by laws only"


def law_cells(method: str, name: str, expression: str, precision: str) -> list[Cell]:
    """One cell for each incidence of the method "value" or "gradient".

    Values must be at least 0 and, but for models that declare the violation, symmetric to half of the digits; the
    derivatives by parameters and directions must be finite.
    """
    dtype = PRECISIONS[precision]
    brdf = cast(build(expression), dtype)
    allowed = float(np.sqrt(np.finfo(dtype).eps))
    cells = []
    for column in COLUMNS:
        wi, wo = (cast_directions(w, dtype) for w in pairs(column, transmits(brdf)))
        f = np.asarray(values_of(brdf, wi, wo), float)
        error, finite = 0.0, bool(np.isfinite(f).all())
        if method == "gradient":
            finite = all(np.isfinite(slope).all() for slope in slopes_of(brdf, wi, wo))
        elif finite:
            scale = 1 + np.abs(f)
            exchanged = np.asarray(values_of(brdf, wo, wi), float)
            residuals = {"positivity": np.maximum(-f, 0.0) / scale, "reciprocity": np.abs(f - exchanged) / scale}
            error = max(float(r.max()) for law, r in residuals.items() if law not in brdf.violates)
        verdict = SAYS_SO if not finite else RIGHT if error <= allowed else SILENT
        detail = f"{LAWS_ONLY}: {'finite' if finite else 'not finite'}, largest violation {error:.2g}"
        cells.append(
            Cell(method, name, expression, column, precision, verdict, error if finite else np.inf, allowed, detail)
        )
    return cells
