"""False alarms of the test of reciprocity at its stated level, over honest noisy tables of the simulated instrument,
and its power against violations of known size.

    python reciprocity_levels.py [TABLES]
"""

import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import gonio  # noqa: E402
from gonio.checks.table.equal_readings import table_reciprocity  # noqa: E402
from gonio.checks.table.evidence import TableEvidence  # noqa: E402
from gonio.data import layouts  # noqa: E402
from gonio.instrument.instrument import Instrument  # noqa: E402

POLAR = np.radians(np.arange(0, 86, 10.0))
SCAN = layouts.isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 15)))
MATERIAL = gonio.material("lambert(rho=0.3) + 0.3 * ggx(alpha=0.3)")
REGIMES = {
    "2 % multiplicative": Instrument(noise=0.02),
    "10 % multiplicative": Instrument(noise=0.1),
    "1e4 photons, 0.5 %, dark 5": Instrument(noise=0.005, photons=1e4, dark=5.0),
    "100 photons": Instrument(photons=100.0),
    "10 photons, dark 1": Instrument(photons=10.0, dark=1.0),
}
VIOLATIONS = (0.02, 0.05, 0.10)
LEVELS = (0.01, 0.10)
REPEATS = 100


def p_value(instrument, seed, violation=0.0):
    table = gonio.measure(MATERIAL, instrument, SCAN, seed=seed)
    theta_i, _, theta_o, _ = (a.reshape(SCAN.shape) for a in SCAN.angles())
    factor = (1 + violation * np.sign(theta_i - theta_o) / 2)[..., None]
    table.f, table.u_f = table.f * factor, table.u_f * factor
    return table_reciprocity(TableEvidence(table), 0.05).facts["p_value"]


def main() -> None:
    tables = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    head = "".join(f"{f'alarms at {x:.0%}':>16}" for x in LEVELS)
    print(f"{'instrument':28}{head}" + "".join(f"{f'power, {v:.0%}':>14}" for v in VIOLATIONS), flush=True)
    total = np.zeros(len(LEVELS))
    for name, instrument in REGIMES.items():
        p = np.array([p_value(instrument, seed) for seed in range(tables)])
        alarms = [float(np.mean(p < level)) for level in LEVELS]
        total += alarms
        power = [
            np.mean([p_value(instrument, 10_000 + seed, v) < LEVELS[0] for seed in range(REPEATS)]) for v in VIOLATIONS
        ]
        row = "".join(f"{a:16.2%}" for a in alarms) + "".join(f"{float(x):14.0%}" for x in power)
        print(f"{name:28}{row}", flush=True)
    print(f"{f'all {tables * len(REGIMES)} tables':28}" + "".join(f"{a / len(REGIMES):16.2%}" for a in total))


if __name__ == "__main__":
    main()
