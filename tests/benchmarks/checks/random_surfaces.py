"""Verdicts on tables of lawful surfaces that are not isotropic, and of instruments that state their errors.

    python random_surfaces.py [TABLES [FIRST [KIND,...]]]     (120 0 turned,sides,instruments,noises)

turned: brushed, ruled, retro-reflecting and narrow surfaces on grids and lists, most of them lit from one azimuth, half
without noise. sides: brushed and leaning surfaces at any angle to the plane of incidence, of which a half or the whole
was read, scaled to a greatest albedo of .7 to 1.1. instruments: isotropic surfaces read by instruments with apertures,
stated misalignment and photon noise, beside the surface itself too (agreement). noises: isotropic surfaces with noise
that no table states, of speckle (5-50 %) or of a detector in the dark, negative readings cut off in half of them.

A verdict is WRONG where it fails what holds or passes what does not; a pass that names an assumption is counted apart.
"""

import collections
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import gonio  # noqa: E402
from gonio.data import layouts  # noqa: E402
from gonio.data.layouts import Layout  # noqa: E402
from gonio.data.table import whole_table_of_values  # noqa: E402
from gonio.models.albedo import directional_albedo  # noqa: E402
from gonio.models.expression.builder import build  # noqa: E402

TOLERANCE = 0.01
LOBES = (
    "{k:.3f} * ggx(alpha_x={a:.5f}, alpha_y={b:.5f}, f0={f:.3f})",
    "{k:.3f} * beckmann(alpha_x={b:.5f}, alpha_y={a:.5f}, f0={f:.3f})",
    "{k:.3f} * grating(period={p:.3f}, depth={d:.3f}, azimuth={t:.1f}, wavelength=0.55, width={w:.4f})",
    "{k:.3f} * retro(alpha={a:.5f}, f0={f:.3f})",
)
Judged = dict[str, tuple[str, bool, str]]
"""By property: the verdict, whether the law holds, and what the verdict assumes."""


def surface(rng: np.random.Generator) -> str:
    a = 10 ** rng.uniform(-2.3, -0.3)
    numbers = {"a": a, "b": min(a * 10 ** rng.uniform(0.2, 1.2), 1.0), "k": rng.uniform(0.1, 0.9)}
    numbers |= {"f": rng.uniform(0.1, 1), "p": rng.uniform(0.8, 4), "d": rng.uniform(0.05, 0.4)}
    numbers |= {"t": rng.uniform(0, 180), "w": 10 ** rng.uniform(-2.7, -1)}
    return f"lambert(rho={rng.uniform(0.05, 0.6):.3f}) + {str(rng.choice(LOBES)).format(**numbers)}"


def uneven(rng: np.random.Generator, most: float, count: int) -> np.ndarray:
    """Polar angles from the normal on, in steps that differ by up to three times."""
    angles = np.concatenate([[0.0], np.cumsum(rng.uniform(1, 3, count))])
    return np.radians(most * angles / angles[-1])


def layout_of(rng: np.random.Generator) -> Layout:
    polar = uneven(rng, rng.uniform(60, 85), int(rng.integers(3, 10))), uneven(rng, 85, int(rng.integers(8, 24)))
    if rng.random() < 0.25:
        lit = np.radians(np.arange(0, 360, rng.choice([30.0, 45.0, 60.0])))
        return layouts.spherical(polar[0], lit, polar[1], np.radians(np.arange(0, 360, 30.0)))
    most = 181 if rng.random() < 0.3 else 360
    return layouts.isotropic(*polar, np.radians(np.arange(0, most, rng.choice([10.0, 15.0, 30.0]))))


def judged(certificate: gonio.Certificate, holds: dict[str, bool]) -> Judged:
    return {name: (certificate[name].verdict, law, certificate[name].assumes) for name, law in holds.items()}


def table_of(layout: Layout, f: np.ndarray, rng: np.random.Generator, listed: bool) -> gonio.Table:
    u = 0.004 * f if rng.random() < 0.4 else None
    f = f if u is None else f + u * rng.standard_normal(f.shape)
    if listed:
        return gonio.Table.from_arrays(*layout.angles(), f, u_f=u)
    stored = {} if u is None else {"u_f": u.reshape(*layout.shape, 1)}
    return whole_table_of_values(layout, f.reshape(layout.shape), **stored)


def turned(rng: np.random.Generator) -> Judged:
    layout, expression = layout_of(rng), surface(rng)
    theta, phi = (np.unique(np.stack(layout.angles())[k]) for k in (0, 1))
    albedo = max(np.max(directional_albedo(build(expression), theta, p, tolerance=1e-6).value) for p in phi)
    f = rng.uniform(0.5, 1) / albedo * gonio.material(expression).f(*layout.angles())[..., 0]
    table = table_of(layout, f, rng, listed=rng.random() < 0.4)
    return judged(gonio.check(table), {"reciprocity": True, "energy": True, "pole": True})


def sides(rng: np.random.Generator) -> Judged:
    wide = {"a": rng.uniform(0.25, 1), "b": rng.uniform(0.1, 0.4), "f": rng.uniform(0.3, 1)}
    lobe = "ggx(alpha_x={a:.3f}, alpha_y={b:.3f}, f0={f:.3f})".format(**wide)
    brdf, turn = gonio.material(f"lambert(rho={rng.uniform(0.05, 0.6):.3f}) + {lobe}"), rng.uniform(0, np.pi)
    lean = rng.choice([0.0, 0.3])

    def f(theta_i: np.ndarray, theta_o: np.ndarray, phi: np.ndarray) -> np.ndarray:
        leaning = 1 + lean * (np.sin(theta_i) * np.cos(turn) + np.sin(theta_o) * np.cos(phi + turn))
        return leaning * brdf.f(theta_i, turn, theta_o, phi + turn)[..., 0]

    theta = np.radians(np.sort(rng.choice(np.arange(0, 81, 5.0), int(rng.integers(2, 8)), replace=False)))
    azimuth = np.linspace(0, 180, 25) if rng.random() < 0.6 else np.arange(0, 360, 10.0)
    layout = layouts.isotropic(theta, np.radians(np.arange(0, 89.9, rng.choice([2.5, 5.0]))), np.radians(azimuth))
    cosine, weight = np.polynomial.legendre.leggauss(200)
    cosine, weight = (cosine + 1) / 2, weight / 2
    mu, phi = np.meshgrid(cosine, np.arange(240) * np.pi / 120, indexing="ij")
    solid = mu * weight[:, None] * np.pi / 120
    greatest = max(np.sum(solid * f(np.full(mu.shape, t), np.arccos(mu), phi)) for t in theta)
    gain = float(rng.choice([0.7, 0.95, 1.0, 1.02, 1.1]))
    theta_i, phi_i, theta_o, phi_o = layout.angles()
    table = table_of(layout, gain / greatest * f(theta_i, theta_o, phi_o - phi_i), rng, listed=rng.random() < 0.4)
    return judged(gonio.check(table), {"reciprocity": True, "energy": gain <= 1 + TOLERANCE})


def instruments(rng: np.random.Generator) -> Judged:
    alpha, f0 = 10 ** rng.uniform(-2.3, -0.4), rng.uniform(0.1, 1)
    lobe = f"{rng.choice(['ggx', 'beckmann'])}(alpha={alpha:.4f}, f0={f0:.2f})"
    expression = f"lambert(rho={rng.uniform(0.05, 0.6):.3f}) + {rng.uniform(0.2, 0.4):.2f} * {lobe}"
    angles = {
        "detector_half_angle": [0, 0.5, 1, 2, 3],
        "source_half_angle": [0, 0.25, 1],
        "misalignment": [0, 0.1, 0.3],
    }
    errors = {name: np.radians(float(rng.choice(sizes))) for name, sizes in angles.items()}
    photons = 10 ** rng.uniform(4, 8) if rng.random() < 0.5 else None
    scan = gonio.scan("isotropic", step=np.radians(rng.choice([5.0, 7.5, 10.0])))
    instrument, seed = gonio.Instrument(**errors, photons=photons), int(rng.integers(1 << 30))
    table = gonio.measure(expression, instrument, scan, seed=seed)
    holds = {"reciprocity": True, "energy": True, "agreement": True}
    return judged(gonio.check(table, against=expression), holds)


def noises(rng: np.random.Generator) -> Judged:
    alpha, f0, name = 10 ** rng.uniform(-1.7, -0.1), rng.uniform(0.05, 1), rng.choice(["ggx", "beckmann"])
    expression = f"lambert(rho={rng.uniform(0.02, 0.4):.3f}) + 0.5 * {name}(alpha={alpha:.4f}, f0={f0:.2f})"
    layout = layout_of(rng)
    if rng.random() < 0.3:
        layout = layouts.merl(counts=(12, 12, 24))
    theta_i, phi_i, theta_o, phi_o = layout.angles()
    above = np.isfinite(theta_i + theta_o) & (np.maximum(theta_i, theta_o) <= np.pi / 2)
    f = gonio.material(expression).f(*(np.where(above, a, 0.0) for a in (theta_i, phi_i, theta_o, phi_o)))[..., 0]
    sigma = rng.uniform(0.05, 0.5) * f
    if rng.random() < 0.5:
        sigma = np.full(f.shape, np.median(f) * 10 ** rng.uniform(-4, -1))
    f = f + sigma * rng.standard_normal(f.shape)
    f = np.maximum(f, 0) if rng.random() < 0.5 else f
    table = whole_table_of_values(layout, f.reshape(layout.shape))
    return judged(gonio.check(table), dict.fromkeys(("reciprocity", "symmetry", "isotropy", "pole"), True))


KINDS = {"turned": turned, "sides": sides, "instruments": instruments, "noises": noises}


def main(tables: int, first: int, kinds: list[str]) -> None:
    counts: collections.Counter[tuple[str, str, str]] = collections.Counter()
    for seed in range(first, first + tables):
        kind = kinds[seed % len(kinds)]
        for name, (verdict, holds, assumes) in KINDS[kind](np.random.default_rng([77, seed])).items():
            right = {"pass": holds, "fail": not holds}.get(verdict)
            outcome = "not decided" if right is None else "right" if right else "assumed" if assumes else "WRONG"
            counts[kind, name, outcome] += 1
            if outcome == "WRONG":
                print(f"WRONG {seed} {kind}: {name} {verdict}", flush=True)
    print(f"{'kind':<14}{'property':<14}{'right':>8}{'WRONG':>8}{'not decided':>14}{'by an assumption':>19}")
    for kind, name in dict.fromkeys((k, n) for k, n, _ in sorted(counts)):
        c = [counts[kind, name, o] for o in ("right", "WRONG", "not decided", "assumed")]
        print(f"{kind:<14}{name:<14}{c[0]:8}{c[1]:8}{c[2]:14}{c[3]:19}")


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:3]]
    named = sys.argv[3].split(",") if len(sys.argv) > 3 else list(KINDS)
    main(*(numbers + [120, 0][len(numbers) :]), named)
