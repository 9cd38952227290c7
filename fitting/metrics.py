"""How far a model is from readings, in the measures that people compare by."""

import numpy as np

from gonio.fitting.samples import Readings


def metrics(model_f: np.ndarray, readings: Readings) -> dict[str, float]:
    """Differences of model and readings, (n, channels) each, over the valid readings.

    `relative_rms` = √(Σ(m−y)²/Σy²); `relative_rms_cosine` the same of f cosθi cosθo; `median_relative` the median of
    |m−y|/|y|; `log_rms` of log(1+f) [Ngan 2005 and others]; `cbrt_rms` of (f cosθi)^⅓; `bias` the mean of m−y, 1/sr.
    """
    valid, y, m = readings.valid, readings.f, model_f
    cos_i, cos_o = (np.asarray(w.z)[:, None] for w in (readings.wi, readings.wo))
    difference = np.where(valid, m - y, 0.0)
    count = max(1, int(valid.sum()))

    def rms(a: np.ndarray) -> float:
        return float(np.sqrt(np.sum(np.where(valid, a, 0.0) ** 2) / count))

    def ratio(weight: np.ndarray | float) -> float:
        below = float(np.sum(np.where(valid, y * weight, 0.0) ** 2))
        return float(np.sqrt(np.sum((difference * weight) ** 2) / below)) if below > 0 else float("nan")

    seen = valid & (y != 0)
    signed_log = lambda v: np.sign(v) * np.log1p(np.abs(v))  # noqa: E731
    return {
        "relative_rms": ratio(1.0),
        "relative_rms_cosine": ratio(cos_i * cos_o),
        "median_relative": float(np.median(np.abs((m - y)[seen] / y[seen]))) if seen.any() else float("nan"),
        "log_rms": rms(signed_log(m) - signed_log(y)),
        "cbrt_rms": rms(np.cbrt(m * cos_i) - np.cbrt(y * cos_i)),
        "bias": float(np.sum(difference) / count),
    }
