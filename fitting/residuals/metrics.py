"""Distances between a model and readings in the measures of the literature."""

import numpy as np

from gonio.fitting.problem.readings import Readings, chunks


def metrics(model_f: np.ndarray, readings: Readings) -> dict[str, float]:
    """Distances between a model's values and the valid readings.

    Args:
        model_f: values m (n, C), 1/sr, at the directions of the readings.
        readings: values y (n, C), 1/sr, and which of them are valid.

    Returns:
        `relative_rms` = √(Σ(m−y)²/Σy²); `relative_rms_cosine`, the same of f cosθi cosθo; `median_relative`, the
        median of |m−y|/|y|; `log_rms` of log(1+f) [Ngan 2005]; `cbrt_rms` of (f cosθi)^⅓; `bias`, the mean of m−y.
    """
    sums, relative, known = np.zeros(7), np.empty(readings.f.size), 0
    for chunk in chunks(*readings.f.shape):
        y, m = (np.where(readings.valid[chunk], a[chunk], 0.0) for a in (readings.f, model_f))
        cos_i, cos_o = (np.abs(np.asarray(w.z)[chunk, None]) for w in (readings.wi, readings.wo))
        cosines, off = cos_i * cos_o, m - y
        logs = np.sign(m) * np.log1p(np.abs(m)) - np.sign(y) * np.log1p(np.abs(y))
        roots = np.cbrt(m * cos_i) - np.cbrt(y * cos_i)
        sums += [*(np.sum(a * a) for a in (off, y, off * cosines, y * cosines, logs, roots)), off.sum()]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.abs(off / y)[y != 0]
        relative[known : known + share.size] = share
        known += share.size
    count, relative = max(1, readings.count), relative[:known]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.sqrt(sums[[0, 2]] / np.where(sums[[1, 3]] > 0, sums[[1, 3]], np.nan))
    return {
        "relative_rms": float(ratios[0]),
        "relative_rms_cosine": float(ratios[1]),
        "median_relative": float(np.median(relative, overwrite_input=True)) if known else float("nan"),
        "log_rms": float(np.sqrt(sums[4] / count)),
        "cbrt_rms": float(np.sqrt(sums[5] / count)),
        "bias": float(sums[6] / count),
    }
