"""Certificates of measured materials, in a table: RGL's isotropic files and NIST's sintered PTFE.

python real_certificates.py FOLDER
"""

import pathlib
import sys
import time

import jax

jax.config.update("jax_enable_x64", True)

from gonio import check  # noqa: E402

NAMES = ("reciprocity", "energy", "positivity", "symmetry")


def cell(p):
    if p.residual is None:
        return p.verdict
    return f"{p.verdict} {p.residual:.3g} ± {p.bound:.2g}"


def main(folder: str) -> None:
    files = [*sorted(pathlib.Path(folder, "rgl").glob("*.bsdf")), pathlib.Path(folder, "nist_ptfe", "PTFE.data.csv")]
    print(f"{'material':24}{'overall':>10}" + "".join(f"{n:>28}" for n in NAMES) + f"{'CPU s':>7}")
    for path in files:
        start = time.process_time()
        c = check(str(path))
        cells = "".join(f"{cell(c[n]):>28}" for n in NAMES)
        print(
            f"{path.stem.removesuffix('_rgb'):24}{c.overall:>10}{cells}{time.process_time() - start:7.1f}", flush=True
        )
        if "p_value" in c["reciprocity"].facts:
            print(f"{'':24}{c['reciprocity'].detail}")


if __name__ == "__main__":
    main(sys.argv[1])
