"""False alarms and power of the checks of readings that should be equal, over random sheets, scans and instruments.

    python tests/benchmarks/checks/random_sheets.py [TABLES [SEED]]

Each honest table is drawn at random: a sheet or an interface, the steps of an isotropic grid of both sides, photons,
dark counts, read noise and a source that flickers. Printed is how many of their families of tests were significant at
the stated level, and how many such a level lets pass by chance; then how many liars the same families called so:
readings that are 5 and 20 % too bright on one side of the plane of incidence, or in one order of light and detector.
"""

import collections
import math
import sys

import jax
import numpy as np
from scipy.stats import binom

import gonio
from gonio.checks.table import equal_readings
from gonio.checks.table.evidence import LEVEL, TableEvidence
from gonio.data.layouts import Layout
from gonio.instrument import scans

CHECKS = {
    "reciprocity": equal_readings.table_reciprocity,
    "symmetry": equal_readings.table_symmetry,
    "pole": equal_readings.table_pole,
}
LIES = (0.05, 0.2)


def material(rng: np.random.Generator) -> str:
    """A random expression of something that transmits."""
    alpha, rho, tau = rng.uniform(0.08, 0.5), rng.uniform(0.02, 0.4), rng.uniform(0.02, 0.5)
    eta = rng.uniform(1.2, 2.0)
    return str(
        rng.choice(
            [
                f"thin_sheet(rho={rho:.3f}, tau={tau:.3f})",
                f"{rho:.3f}*rough_slab(alpha={alpha:.3f}, eta={eta:.3f}) + lambert_transmission(tau={tau:.3f})",
                f"rough_dielectric(alpha={alpha:.3f}, eta={eta:.3f})",
                f"lambert(rho={rho:.3f}) + cosine_power_transmission(n={rng.uniform(2, 60):.2f}, tau={tau:.3f})",
            ]
        )
    )


def instrument(rng: np.random.Generator) -> gonio.Instrument:
    """A random instrument that counts."""
    return gonio.Instrument(
        photons=10 ** rng.uniform(2, 7),
        dark=float(rng.choice([0.0, 0.0, 0.3, 10.0])),
        read_noise=float(rng.choice([0.0, 0.0, 3.0])),
        noise=float(rng.choice([0.0, 0.0, 0.005])),
    )


def scan(rng: np.random.Generator) -> Layout:
    """A random grid of both sides."""
    step, turn = rng.choice([7.5, 10.0, 15.0]), rng.choice([15.0, 22.5, 30.0])
    return scans.isotropic(math.radians(step), hemisphere="both", lit="both", phi_step=math.radians(turn))


def lying(table: gonio.Table, name: str, lie: float) -> gonio.Table:
    """The readings, some of them too bright by a share `lie` in a way that breaks the property."""
    theta_i, phi_i, theta_o, phi_o = (a.reshape(table.layout.shape) for a in table.layout.angles())
    wrong = {"reciprocity": theta_i - theta_o, "symmetry": np.sin(phi_o - phi_i), "pole": np.cos(phi_o - phi_i)}[name]
    factor = np.where(wrong > 1e-9, 1 + lie, 1.0)[..., None]
    return gonio.Table(**{**vars(table), "f": table.f * factor, "u_f": table.u_f * np.sqrt(factor)})


def main() -> None:
    """Prints alarms by property, and each table that failed."""
    jax.config.update("jax_enable_x64", True)
    tables, seed = (int(a) for a in (sys.argv[1:] + ["100", "1"][len(sys.argv) - 1 :]))
    significant, failed, tested = (collections.Counter[str]() for _ in range(3))
    caught = collections.Counter[tuple[str, float]]()
    for k in range(tables):
        rng = np.random.default_rng([seed, k])
        what, how, where = material(rng), instrument(rng), scan(rng)
        table = gonio.measure(what, how, where, seed=k, log=lambda text: None)
        for name, check in CHECKS.items():
            judged = check(TableEvidence(table), 0.05)
            if "p_value" not in judged.facts:
                continue
            tested[name] += 1
            significant[name] += judged.facts["significant"]
            if judged.verdict == "fail":
                failed[name] += 1
                print(f"{k}: {what}, {how.to_dict()}: {name}: {judged.detail}", flush=True)
            for lie in LIES:
                caught[name, lie] += check(TableEvidence(lying(table, name, lie)), 0.05).facts["significant"]
    for name, number in tested.items():
        most = int(binom.ppf(0.99, number, LEVEL))
        power = ", ".join(f"{caught[name, lie]} of those off by {lie:.0%}" for lie in LIES)
        print(
            f"{name:12s} {number} tables: {significant[name]} significant (at level {LEVEL:g} up to {most} by chance), "
            f"{failed[name]} fail; significant liars: {power}"
        )


if __name__ == "__main__":
    main()
