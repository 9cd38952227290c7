"""Errors of fitted numbers in their standard uncertainties: 20 draws of 5 % noise on 20,000 samples of MERL's grid."""

import jax
import numpy as np

from gonio.data import layouts
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.fitting.fit_table import fit
from gonio.models.expression.builder import build

TRUTH = np.array([0.1, 0.2, 0.4, 0.2, 1, 0.8, 0.6])
DRAWS, NOISE = 20, 0.05


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    layout = layouts.merl()
    exact = grid_values(build("lambert(rho=[.1,.2,.4]) + [1,.8,.6]*ggx(alpha=.2, eta=1.5)"), layout)
    cases = {"matched to the noise, reweighted": {"relative_noise": NOISE}} | {
        f"loss {n}": {"loss": n} for n in ("cbrt", "log", "log1p")
    }
    print(
        f"{'weights':34} {'within 1':>9} {'worst':>6} {'rms':>6}   mean error of each number, in standard uncertainties"
    )
    for name, options in cases.items():
        z = []
        for draw in range(DRAWS):
            noisy = exact * (1 + NOISE * np.random.default_rng(100 + draw).standard_normal(exact.shape))
            table = whole_table_of_values(layout, noisy)
            result = fit(
                table,
                "lambert + ggx(eta=1.5)",
                samples=20_000,
                theta_max=np.radians(80),
                seed=draw,
                starts=4,
                **options,
            )
            assert result.converged, result.reason
            free = [p for p in result.parameters if p.status != "fixed"]
            z.append([(p.value - t) / p.standard_uncertainty for p, t in zip(free, TRUTH, strict=True)])
        z = np.array(z)
        bias = " ".join(f"{b:+.2f}" for b in z.mean(0))
        print(f"{name:34} {np.mean(np.abs(z) < 1):9.3f} {np.abs(z).max():6.2f} {np.sqrt(np.mean(z**2)):6.2f}   {bias}")


if __name__ == "__main__":
    main()
