"""A MERL-size table of three channels, measured ideally and stored, as a whole process; and `gonio --help`."""

import pathlib
import statistics
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from support.process import gonio, timed

SPELLING = "lambert(rho=[0.1, 0.2, 0.4]) + [1, 0.8, 0.6] * ggx(alpha=0.2, eta=1.5)"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        command = [*gonio(), "measure", SPELLING, "--scan", "merl", "-o", "t.h5", "--force"]
        cold = timed(command, folder, GONIO_NO_CACHE="1")
        assert cold.status == 0, cold.output
        timed(command, folder)
        warm = [timed(command, folder) for _ in range(5)]
        print(f"measure, no compiled code: {cold.wall:.2f} s, {cold.peak_mb:.0f} MB")
        print(f"measure, cached code:      {statistics.median(r.wall for r in warm):.2f} s, {warm[-1].peak_mb:.0f} MB")
        usage = [timed([*gonio(), "--help"], folder) for _ in range(5)]
        print(f"gonio --help:              {statistics.median(r.wall for r in usage):.2f} s")


if __name__ == "__main__":
    main()
