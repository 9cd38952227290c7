"""Quantities of standards: against closed forms, the coverage of their intervals, and what ten readings cannot say.

    python tests/benchmarks/metrology/standard_quantities.py [DRAWS] [SEED]

Coverage: of DRAWS simulated measurements, the share whose value ± 2u holds the truth. Of a grid u is of the stored
noise and of the bound of the integral (rectangular); `noise alone` is the share of values ± 2u of the noise that hold
what the same readings without noise give. Of a fit u is by its covariance. k = 2 of a normal distribution holds
95.45 %; of 500 draws 93.6 to 97.3 %, with 95 % confidence. Where the bound makes most of u the interval is safe and
holds more: `bound` is its share of u².
"""

import dataclasses
import math
import resource
import sys
import warnings

import jax
import jax.numpy as jnp
import numpy as np

import gonio
from gonio.data.channels import Channels
from gonio.data.layouts import in_plane
from gonio.instrument.scans import scan
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.measurands import TableMeasurands
from gonio.metrology.standards.catalog import Wanted, standard_quantities
from gonio.metrology.standards.colour import OBSERVERS
from gonio.metrology.standards.gloss import GLASS, gloss
from gonio.metrology.standards.of_models import of_model
from gonio.metrology.standards.reflectance import stated
from gonio.metrology.standards.standard import Hemisphere, StandardQuantity
from gonio.models.surface_scatter.rayleigh_rice import total_integrated_scatter

jax.config.update("jax_enable_x64", True)

NM = np.arange(400.0, 701.0, 20.0)
GREEN = 8
"""Number of the channel that is looked at: 560 nm."""
RHO = 0.2 + 0.4 / (1 + np.exp(-(NM - 580) / 25))
TRUTH = f"lambert(rho=[{', '.join(f'{r:.6f}' for r in RHO)}]) + 0.3 * ggx(alpha=0.3)"
MODEL = "lambert + shared * ggx"
INSTRUMENT = gonio.Instrument(photons=1e5, noise=1e-3)
GROUPS = ("reflectance", "gloss", "colour", "multi-angle")
SHOWN = {
    ("8°:di", ""): "R(8°;2π)", ("albedo", "θi 45°"): "R(45°;2π)", ("reflectance factor", "45:0"): "45:0, single",
    ("45°x:0°", ""): "45°x:0°", ("45°a:0°", ""): "45°a:0°", ("gloss 60°", ""): "gloss 60°",
    ("L*", "45°a:0° D65/10°"): "L*, 45°a:0°", ("45°:as25°", ""): "45°:as25°",
}  # fmt: skip
FITTED_READINGS = 300
ORDER_OF_READINGS = 17


def main(draws: int = 500, seed: int = 0) -> None:
    closed_forms()
    coverage("a grid of 5° × 5° × 10°, 16 wavelengths", *of_grids(draws, seed), draws)
    coverage(f"fits of {FITTED_READINGS} scattered readings, '{MODEL}'", *of_fits(draws, seed), draws)
    ten_readings()


def closed_forms() -> None:
    """Value, closed form and their difference."""
    rows = []
    lambert = named(gonio.quantities("lambert(rho=0.4)", only=["reflectance", "multi-angle", "remote sensing"]))
    rows += [(f"Lambert, {n} {p}".strip(), q.value, 0.4) for (n, p), q in lambert.items() if q.group != "albedo"]
    mu = math.cos(math.radians(8))
    ggx = named(gonio.quantities("ggx(alpha=1)", only=["reflectance"]))
    rows.append(("GGX α = 1, R(8°;2π)", ggx["8°:di", ""].value, 1 - mu * math.log((1 + mu) / mu)))
    smooth = f"rayleigh_rice(wavelength=0.55, eta={GLASS}, sigma=0.0001, tau=20, spectrum=gaussian)"
    for name, model in (("smooth", smooth), ("α 5e-4", f"beckmann(alpha=0.0005, eta={GLASS})")):
        material = gonio.material(model)
        rows += [(f"black glass, {name}, {q.name}", q.value, 100.0) for q in of_model(material, gloss())[0]]
    # 50 Å at .5 µm, of a wide spectrum of heights, whose scatter stays near the mirror direction.
    rows.append(("TIS of 50 Å at 0.5 µm", float(total_integrated_scatter(0.005, 0.5, 1.0)), 0.015791))
    wide = gonio.material("rayleigh_rice(wavelength=0.5, eta=1.37, k=7.62, sigma=0.0005, tau=3, spectrum=gaussian)")
    tis = named(gonio.quantities(wide, only=["scatter"]))["total integrated scatter", ""].value
    beyond = math.exp(-((math.pi * 3 * math.sin(math.radians(2.5)) / 0.5) ** 2))
    rows.append(("TIS beyond 2.5° of 5 Å, Rayleigh-Rice", tis, (4 * math.pi * 0.0005 / 0.5) ** 2 * beyond))
    rows += colours()
    print(f"{'closed forms':44}{'value':>14}{'expected':>14}{'difference':>12}")
    for name, value, expected in rows:
        print(f"{name:44}{value:14.7g}{expected:14.7g}{value - expected:12.1e}")


def colours() -> list[tuple[str, float, float]]:
    """Of a Lambertian with a spectrum of 5 nm against colour-science's own integration."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour

        nm = np.arange(360.0, 781.0, 5.0)
        rho = 0.2 + 0.4 / (1 + np.exp(-(nm - 580) / 25))
        material = gonio.material(f"lambert(rho=[{', '.join(f'{r:.9f}' for r in rho)}])")
        material = dataclasses.replace(material, channels=Channels.of_wavelengths(nm))
        spectrum, rows = colour.SpectralDistribution(dict(zip(nm, rho, strict=True))), []
        for observer, name in OBSERVERS.items():
            ours = named(gonio.quantities(material, only=["colour"], observer=observer))
            for light in ("D65", "A"):
                functions, source = colour.MSDS_CMFS[name], colour.SDS_ILLUMINANTS[light]
                xyz, white = (
                    colour.sd_to_XYZ(s, functions, source, method="Integration") for s in (spectrum, colour.sd_ones())
                )
                lab = colour.XYZ_to_Lab(xyz / 100, colour.XYZ_to_xy(white))
                for n, expected in zip(("X", "Y", "Z", "L*", "a*", "b*"), (*xyz, *lab), strict=True):
                    place = f"45°a:0° {light}/{observer}°"
                    rows.append((f"{n} {light}/{observer}°, colour-science", ours[n, place].value, float(expected)))
    return rows


def named(result: object) -> dict:
    """Quantities by name and place, of one channel."""
    return {(q.name, q.place): q for q in result.quantities}


def surface() -> object:
    """The material that is measured."""
    return dataclasses.replace(gonio.material(TRUTH), channels=Channels.of_wavelengths(NM))


def truths() -> dict:
    """The true values, by name and place."""
    made = gonio.quantities(surface(), only=GROUPS)
    return {(q.name, q.place): q.value for q in made.quantities if q.channel in ("", surface().channels.names[GREEN])}


@jax.jit
def noisy(key: jax.Array, f: jax.Array, u_f: jax.Array) -> jax.Array:
    """Readings with noise of a standard deviation."""
    return f + u_f * jax.random.normal(key, f.shape)


def of_grids(draws: int, seed: int) -> tuple[dict, float]:
    """(value − truth, u, u of noise, value − that without noise) of each draw, and the processor time."""
    layout = scan("isotropic", step=math.radians(5), phi_step=math.radians(10))
    exact = gonio.measure(surface(), None, layout)
    u_f = np.nan_to_num(np.asarray(gonio.measure(surface(), INSTRUMENT, layout, seed=seed).u_f[...], float))
    f, true, rows = np.asarray(exact.f[...], float), truths(), {}
    began = processor()
    entries = standard_quantities(exact.channels, Wanted(GROUPS), False)[0]
    measurands = TableMeasurands.of(dataclasses.replace(exact, u_f=u_f), (), entries)
    without = measurands.base.values
    channel = exact.channels.names[GREEN]
    for k in range(draws):
        readings = noisy(jax.random.key(seed * 1_000_000 + k), jnp.asarray(f), jnp.asarray(u_f))
        table = dataclasses.replace(exact, f=np.asarray(readings), u_f=u_f)
        values, bounds, noise = measurands.read_out(table)
        for q, value, bound, u, clean in zip(measurands.quantities, values, bounds, noise, without, strict=True):
            key = (q.name, q.place)
            if key in SHOWN and q.channel in ("", channel):
                row = (value - true[key], math.hypot(u, bound / math.sqrt(3)), u, value - clean, true[key])
                rows.setdefault(key, []).append(row)
    return rows, processor() - began


def of_fits(draws: int, seed: int) -> tuple[dict, float]:
    """The same of fits, whose noise is all of their uncertainty."""
    rng, material, true, rows = np.random.default_rng(ORDER_OF_READINGS), surface(), truths(), {}
    theta_i, theta_o = np.arcsin(np.sqrt(rng.uniform(0, 0.95, (2, FITTED_READINGS))))
    near, anywhere = rng.normal(np.pi, 0.2, FITTED_READINGS), rng.uniform(0, 2 * np.pi, FITTED_READINGS)
    phi_o = np.where(rng.random(FITTED_READINGS) < 0.5, near, anywhere)
    f = material.f(theta_i, 0.0, theta_o, phi_o)
    u_f = 0.01 * f
    every = standard_quantities(material.channels, Wanted(GROUPS), False)[0]
    entries = [e for e in every if (e.name, e.place) in SHOWN] + [stated("45:0", 45.0, 0.0, 0.0)]
    entries.append(StandardQuantity("albedo", "", "", "", (Hemisphere(math.pi / 4),), place="θi 45°"))
    channel, began = material.channels.names[GREEN], processor()
    for k in range(draws):
        readings = np.asarray(noisy(jax.random.key(seed * 1_000_000 + k), jnp.asarray(f), jnp.asarray(u_f)))
        table = gonio.Table.from_arrays(theta_i, 0.0, theta_o, phi_o, readings, u_f=u_f, wavelengths_nm=NM)
        fitted = gonio.fit(table, MODEL, starts=1)
        for q in of_model(fitted.material, entries, FitNumbers.of(fitted.material))[0]:
            if q.channel in ("", channel):
                off, expected = q.value - true[q.name, q.place], true[q.name, q.place]
                rows.setdefault((q.name, q.place), []).append((off, q.uncertainty, q.u, off, expected))
    return rows, processor() - began


def coverage(what: str, rows: dict, seconds: float, draws: int) -> None:
    """One table: shares of the draws whose interval holds the truth."""
    print(f"\n{what}: {draws} draws, {seconds:.0f} s of processor time")
    titles = ("truth", "U, %", "± 2u", "noise alone", "sd of z", "mean z", "bound")
    print(f"{'quantity':16}" + "".join(f"{t:>13}" for t in titles))
    for key, label in SHOWN.items():
        off, u, noise, off_clean, true = np.array(rows[key]).T
        holds, alone = (100 * np.mean(np.abs(a) <= 2 * s) for a, s in ((off, u), (off_clean, noise)))
        z, share = off_clean / noise, 1 - np.mean(noise**2) / np.mean(u**2)
        cells = (f"{true[0]:.5g}", f"{200 * np.mean(u) / true[0]:.3g}", f"{holds:.1f} %", f"{alone:.1f} %")
        cells += (f"{z.std():.3f}", f"{z.mean():.3f}", f"{100 * share:.1f} %")
        print(f"{label:16}" + "".join(f"{c:>13}" for c in cells), flush=True)


def ten_readings() -> None:
    """Ten readings in the plane of incidence: what they decide, and why not the rest."""
    angles = np.radians([-60, -45, -30, -15, 0, 15, 30, 45, 60, 75])
    table = gonio.measure("lambert(rho=0.2) + ggx(alpha=0.2, eta=1.5)", None, in_plane([math.radians(45)], angles))
    made = gonio.quantities(table)
    print(f"\nten readings in the plane: decided {sorted({f'{q.name} {q.place}'.strip() for q in made.quantities})}")
    reasons: dict[str, list[str]] = {}
    for u in made.undecided:
        reasons.setdefault(u.reason, []).append(f"{u.name} {u.place}".strip())
    for reason, names in reasons.items():
        print(f"  undecided, {reason}: {', '.join(names)}")
    for note in made.notes:
        print(f"  note: {note}")


def processor() -> float:
    """Seconds of processor time so far."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
