"""How far a model is from readings, in the measures that people compare by."""

import numpy as np

from gonio.fitting.problem.readings import CHUNK, Readings


def metrics(model_f: np.ndarray, readings: Readings) -> dict[str, float]:
    """Differences of model and readings, (n, channels) each, over the valid readings.

    `relative_rms` = √(Σ(m−y)²/Σy²); `relative_rms_cosine` the same of f cosθi cosθo; `median_relative` the median of
    |m−y|/|y|; `log_rms` of log(1+f) [Ngan 2005 and others]; `cbrt_rms` of (f cosθi)^⅓; `bias` the mean of m−y, 1/sr.
    """
    sums, relative, known = np.zeros(7), np.empty(readings.f.size), 0
    for first in range(0, readings.f.shape[0], CHUNK):
        some = slice(first, first + CHUNK)
        valid, y, m = readings.valid[some], readings.f[some], model_f[some]
        cos_i, cos_o = (np.repeat(np.asarray(w.z)[some, None], y.shape[1], axis=1) for w in (readings.wi, readings.wo))
        if not valid.all():
            y, m = np.where(valid, y, 0.0), np.where(valid, m, 0.0)
        both, off = cos_i * cos_o, m - y
        logs = np.sign(m) * np.log1p(np.abs(m)) - np.sign(y) * np.log1p(np.abs(y))
        roots = np.cbrt(m * cos_i) - np.cbrt(y * cos_i)
        squares = [np.sum(a * a) for a in (off, y, off * both, y * both, logs, roots)]
        sums += [*squares, off.sum()]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.abs(off / y)[y != 0]
        relative[known : known + share.size] = share
        known += share.size
    count, relative = max(1, readings.count), relative[:known]

    def ratio(above: float, below: float) -> float:
        return float(np.sqrt(above / below)) if below > 0 else float("nan")

    return {
        "relative_rms": ratio(sums[0], sums[1]),
        "relative_rms_cosine": ratio(sums[2], sums[3]),
        "median_relative": float(np.median(relative, overwrite_input=True)) if relative.size else float("nan"),
        "log_rms": float(np.sqrt(sums[4] / count)),
        "cbrt_rms": float(np.sqrt(sums[5] / count)),
        "bias": float(sums[6] / count),
    }
