"""Evaluations a second of every model on the 1,458,000 pairs of MERL, beside the limit of the machine and Mitsuba.

    python evaluate_models.py [../shared/bench/eval_limit.cpp [MODEL ...]]

Two forms of ours: on the grid (the trigonometry of each axis as input, as `gonio measure` does it) and on pairs (six
arrays of components, as any client would hand over, and as Mitsuba gets them). Each is the median CPU time of repeated
calls, of all cores together, so that others on the machine disturb it little; ours and Mitsuba's calls alternate, and
the limit runs on one core; beside it stands our least time too, since the loops tell theirs. Freed memory is kept by
the process, as Mitsuba keeps its own: pages that are new at every call cost up to 9 ms. Mitsuba's LLVM variant needs an
LLVM library (Debian: libllvm19, DRJIT_LIBLLVM_PATH).
"""

import ctypes
import glob
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from gonio.data import layouts  # noqa: E402
from gonio.data.tabulate import _kernel  # noqa: E402
from gonio.models.catalog import MODELS  # noqa: E402
from gonio.models.evaluation import _values  # noqa: E402
from gonio.models.expression.builder import build, example  # noqa: E402
from gonio.models.geometry.directions import Direction  # noqa: E402
from gonio.stability.precision import cast  # noqa: E402

LIMIT = "lambert(rho=0.5) + 1 * ggx(alpha=0.2, f0=0.04)"
REPEATS = 9
REST = 0.01
"""Seconds before a call that is timed: threads that wait for more work, Mitsuba's, burn time that is not the call's."""
GOLD = {"eta": [0.18299, 0.42108, 1.3734], "k": [3.4242, 2.3459, 1.77045]}
PEERS = {
    "lambert(rho=[0.8, 0.5, 0.1])": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.5, 0.1]}},
    **{
        f"{d}(alpha=0.2, eta={GOLD['eta']}, k={GOLD['k']}, smith={s})": {
            "type": "roughconductor", "distribution": d, "alpha": 0.2,
            **{n: {"type": "rgb", "value": v} for n, v in GOLD.items()},
        }
        for d, s in (("ggx", "separable"), ("beckmann", "walter"))
    },
    "ggx(alpha=0.2, eta=1.5, smith=separable)": {
        "type": "roughdielectric", "distribution": "ggx", "alpha": 0.2, "int_ior": 1.5
    },
    "coat(base=lambert(rho=[0.6, 0.3, 0.1]), alpha=0.01, eta=1.5)": {
        "type": "roughplastic", "distribution": "ggx", "alpha": 0.01, "int_ior": 1.5, "nonlinear": False,
        "diffuse_reflectance": {"type": "rgb", "value": [0.6, 0.3, 0.1]},
    },
    "principled(base_color=[0.8, 0.4, 0.1], roughness=0.5, variant=mitsuba)": {
        "type": "principled", "base_color": {"type": "rgb", "value": [0.8, 0.4, 0.1]}, "roughness": 0.5
    },
}  # fmt: skip


def keep_memory() -> None:
    """glibc's allocator gives nothing back: blocks to 32 MiB from the heap (M_MMAP_THRESHOLD), no M_TRIM_THRESHOLD."""
    for option, size in ((-3, 32 << 20), (-1, 1 << 30)):
        ctypes.CDLL(None).mallopt(option, size)


def median_seconds(*calls):
    """For each call, which alternate: (seconds of the first time, median CPU seconds of the others, the least)."""
    firsts, times = [], [[] for _ in calls]
    for call in calls:
        began = time.process_time()
        call()
        firsts.append(time.process_time() - began)
    for _ in range(REPEATS):
        for call, seen in zip(calls, times, strict=True):
            time.sleep(REST)
            call()  # the other's call emptied the caches
            time.sleep(REST)
            began = time.process_time()
            call()
            seen.append(time.process_time() - began)
        if sum(map(sum, times)) > 8:
            break
    return [(first, statistics.median(seen), min(seen)) for first, seen in zip(firsts, times, strict=True)]


def trigonometry(dtype):
    axes = layouts.merl().axes.values()
    return [(jnp.asarray(np.cos(a), dtype), jnp.asarray(np.sin(a), dtype)) for a in axes]


def pairs(dtype):
    wi, wo = layouts.merl().directions()
    return [Direction(*(jnp.asarray(c, dtype) for c in w)) for w in (wi, wo)]


def limit(source):
    """Least milliseconds of the C++ loops by precision; nothing where there is no compiler or source."""
    if not (source and os.path.exists(source) and shutil.which("g++")):
        return {}
    with tempfile.TemporaryDirectory() as folder:
        program = os.path.join(folder, "limit")
        one_core = os.environ | {"OMP_NUM_THREADS": "1"}
        subprocess.run(["g++", "-O3", "-march=native", "-ffast-math", "-fopenmp", source, "-o", program], check=True)
        said = subprocess.run([program], check=True, capture_output=True, text=True, env=one_core).stdout
    return {line.split()[0]: float(line.split("minimum ")[1].split()[0]) for line in said.splitlines()}


def mitsuba_call(scene, wi, wo):
    import drjit as dr
    import mitsuba as mi

    bsdf = mi.load_dict(scene)
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(*(mi.Float(np.asarray(c, np.float32)) for c in wi))
    out = mi.Vector3f(*(mi.Float(np.asarray(c, np.float32)) for c in wo))
    dr.eval(si.wi, out)
    dr.sync_thread()

    def call():
        value = bsdf.eval(mi.BSDFContext(), si, out)
        dr.eval(value)
        dr.sync_thread()

    return call


def our_call(expression, dtype, inputs, on_grid):
    brdf = cast(build(expression), dtype)
    if on_grid:
        return lambda: jax.block_until_ready(_kernel(brdf, layouts.merl().pair, inputs))
    return lambda: jax.block_until_ready(_values(brdf, *inputs))


def main() -> None:
    keep_memory()
    count = layouts.merl().size
    known = limit(sys.argv[1] if len(sys.argv) > 1 else None)
    grids = {d: trigonometry(d) for d in (jnp.float32, jnp.float64)}
    flat = {d: pairs(d) for d in (jnp.float32, jnp.float64)}
    print(f"{count:,} pairs; million evaluations a core second, float32 / float64; first call (tracing, compiling), s")
    for spelled in [LIMIT, *(example(n).strip("'") for n in sys.argv[2:] or MODELS)]:
        said, first, best = [], [], []
        for inputs, on_grid in ((grids, True), (flat, False)):
            done = median_seconds(*(our_call(spelled, d, inputs[d], on_grid) for d in (jnp.float32, jnp.float64)))
            said.append(" / ".join(f"{count / s[1] / 1e6:7.1f}" for s in done))
            best = done if on_grid else best
            first.append(done[1][0])
        note = ""
        if spelled == LIMIT and known:
            rate = {d: count / (ms * 1e-3) / 1e6 for d, ms in known.items()}
            ours = dict(zip(("float32", "float64"), (count / s[2] / 1e6 for s in best), strict=True))
            ratio = {d: rate[d] / ours[d] for d in rate}
            note = f"   limit (C++): {rate['float32']:.0f} / {rate['float64']:.0f}, least against least "
            note += f"{ratio['float32']:.1f} / {ratio['float64']:.1f} times"
        print(f"{spelled[:72]:72}  grid {said[0]}  pairs {said[1]}  first {first[0]:.1f}{note}", flush=True)
    library = os.environ.get("DRJIT_LIBLLVM_PATH") or next(iter(sorted(glob.glob("/usr/lib/*/libLLVM.so.19*"))), None)
    if library:
        os.environ["DRJIT_LIBLLVM_PATH"] = library
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        print("\nbeside Mitsuba's LLVM variant, float32, pairs: million evaluations a core second, ours / theirs")
        for spelled, scene in PEERS.items():
            singles = flat[jnp.float32]
            mine, theirs = median_seconds(our_call(spelled, jnp.float32, singles, False), mitsuba_call(scene, *singles))
            rates = [count / s[1] / 1e6 for s in (mine, theirs)]
            print(
                f"{spelled[:72]:72}  {rates[0]:7.1f} / {rates[1]:7.1f}  ratio {rates[0] / rates[1]:.2f}"
                f"  first call {mine[0]:.2f} / {theirs[0]:.2f} s", flush=True,
            )  # fmt: skip


if __name__ == "__main__":
    main()
