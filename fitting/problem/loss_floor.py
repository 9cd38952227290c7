"""Below which size a loss does not tell readings apart: their noise, where it is known."""

import numpy as np

from gonio.fitting.problem.losses import floor_of, uses_cosine
from gonio.fitting.problem.readings import Readings, sigma_of

WITH_FLOOR = ("cbrt", "log")


def loss_floor(readings: Readings, loss: str) -> float:
    """The floor ε of a loss, in the units of what it compares.

    The median standard uncertainty of the readings (times cosθi where the loss has it) for `cbrt` and `log`; without
    one, a hundredth of the median reading for `cbrt`, and 1 for the others.
    """
    cosine = np.asarray(readings.wi.z)[:, None] if uses_cosine(loss) else 1.0
    sigma = sigma_of(readings) if loss in WITH_FLOOR else None
    if sigma is not None:
        return float(np.median((sigma * cosine)[readings.valid]))
    if loss != "cbrt":
        return floor_of(loss, readings.f)
    compared = readings.f * cosine
    return floor_of(loss, compared if readings.valid.all() else compared[readings.valid])
