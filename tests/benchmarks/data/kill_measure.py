"""A noisy measurement with apertures, killed at ten random moments and taken up again, against an undisturbed one."""

import os
import pathlib
import random
import shlex
import signal
import subprocess
import sys
import tempfile
import time

import h5py
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from support.process import gonio, timed

COMMAND = shlex.split(
    "measure two_lobe_paint --scan isotropic --step 1 --phi-step 3 --seed 3 --source-half-angle 0.25"
    " --detector-half-angle 0.5 --photons 1e6 --noise 0.002 -o"
)
KILLS = 10


def main() -> None:
    rng = random.Random(7)
    with tempfile.TemporaryDirectory() as folder:
        whole = timed([*gonio(), *COMMAND, "whole.h5"], folder)
        assert whole.status == 0, whole.output
        print(f"undisturbed: {whole.wall:.1f} s")
        attempts = 0
        for kill in range(KILLS):
            child = subprocess.Popen([*gonio(), *COMMAND, "killed.h5"], cwd=folder, stderr=subprocess.DEVNULL)
            # Each life is long enough to get somewhere, and ends at a moment that nothing in the program chose.
            time.sleep(1.3 + rng.uniform(0.0, 0.12) * whole.wall)
            attempts += 1
            if child.poll() is not None:
                print(f"kill {kill + 1}: it had finished already")
                break
            os.kill(child.pid, signal.SIGKILL)
            child.wait()
            print(f"kill {kill + 1}: {timed([*gonio(), 'info', 'killed.h5.part'], folder).output.strip()}")
        last = timed([*gonio(), *COMMAND, "killed.h5", *(["--force"] if finished(folder) else [])], folder)
        assert last.status == 0, last.output
        names = ("f", "u_f", "flag")
        with h5py.File(pathlib.Path(folder, "whole.h5")) as a, h5py.File(pathlib.Path(folder, "killed.h5")) as b:
            same = {n: np.array_equal(a[n][...].view(np.uint8), b[n][...].view(np.uint8)) for n in names}
        print(f"after {attempts} kills the last run took {last.wall:.1f} s; the same, bit for bit: {same}")


def finished(folder: str) -> bool:
    return pathlib.Path(folder, "killed.h5").exists()


if __name__ == "__main__":
    main()
