"""Whether the 95 % intervals of fits cover the truth, and whether what readings leave open is named.

    python tests/benchmarks/fits/fit_coverage.py [DRAWS [MATERIAL...|open]]

Five materials (or those named) are measured DRAWS times each (1,000 by default) by an instrument with shot, dark,
read-out and source noise, and fitted. For each number that a fit calls determined: the share of intervals that hold the
truth, with the range in which 99 % of such shares lie if intervals are right. Then (or with `open` alone) cases built
to leave numbers open, a fifth of DRAWS each.
"""

import dataclasses
import sys
import time

import jax
import numpy as np

import gonio
from gonio.data import layout as layouts
from gonio.data.table import whole_table_of_values
from gonio.fitting.problem.parameterisation import label, structure_of, with_defaults
from gonio.instrument.instrument import Instrument
from gonio.models.expression.parser import parse
from gonio.models.expression.paths import numbers

INSTRUMENT = Instrument(photons=2e4, dark=5.0, read_noise=3.0, noise=0.01)
ISOTROPIC = layouts.isotropic(*(np.radians(np.arange(a, b, s)) for a, b, s in ((0, 81, 10), (0, 81, 10), (0, 360, 30))))
TURNED = layouts.spherical(
    *(np.radians(np.arange(a, b, s)) for a, b, s in ((10, 71, 20), (0, 360, 30), (10, 71, 10), (0, 360, 30)))
)
MATERIALS = {
    "matte": ("eon(rho=0.6, r=0.5)", "eon", ISOTROPIC),
    "plastic": ("lambert(rho=[.1,.2,.4]) + [.5,.5,.5]*ggx(alpha=.2, f0=.04)", "lambert + ggx(f0=0.04)", ISOTROPIC),
    "metal": ("[.9,.6,.3]*ggx(alpha=.15)", "ggx", ISOTROPIC),
    "varnish": ("lambert(rho=.3) + 0.8*beckmann(alpha=.3, f0=.1)", "lambert + beckmann(f0=?)", ISOTROPIC),
    "brushed": ("lambert(rho=.1) + 0.7*ggx(alpha_x=.12, alpha_y=.35)", "lambert + ggx(alpha_x=?, alpha_y=?)", TURNED),
}
SMALL = layouts.isotropic(*(np.radians(np.arange(a, b, s)) for a, b, s in ((0, 36, 5), (0, 36, 5), (0, 360, 30))))
NORMAL = layouts.isotropic(*(np.radians(np.arange(a, b, s)) for a, b, s in ((0, 21, 5), (0, 21, 5), (0, 360, 15))))
PLANE = layouts.in_plane(np.radians(np.arange(0, 61, 15)), np.radians(np.arange(-80, 81, 5)))
OPEN = {
    "F₀ and scale, ≤ 35°": (
        "lambert(rho=.2) + 0.6*ggx(alpha=.3, f0=.1)", "lambert + ggx(f0=?)", SMALL, {"ggx.f0", "ggx.scale"}
    ),
    "η and k, ≤ 20°": ("1*ggx(alpha=.3, eta=1.2, k=3)", "1 * ggx(eta=?, k=?)", NORMAL, {"ggx.eta"}),
    "twin lobes": (
        "lambert(rho=.1) + .3*ggx(alpha=.2) + .3*ggx(alpha=.2)", "lambert + ggx(alpha=.2) + ggx(alpha=.2)", ISOTROPIC,
        {"ggx1.scale", "ggx2.scale"},
    ),
    "width of nothing": ("lambert(rho=.5)", "lambert + 0 * ggx(alpha=?)", ISOTROPIC, {"ggx.alpha"}),
    "two diffusers": (
        "lambert(rho=.2) + lambert(rho=.3)", "lambert + lambert", ISOTROPIC, {"lambert1.rho", "lambert2.rho"}
    ),
    "width across the plane": (
        "0.6*ggx(alpha_x=.2, alpha_y=.3)", "ggx(alpha_x=?, alpha_y=?)", PLANE, {"ggx.alpha_y", "ggx.scale"}
    ),
}  # fmt: skip


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    z = 2.576 * np.sqrt(0.95 * 0.05 / draws)
    print(f"{draws} measurements of each material; 99 % of right shares lie in {0.95 - z:.3f}–{0.95 + z:.3f}")
    print(f"{'':10} {'number':18} {'determined':>10} {'covered':>8} {'bootstrap':>9} {'rms z':>6} {'mean z':>7}")
    shares = []
    names = [n for n in sys.argv[2:] if n != "open"] if len(sys.argv) > 2 else list(MATERIALS)
    for name in names:
        truth, asked, layout = MATERIALS[name]
        began = time.perf_counter()
        shares += coverage(name, truth, asked, layout, draws)
        print(f"{'':10} {draws} measurements and fits in {time.perf_counter() - began:.0f} s")
    if shares:
        print(f"worst and best share: {min(shares):.3f} and {max(shares):.3f}", flush=True)
    if len(sys.argv) > 2 and "open" not in sys.argv:
        return
    print(f"\n{'left open':24} {'named':>6} {'of':>5} {'not converged':>13}   said the last time")
    for name, (truth, asked, layout, left) in OPEN.items():
        named, stuck, said = 0, 0, ""
        for draw in range(draws // 5):
            result = gonio.fit(measured(truth, layout, draw), asked, starts=2)
            held = {p.name for p in result.parameters if p.status == "undetermined"}
            named += left <= held and any(n in words for words in result.undetermined for n in left)
            stuck += not result.converged
            said = result.undetermined[0] if result.undetermined else ""
        print(f"{name:24} {named:6} {draws // 5:5} {stuck:13}   {said}")


def coverage(name: str, truth: str, asked: str, layout, draws: int) -> list[float]:
    actual = truths(truth, layout)
    covered, again, z, determined = ({n: [] for n in actual} for _ in range(4))
    for draw in range(draws):
        table = measured(truth, layout, draw)
        # A bootstrap is fifty fits: every tenth measurement has one.
        result = gonio.fit(table, asked, starts=2, bootstrap=100 if draw % 10 == 0 else 0)
        assert result.converged, result.reason
        refits = {n["name"]: n for n in (result.bootstrap or {"numbers": []})["numbers"]}
        for p in (p for p in result.parameters if p.status != "fixed"):
            determined[p.label].append(p.status == "determined")
            if p.status != "determined":
                continue
            t = actual[p.label]
            covered[p.label].append(p.interval95[0] <= t <= p.interval95[1])
            z[p.label].append((p.value - t) / p.standard_uncertainty)
            if p.label in refits:
                low, high = refits[p.label]["interval95"]
                again[p.label].append(low <= t <= high)
    for n in (n for n in actual if determined[n]):
        e = np.array(z[n])
        print(
            f"{name:10} {n:18} {np.mean(determined[n]):10.3f} {np.mean(covered[n]):8.3f} {np.mean(again[n]):9.2f} "
            f"{np.sqrt(np.mean(e**2)):6.3f} {e.mean():+7.3f}"
        )
    return [float(np.mean(c)) for n, c in covered.items() if c]


_EXACT: dict = {}


def measured(truth: str, layout, draw: int):
    """What the instrument reads; the expected readings are worked out once for each material."""
    from gonio.instrument import noise

    if (truth, id(layout)) not in _EXACT:
        _EXACT[truth, id(layout)] = gonio.measure(truth, None, layout, say=lambda line: None)
    exact = _EXACT[truth, id(layout)]
    wi, _ = layout.directions()
    expected = np.nan_to_num(np.asarray(exact.f, float).reshape(layout.size, -1))
    lit = np.maximum(np.asarray(wi.z), 1e-9)
    f, _ = noise.read(INSTRUMENT, 1000 + draw, 0, expected, lit)
    u = noise.standard_uncertainty(INSTRUMENT, expected, lit)
    made = whole_table_of_values(layout, f, u_f=u.reshape(*layout.shape, -1), name=truth)
    return dataclasses.replace(made, flag=exact.flag)


def truths(truth: str, layout) -> dict[str, float]:
    """True numbers by the labels that a fit gives them."""
    terms = with_defaults(parse(truth))
    s, _, _ = structure_of(terms, 3)
    found = {}
    for index, t in enumerate(terms):
        for n in numbers(t):
            values = np.ravel(n.value.number)
            name = label(s, index, n.path)
            found |= {name: float(values[0])} if values.size == 1 else {
                f"{name}[{c}]": float(v) for c, v in zip("RGB", values, strict=True)
            }  # fmt: skip
    return found


if __name__ == "__main__":
    main()
