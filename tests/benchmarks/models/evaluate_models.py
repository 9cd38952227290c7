"""Million evaluations a second of every model on the pairs of MERL, beside XLA, NumPy, the limit and Mitsuba.

    python evaluate_models.py [../shared/bench/eval_limit.cpp [MODEL ...]]

Ours is the public path: `grid_values` on the grid's axes, as `gonio measure` takes it, and `evaluate` of six NumPy
arrays of components, in double precision and, with JAX's 64 bits off, in single. XLA's is the same formula by `vmap`.
Each is the median CPU time of repeated calls, of all cores together, so that others on the machine disturb it little;
the calls alternate, and the limit runs on one core. Freed memory is kept by the process, as Mitsuba keeps its own. The
first call traces and compiles; kept is that of a process which finds the program on disk. Mitsuba's LLVM variant needs
an LLVM library (Debian: libllvm19, DRJIT_LIBLLVM_PATH).
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
from gonio.data.tabulate import grid_values  # noqa: E402
from gonio.models.catalog import MODELS  # noqa: E402
from gonio.models.compiled import dispatch  # noqa: E402
from gonio.models.evaluation import _values, evaluate  # noqa: E402
from gonio.models.expression.builder import build, example  # noqa: E402
from gonio.models.geometry.directions import Direction  # noqa: E402
from gonio.stability.precision import cast  # noqa: E402

PRECISIONS = (np.float32, np.float64)
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


def pairs(dtype, count=None):
    wi, wo = layouts.merl().directions()
    every = slice(None) if count is None else slice(None, None, layouts.merl().size // count)
    return [Direction(*(np.ascontiguousarray(np.asarray(c, dtype)[every][:count]) for c in w)) for w in (wi, wo)]


def precision(dtype):
    """JAX's 64 bits, or not."""
    return jax.enable_x64(dtype == np.float64)


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


def in_precision(dtype, function):
    def call():
        with precision(dtype):
            return jax.block_until_ready(function())

    return call


def xla_call(brdf, dtype, directions):
    arrays = [Direction(*(jnp.asarray(c) for c in w)) for w in directions]
    return in_precision(dtype, lambda: _values(brdf, *arrays))


def numpy_by_hand(wi, wo, alpha=0.2, f0=0.04, rho=0.5):
    """Lambert + height-correlated GGX with Schlick's Fresnel, as one would write it."""
    h = [a + b for a, b in zip(wi, wo, strict=True)]
    norm = np.sqrt(h[0] ** 2 + h[1] ** 2 + h[2] ** 2)
    cos_h, cos_d = h[2] / norm, (wi[0] * h[0] + wi[1] * h[1] + wi[2] * h[2]) / norm
    a2 = alpha**2
    d = a2 / (np.pi * (cos_h**2 * (a2 - 1) + 1) ** 2)
    l_i, l_o = (np.sqrt(a2 + (1 - a2) * w[2] ** 2) for w in (wi, wo))
    f = rho / np.pi + d * (f0 + (1 - f0) * (1 - cos_d) ** 5) / (2 * (wi[2] * l_o + wo[2] * l_i))
    return np.where((wi[2] > 0) & (wo[2] > 0), f, 0)


def first_and_kept(brdf, one):
    """CPU seconds of one pair in a process that has nothing, and in one that finds the program on disk."""
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GONIO_PROGRAMS_DIR"] = folder
        for _ in range(2):
            dispatch._programs.clear()
            dispatch._models.clear()
            began = time.process_time()
            evaluate(brdf, *one)
            seconds.append(time.process_time() - began)
        del os.environ["GONIO_PROGRAMS_DIR"]
    return seconds


def difference(ours, theirs):
    """Largest of |ours - theirs| over |theirs|, of values above a millionth of the largest."""
    ours, theirs = np.asarray(ours, float), np.asarray(theirs, float)
    counted = np.abs(theirs) > 1e-6 * np.nanmax(np.abs(theirs))
    return float(np.max(np.abs(ours - theirs)[counted] / np.abs(theirs)[counted], initial=0.0))


def microseconds(brdf, dtype, directions, calls=300):
    with precision(dtype):
        evaluate(brdf, *directions)
        began = time.process_time()
        for _ in range(calls):
            evaluate(brdf, *directions)
        return (time.process_time() - began) / calls * 1e6


def model_line(expression, known):
    count, one = layouts.merl().size, pairs(np.float64, 1)
    first, kept = first_and_kept(build(expression), one)
    rates, latencies, differences, least = {}, [], [], []
    for dtype in PRECISIONS:
        brdf, flat, some, single = cast(build(expression), dtype), pairs(dtype), pairs(dtype, 10_000), pairs(dtype, 1)
        by_xla = xla_call(brdf, dtype, flat)
        calls = [
            in_precision(dtype, lambda b=brdf: grid_values(b, layouts.merl())),
            in_precision(dtype, lambda b=brdf, w=flat: evaluate(b, *w)),
            by_xla,
        ]
        if expression == LIMIT:
            calls.append(lambda w=flat: numpy_by_hand(*w))
        done = median_seconds(*calls)
        for name, (_, median, _) in zip(("grid", "pairs", "XLA", "NumPy"), done, strict=False):
            rates.setdefault(name, []).append(count / median / 1e6)
        least.append(min(done[0][2], done[1][2]))
        differences.append(difference(calls[1](), by_xla()))
        for directions in (single, some):
            latencies.append(microseconds(brdf, dtype, directions))
    text = "  ".join(f"{name} {' / '.join(f'{r:6.1f}' for r in values)}" for name, values in rates.items())
    times = f"one pair {latencies[0]:.0f} / {latencies[2]:.0f}, 10⁴ {latencies[1]:.0f} / {latencies[3]:.0f} µs"
    differs = f"differs by {differences[0]:.0e} / {differences[1]:.0e}"
    print(f"{expression[:48]:48}  {text}  {times}  {differs}  first {first:.2f} s, kept {kept:.2f} s", flush=True)
    if expression == LIMIT and known:
        ratio = [s * 1e3 / known[np.dtype(d).name] for s, d in zip(least, PRECISIONS, strict=True)]
        print(
            f"  limit: {known['float32']:.2f} / {known['float64']:.2f} ms, ours {ratio[0]:.1f} / {ratio[1]:.1f} times"
        )


def beside_mitsuba():
    library = os.environ.get("DRJIT_LIBLLVM_PATH") or next(iter(sorted(glob.glob("/usr/lib/*/libLLVM.so.19*"))), None)
    if not library:
        print("\nnot beside Mitsuba: its LLVM variant needs libLLVM (19 will do, 15 will not): DRJIT_LIBLLVM_PATH")
        return
    os.environ["DRJIT_LIBLLVM_PATH"] = library
    try:
        import mitsuba as mi
    except ImportError:
        print("\nnot beside Mitsuba: pip install mitsuba")
        return

    mi.set_variant("llvm_ad_rgb")
    count, flat = layouts.merl().size, pairs(np.float32)
    print("\nbeside Mitsuba's LLVM variant, float32, pairs: million evaluations a core second, ours / theirs")
    for expression, scene in PEERS.items():
        brdf = cast(build(expression), np.float32)
        ours = in_precision(np.float32, lambda b=brdf: evaluate(b, *flat))
        mine, theirs = median_seconds(ours, mitsuba_call(scene, *flat))
        rates = [count / s[1] / 1e6 for s in (mine, theirs)]
        print(
            f"{expression[:72]:72}  {rates[0]:7.1f} / {rates[1]:7.1f}  ratio {rates[0] / rates[1]:.2f}"
            f"  first call {mine[0]:.2f} / {theirs[0]:.2f} s", flush=True,
        )  # fmt: skip


def main() -> None:
    keep_memory()
    known = limit(sys.argv[1] if len(sys.argv) > 1 else None)
    print(f"{layouts.merl().size:,} pairs; million evaluations a core second, float32 / float64")
    for expression in [LIMIT, *(example(n).strip("'") for n in sys.argv[2:] or MODELS)]:
        model_line(expression, known)
    beside_mitsuba()


if __name__ == "__main__":
    main()
