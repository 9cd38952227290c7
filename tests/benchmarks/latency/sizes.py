"""Large tables, warm, each command in a process of its own: seconds, processor time, peak memory.

python sizes.py [--step DEGREES] [--channels N] [--runs N]

By default 1.2 degrees, 1.7 million cells, of eight channels: measured, checked, fitted.
"""

import argparse
import os
import pathlib
import statistics
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from support.process import gonio, timed

COMMANDS = {
    "measure": ("measure '{material}' --scan isotropic --step {step:g} --photons 1e7 --seed 1 -o t.h5 --force", None),
    "check": ("check t.h5", (5, 500)),
    "fit": ("fit t.h5 -m 'lambert + ggx(eta=1.5)' -o t.fit.toml --force", (4, 500)),
}
"""A command; the seconds and the MB that 1.7 million cells of eight channels should take."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--step", type=float, default=1.2)
    parser.add_argument("--channels", type=int, default=8)
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    rho = [round(0.1 + 0.4 * k / args.channels, 3) for k in range(args.channels)]
    words = {
        "material": f"lambert(rho={rho}) + ggx(alpha=0.3, eta=1.5)",
        "step": args.step,
    }
    with tempfile.TemporaryDirectory() as folder:
        cells = round(90 / args.step) ** 2 * round(360 / args.step)
        print(f"{cells / 1e6:.3g} million cells × {args.channels}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()}")
        print(f"{'':10}{'wall s':>9}{'CPU s':>9}{'MB':>7}   target")
        for verb, (command, target) in COMMANDS.items():
            line = ["sh", "-c", 'exec "$0" ' + command.format(**words), *gonio()]
            timed(line, folder)  # what is compiled is kept
            runs = [timed(line, folder) for _ in range(args.runs)]
            assert all(r.status in (0, 1, 3) for r in runs), runs[0].output
            wall, cpu, peak = (statistics.median(r[k] for r in runs) for k in (1, 2, 3))
            print(f"{verb:10}{wall:9.2f}{cpu:9.2f}{peak:7.0f}   {target or ''}", flush=True)
        size = os.path.getsize(os.path.join(folder, "t.h5")) / 1e6
        print(f"the table takes {size:.0f} MB; load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
