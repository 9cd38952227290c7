"""NIST's sintered PTFE at 633 nm: reciprocity, and how near the diffuse models come.

python ptfe.py FILE
"""

import sys

import jax

import gonio
from gonio.data.formats.nist_ptfe import read_nist

MODELS = (
    "lambert",
    "fujii",
    "eon",
    "lambert + ggx",
    "eon + ggx",
    "eon + ggx(f0=0.04)",
    "eon + beckmann(eta=?)",
    "eon + ggx(f0=0.04) + ggx(f0=0.04)",
)


def main(path: str) -> None:
    jax.config.update("jax_enable_x64", True)
    table = read_nist(path, wavelength_nm=633)
    print("geometries", table.layout.size, "counts", table.counts())
    certificate = gonio.check(table)
    for name in ("reciprocity", "energy"):
        p = certificate[name]
        print(f"{name}: {p.verdict}, residual {p.residual}, bound {p.bound}, tolerance {p.tolerance}; {p.detail}")
    print(f"{'model':40} {'relative rms':>12} {'median |Δ|/f':>12} {'BIC above best':>15}")
    results = [gonio.fit(table, m, loss="linear") for m in MODELS]
    best = min(r.bic for r in results)
    for r in sorted(results, key=lambda r: r.bic):
        relative, status = r.metrics["relative_rms"], "" if r.converged else r.reason
        print(f"{r.requested:40} {relative:12.4f} {r.metrics['median_relative']:12.4f} {r.bic - best:15.0f}  {status}")
        print("   ", r.expression)


if __name__ == "__main__":
    main(sys.argv[1])
