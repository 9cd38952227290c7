"""Coverage of budgets: how often y ± 2u of albedos and fitted numbers holds the truth, over simulated instruments.

    python tests/benchmarks/metrology/budget_coverage.py [DRAWS] [SEED]

Each draw is an instrument of its own: misalignment (five angles), calibration and an offset of the signal are drawn
anew from their stated distributions, then the scan is measured and fitted, and its budget made from what the table
stores. k = 2 of a normal distribution holds 95.45 %; of 500 draws, 93.6 to 97.3 % with 95 % confidence. `k of ν` is the
factor of 95.45 % by the effective degrees of freedom. Where what lies between the readings takes a share, its bound is
safe and more is held.
"""

import math
import sys
import time

import jax
import numpy as np

import gonio
from gonio.data.stated import stated_uncertainties
from gonio.instrument.scans import scan

jax.config.update("jax_enable_x64", True)

INSTRUMENTS = {
    "calibration 0.5 %, misalignment 0.05°": {"gain": "0.5 %", **dict.fromkeys(
        ("tilt", "theta_i", "theta_o", "phi"), "0.05 deg")},
    "misalignment 0.2°, calibration 0.05 %": {"gain": "0.05 %", **dict.fromkeys(
        ("tilt", "theta_i", "theta_o", "phi"), "0.2 deg")},
    "calibration 0.5 % of 12 degrees of freedom, tilts 0.05° rectangular, dark 0.02 %": {
        "gain": "0.5 % dof 12", "tilt": "0.05 deg rectangular", "dark": "0.02 %"},
}  # fmt: skip
TRUTH, MODEL = "lambert(rho=0.4) + 0.3 * ggx(alpha=0.3)", "lambert + ggx"
NUMBERS = {"lambert.rho": 0.4, "ggx.alpha": 0.3, "ggx.scale": 0.3}
GRID = {"step": math.radians(5), "phi_step": math.radians(10)}
SHOWN = ("θi 0°", "θi 30°", "θi 45°", "θi 60°")


def truth_of(quantity: object) -> float | None:
    """The true value of a quantity that is looked at; None of others."""
    if quantity.name in NUMBERS:
        return NUMBERS[quantity.name]
    if quantity.name in ("albedo", "albedo of the fit") and quantity.place in SHOWN:
        return float(gonio.material(TRUTH).albedo(quantity.angles["theta_i"], degrees=True).value[0])
    return None


def beside_monte_carlo(draws: int = 400) -> None:
    """One table of each instrument: standard uncertainties of the linear budget beside those of Monte Carlo."""
    for name, stated in INSTRUMENTS.items():
        instrument = gonio.Instrument(photons=1e5, dark=100.0, noise=1e-3, stated=terms_of(stated))
        table = gonio.measure(TRUTH, instrument, scan("isotropic", step=math.radians(7.5)), seed=1)
        b = gonio.quantities(table, budget=True, fit=MODEL, monte_carlo=draws, only=["reflectance"]).budget
        ratio, shift = b.simulated["standard_uncertainty"] / b.standard, b.simulated["shift"] / b.standard
        agree = f"{np.count_nonzero(b.simulated['linear_agrees'])} of {b.size} intervals agree"
        largest = f"shift {np.abs(shift).max():.2f} u at most"
        print(f"{name}, Monte Carlo of {draws}: u {ratio.min():.3f} to {ratio.max():.3f} of linear, {largest}; {agree}")


def terms_of(stated: dict[str, str]) -> tuple:
    """What an instrument states."""
    return tuple(stated_uncertainties(stated).values())


def main(draws: int = 500, seed: int = 0) -> None:
    layout = scan("isotropic", **GRID)
    for name, stated in INSTRUMENTS.items():
        instrument = gonio.Instrument(photons=1e5, dark=100.0, noise=1e-3, stated=terms_of(stated))
        began, rows, truths = time.perf_counter(), {}, {}
        for k in range(draws):
            table = gonio.measure(TRUTH, instrument, layout, seed=seed + k)
            fitted = gonio.fit(table, MODEL, starts=1)
            made = gonio.quantities(table, budget=True, fit=fitted, only=["albedo"])
            between = next(c.values for c in made.budget.contributions if c.name == "interpolation")
            noise = sum(c.values**2 for c in made.budget.contributions if not c.shared) - between**2
            b = made.budget
            for q, u, between_u, n, factor in zip(
                made.quantities, b.standard, between, np.sqrt(noise), b.factor, strict=True
            ):
                key = f"{q.name} {q.place}"
                if key not in truths:
                    truths[key] = truth_of(q)
                if truths[key] is not None:
                    z = (q.value - truths[key]) / u
                    rows.setdefault(key, []).append((z, u / truths[key], between_u / u, n / u, factor))
        print(f"\n{name}: {draws} draws, {time.perf_counter() - began:.0f} s")
        heading = f"{'quantity':26}{'k = 2':>8}{'k of ν':>8}{'sd of z':>9}{'mean z':>9}{'u, %':>8}"
        print(f"{heading}  share of u²: interpolation, noise")
        for key, values in rows.items():
            z, u, between, noise, factor = np.array(values).T
            held = "".join(f"{100 * np.mean(np.abs(z) <= k):6.1f} %" for k in (2.0, factor))
            shares = f"{100 * np.mean(between**2):.3g} %, {100 * np.mean(noise**2):.3g} %"
            print(f"{key:26}{held}{z.std():9.3f}{z.mean():9.3f}{100 * u.mean():8.3f}  {shares}", flush=True)


if __name__ == "__main__":
    beside_monte_carlo()
    main(*map(int, sys.argv[1:]))
