"""What a user would write without gonio: SciPy's bounded least squares on a NumPy model, of a MERL file.

python scipy_fit.py FILE SAMPLES     (0: all below 80°); prints the seven numbers and the seconds of the fit itself
"""

import sys
import time

import numpy as np
from scipy.optimize import least_squares

SCALE = np.array([1.0, 1.15, 1.66]) / 1500


def main(path: str, samples: int) -> None:
    y = np.moveaxis(np.fromfile(path, np.float64, offset=12).reshape(3, 90, 90, 180), 0, -1) * SCALE
    h, d, p = np.meshgrid(
        (np.arange(90) / 90) ** 2 * np.pi / 2, np.radians(np.arange(90)), np.radians(np.arange(180)), indexing="ij"
    )
    a, b = np.cos(h) * np.cos(d), np.sin(h) * np.sin(d) * np.cos(p)
    cos_i, cos_o, cos_h, c = (x.ravel() for x in (a - b, a + b, np.cos(h), np.cos(d)))
    keep = np.flatnonzero((np.minimum(cos_i, cos_o) > np.cos(np.radians(80))) & (y.reshape(-1, 3).min(-1) >= 0))
    if samples:
        keep = np.random.default_rng(0).choice(keep, samples, replace=False)
    cos_i, cos_o, cos_h, c, y = cos_i[keep], cos_o[keep], cos_h[keep], c[keep], np.log1p(y.reshape(-1, 3)[keep])
    g = np.sqrt(1.5**2 - 1 + c**2)
    f = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)

    def residual(x):
        a2 = x[6] ** 2
        lobe = a2 / (np.pi * (cos_h**2 * (a2 - 1) + 1) ** 2) * f * 0.5
        lobe /= cos_o * np.sqrt(a2 + (1 - a2) * cos_i**2) + cos_i * np.sqrt(a2 + (1 - a2) * cos_o**2)
        return (np.log1p(x[:3] / np.pi + x[3:6] * lobe[:, None]) - y).ravel()

    began = time.perf_counter()
    low, high = np.r_[np.zeros(6), 1e-3], np.r_[np.ones(3), np.full(3, 5.0), 1.0]
    found = least_squares(residual, np.r_[np.full(6, 0.5), 0.3], bounds=(low, high), x_scale="jac", method="trf")
    print("seconds", time.perf_counter() - began, "cost", found.cost, "numbers", *found.x)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
