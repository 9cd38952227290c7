"""False alarms of checks of honest tables of both sides of a sample: materials × instruments × scans × seeds.

python tests/benchmarks/checks/transmission_alarms.py
"""

import collections
import itertools
import math

import jax

import gonio
from gonio.instrument import scans

MATERIALS = (
    "thin_sheet(rho=0.3, tau=0.5)",
    "thin_sheet(rho=0.02, tau=0.97)",
    "lambert(rho=0.2) + lambert_transmission(tau=[0.7, 0.5, 0.1])",
    "rough_dielectric(alpha=0.4, eta=1.5)",
    "rough_dielectric(alpha=0.2, eta=1.33)",
)
INSTRUMENTS = (
    gonio.Instrument(photons=1e5),
    gonio.Instrument(photons=1e6, dark=10.0, read_noise=3.0, noise=0.002),
    gonio.Instrument(photons=1e4, ambient=0.05),
)
STEP = math.radians(10)
SCANS = (
    scans.isotropic(STEP, hemisphere="both", lit="both"),
    scans.isotropic(STEP / 2, hemisphere="transmission", lit="back", phi_step=math.radians(15)),
)
LONGEST_LIST = 12_000


def main() -> None:
    """Prints each failed property, and how many tables had each verdict."""
    jax.config.update("jax_enable_x64", True)
    count: collections.Counter[tuple[str, str]] = collections.Counter()
    for material, instrument, scan, seed in itertools.product(MATERIALS, INSTRUMENTS, SCANS, (1, 2)):
        table = gonio.measure(material, instrument, scan, seed=seed, log=lambda text: None)
        forms = [table] + ([table.as_list()] if seed == 2 and scan.size <= LONGEST_LIST else [])
        for p in (p for form in forms for p in gonio.check(form).properties):
            count[p.name, p.verdict] += 1
            if p.verdict == "fail":
                print(f"{material}, {instrument.to_dict()}, seed {seed}: {p.name}: {p.detail}")
    for (name, verdict), number in sorted(count.items()):
        print(f"{name:12s} {verdict:15s} {number}")


if __name__ == "__main__":
    main()
