"""Energy of tables of both sides of a sample with the help of a model: whether the bounds hold the truth, and how wide.

python tests/benchmarks/checks/assisted_sides.py
"""

import math

import jax
import numpy as np

import gonio
from gonio.checks.table.energy import _assisted, table_albedos
from gonio.checks.table.evidence import TableEvidence
from gonio.instrument import scans
from gonio.models.albedo import directional_albedo, directional_transmittance

TRUTHS = {
    "thin_sheet(rho=0.3, tau=0.4) + 0.2*transmitted(base=ggx(alpha=0.15))": (
        "thin_sheet + transmitted(base=ggx)",
        "thin_sheet + transmitted(base=beckmann)",
        "thin_sheet",
    ),
    "0.8*rough_slab(alpha=0.15) + lambert_transmission(tau=0.1)": (
        "rough_slab + lambert_transmission",
        "thin_sheet + transmitted(base=ggx)",
    ),
    "rough_dielectric(alpha=0.3, eta=1.5)": ("rough_dielectric", "rough_dielectric(distribution=beckmann)"),
    "lambert(rho=0.6) + cosine_power_transmission(n=20, tau=0.3)": ("lambert + cosine_power_transmission", "auto"),
}
INSTRUMENTS = gonio.Instrument(), gonio.Instrument(photons=1e6)


def main() -> None:
    """Prints for each table and model how many incidences lie outside of their bounds, and the bounds' size."""
    jax.config.update("jax_enable_x64", True)
    for truth, models in TRUTHS.items():
        brdf = gonio.material(truth).brdf
        for instrument in INSTRUMENTS:
            grid = scans.isotropic(math.radians(10), hemisphere="both", lit="both", phi_step=math.radians(15))
            table = gonio.measure(truth, instrument, grid, seed=1, log=lambda text: None)
            for model in (None, *models):
                evidence = TableEvidence(table, model=model, feature_width=math.radians(2))
                a = table_albedos(table, evidence.feature_width) if model is None else _assisted(evidence)
                if isinstance(a, str):
                    print(f"{truth} by {model}: {a}", flush=True)
                    continue
                both = (
                    g(brdf, a.theta_i, a.phi_i, 1e-6).value for g in (directional_albedo, directional_transmittance)
                )
                exact = np.reshape(sum(both), a.value.shape)
                outside = (exact > a.value + a.above) | (exact < a.value - a.below)
                size = np.median(np.maximum(a.above, a.below))
                print(
                    f"{truth}, {instrument.to_dict()}, by {model}: {outside.sum()} of {outside.size} outside,"
                    f" error up to {np.max(np.abs(exact - a.value)):.2g}, bounds ± {size:.2g} at the median",
                    flush=True,
                )


if __name__ == "__main__":
    main()
