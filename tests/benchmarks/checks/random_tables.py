"""Verdicts on random tables whose truth is known: honest ones, planted violations of reciprocity, too much energy.

    python random_tables.py [TABLES [FIRST [KIND,...]]]

Table k is made from the seed k and the kinds (all by default; "isotropic,coarse_light": some) alone. A verdict is
WRONG where it fails what holds within the tolerance, or passes what does not; where noise is stored, 1 % of honest
tables may fail (the level). Undecided and untestable ones are counted by kind. A surface is scaled to a largest albedo
that is known to 1e-6; a planted violation multiplies f in a region by 1 + v, never in the exchanged region, so that
readings there differ by 2v/(2 + v).
"""

import collections
import math
import sys
import time
from typing import NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import gonio  # noqa: E402
from gonio.data import layouts  # noqa: E402
from gonio.data.table import whole_table_of_values  # noqa: E402
from gonio.models.albedo import directional_albedo  # noqa: E402
from gonio.models.expression.builder import build  # noqa: E402

RECIPROCITY, ENERGY = 0.05, 0.01  # the tolerances of `gonio check`
THETA = np.radians([0, 10, 20, 30, 40, 50, 60, 65, 70, 75, 80, 83, 85, 87, 89])
GRIDS = ("isotropic", "spherical", "in-plane", "half-difference", "coarse light", "coarse azimuths")
LISTS = ("random", "clustered", "in-plane list", "repeated", "grid as list", "few incidences", "one incidence", "holes")
NOISES = ("none", "stored", "photons", "unsaid")


class Truth(NamedTuple):
    """The surface of a table, its largest albedo at the incidences read, and what is wrong with the readings."""

    expression: str
    largest: float
    difference: float
    region: str


def surface(rng: np.random.Generator, most: float) -> tuple[str, np.ndarray]:
    """An expression with a largest albedo, and its albedos at `THETA`."""
    diffuse = rng.choice(["lambert(rho=1)", "eon(rho={a:.3f}, r={b:.3f})", "minnaert(rho=1, k={c:.3f})"])
    lobe = rng.choice(
        ["ggx(alpha={w:.4f}, f0={f:.3f})", "ggx(alpha={w:.4f}, eta={n:.3f})", "beckmann(alpha={w:.4f}, eta={n:.3f})",
         "retro(alpha={w:.4f}, f0={f:.3f})", "phong(n={p:.1f})"]
    )  # fmt: skip
    numbers = {
        "a": rng.uniform(0.3, 1), "b": rng.uniform(0, 1), "c": rng.uniform(1, 2), "w": 10 ** rng.uniform(-1.7, -0.1),
        "f": rng.uniform(0.03, 1), "n": rng.uniform(1.2, 2.5), "p": 10 ** rng.uniform(0.3, 3),
    }  # fmt: skip
    share = rng.uniform(0, 1)
    body = f"{1 - share:.4f} * {diffuse} + {share:.4f} * {lobe}".format(**numbers)
    albedo = np.asarray(directional_albedo(build(body), THETA, tolerance=1e-7).value).reshape(THETA.size, -1)[:, 0]
    scale = float(f"{most / albedo.max():.6g}")
    return " + ".join(f"{scale:.6g} * {term}" for term in (f"({body})",)), scale * albedo


def hemisphere(rng: np.random.Generator, n: int, most: float = 85.0) -> tuple[np.ndarray, np.ndarray]:
    cosine = 1 - rng.random(n) * (1 - math.cos(math.radians(most)))
    return np.arccos(cosine), rng.uniform(0, 2 * np.pi, n)


def grid(kind: str, rng: np.random.Generator) -> layouts.Layout:
    """A layout of a random step."""
    step = float(rng.choice([5.0, 7.5, 10.0, 15.0]))
    polar = np.radians(np.arange(0, 85.01, step))
    if kind == "isotropic":
        return layouts.isotropic(polar, polar, np.radians(np.arange(0, 360, max(step, 10.0))))
    if kind == "in-plane":
        incident = np.sort(rng.choice(polar[1:], min(int(rng.integers(2, 8)), polar.size - 1), replace=False))
        return layouts.in_plane(incident, np.concatenate([-polar[:0:-1], polar]))
    if kind == "coarse light":
        incident = np.radians(np.arange(0, 80.01, rng.choice([7.5, 10, 15, 20, 30])))
        step, offset = float(rng.choice([3, 5, 7.5, 10])), float(rng.choice([0, 0, 0.5]))
        polar = np.radians(np.arange(offset * step, 85.01, step))
        return layouts.isotropic(incident, polar, np.radians(np.arange(0, 360, rng.choice([5.0, 10.0, 15.0, 30.0]))))
    if kind == "coarse azimuths":
        incident, of_light = np.arange(0, 80.01, rng.choice([15, 20, 30])), rng.choice([30.0, 45.0, 90.0])
        polar, azimuth = np.radians(np.arange(0, 85.01, 10.0)), np.radians(np.arange(0, 360, 15.0))
        return layouts.spherical(np.radians(incident), np.radians(np.arange(0, 360, of_light)), polar, azimuth)
    if kind == "spherical":
        polar, azimuth = np.radians(np.arange(0, 85.01, 17.0)), np.radians(np.arange(0, 360, 30.0))
        return layouts.spherical(polar, azimuth, polar, azimuth)
    count = round(90 / step)
    return layouts.merl(counts=(count, count, 2 * count))


def angles_of_list(kind: str, rng: np.random.Generator) -> np.ndarray:
    """theta_i, phi_i, theta_o, phi_o, (4, n), radians."""
    if kind == "random":
        n = int(rng.integers(300, 5000))
        return np.stack([*hemisphere(rng, n), *hemisphere(rng, n)])
    if kind == "clustered":
        n, incident = int(rng.integers(50, 400)), np.radians(rng.uniform(0, 75, int(rng.integers(3, 9))))
        theta_i = np.repeat(incident, n)
        theta = np.abs(theta_i + rng.normal(0, 0.2, theta_i.size))
        return np.stack([theta_i, 0 * theta, np.minimum(theta, 1.48), np.pi + rng.normal(0, 0.3, theta.size)])
    if kind in ("in-plane list", "repeated"):
        incident = np.radians(rng.choice(np.arange(5, 81, 5), int(rng.integers(2, 8)), replace=False))
        theta_i, signed = (a.ravel() for a in np.meshgrid(incident, np.radians(np.arange(-80, 81, 5)), indexing="ij"))
        angles = np.stack([theta_i, 0 * theta_i, np.abs(signed), np.where(signed < 0, 0.0, np.pi)])
        return np.repeat(angles, int(rng.integers(2, 5)), axis=1) if kind == "repeated" else angles
    if kind in ("few incidences", "one incidence"):
        count = 1 if kind == "one incidence" else int(rng.integers(2, 7))
        n, incident = int(rng.integers(200, 1500)), np.radians(rng.uniform(0, 80, count))
        theta_i = np.repeat(incident, n)
        return np.stack([theta_i, 0 * theta_i, *hemisphere(rng, theta_i.size)])
    polar, azimuth = np.radians(np.arange(0, 85.01, 10.0)), np.radians(np.arange(0, 360, 15.0))
    theta_i, theta_o, phi = (a.ravel() for a in np.meshgrid(polar, polar, azimuth, indexing="ij"))
    angles = np.stack([theta_i, 0 * phi, theta_o, phi])
    return angles[:, rng.random(phi.size) > rng.uniform(0.1, 0.5)] if kind == "holes" else angles


def region_of(rng: np.random.Generator, angles: np.ndarray) -> tuple[np.ndarray, str]:
    """Readings of larger polar angles of the detector than of the light, in a sector of azimuths: never exchanged."""
    theta_i, phi_i, theta_o, phi_o = angles
    low = rng.uniform(68, 76) if rng.random() < 0.4 else rng.uniform(15, 55)
    high = 90.0 if low > 60 else low + rng.uniform(10, 30)
    middle, half = rng.uniform(0, np.pi), rng.uniform(np.pi / 6, np.pi)
    turn = np.abs((phi_o - phi_i + np.pi) % (2 * np.pi) - np.pi)  # the same for an exchanged pair
    inside = (np.degrees(theta_o) > low) & (np.degrees(theta_o) < high) & (np.degrees(theta_i) <= low)
    where = f"θo {low:.0f}–{high:.0f}°, θi below, |Δφ − {middle:.1f}| < {half:.1f}"
    return inside & (np.abs(turn - middle) < half), where


def random_table(seed: int, kinds: tuple[str, ...]) -> tuple[str, str, str, Truth, gonio.Table]:
    """(kind, noise, what is wrong, truth, table) of one seed."""
    rng = np.random.default_rng(seed)
    kind, noise = str(rng.choice(kinds)), str(rng.choice(NOISES))
    wrong = str(rng.choice(["nothing", "reciprocity", "energy"], p=[0.4, 0.35, 0.25]))
    wrong = "energy" if wrong == "reciprocity" and kind == "half-difference" else wrong
    # What a planted violation adds at most doubles the albedo.
    ranges = {"nothing": (0.2, 0.999), "reciprocity": (0.1, 0.49)}
    most = 1 + float(rng.choice([0.005, 0.02, 0.1])) if wrong == "energy" else rng.uniform(*ranges[wrong])
    expression, albedo = surface(rng, most)
    layout = grid(kind, rng) if kind in GRIDS else None
    angles = np.stack(layout.angles()) if layout is not None else angles_of_list(kind, rng)
    above = np.isfinite(angles).all(axis=0) & (angles[[0, 2]] <= np.pi / 2).all(axis=0)
    f = gonio.material(expression).f(*np.where(above, angles, 0.0))[..., 0]  # the others are flagged by their angles
    difference, region = 0.0, ""
    if wrong == "reciprocity":
        inside, region = region_of(rng, angles)
        violation = 10 ** rng.uniform(math.log10(0.005), 0)
        if 0.01 < inside.mean() < 0.5:
            difference = 2 * violation / (2 + violation)
            f = np.where(inside, (1 + violation) * f, f)
        else:
            wrong = "nothing"
    sigma = np.zeros(f.shape)
    if noise in ("stored", "unsaid"):
        sigma = rng.uniform(0.002, 0.05) * f
    elif noise == "photons":
        sigma = np.sqrt(f * np.median(f[f > 0]) / 10 ** rng.uniform(2, 6))
    f, u = f + sigma * rng.normal(size=f.shape), None if noise in ("none", "unsaid") else sigma
    read = angles[0][above]
    ends = np.interp([read.min(), read.max()], THETA, albedo)
    inside = albedo[(read.min() <= THETA) & (read.max() >= THETA)]
    truth = Truth(expression, float(max(*ends, *inside)), difference, region)
    if layout is None:
        return kind, noise, wrong, truth, gonio.Table.from_arrays(*angles, f, u_f=u)
    more = {} if u is None else {"u_f": u.reshape(*layout.shape, 1)}
    return kind, noise, wrong, truth, whole_table_of_values(layout, f.reshape(layout.shape), **more)


def judged(truth: Truth, certificate: gonio.Certificate) -> dict[str, str]:
    """For reciprocity, energy and the whole: right, WRONG, undecided or what else the certificate says."""
    lawful = {"reciprocity": truth.difference <= RECIPROCITY, "energy": truth.largest <= 1 + ENERGY}
    verdicts = {name: (certificate[name].verdict, holds) for name, holds in lawful.items()}
    verdicts["overall"] = certificate.overall, all(lawful.values())
    right = {("pass", True), ("fail", False)}
    return {
        name: verdict if verdict not in ("pass", "fail") else "right" if (verdict, holds) in right else "WRONG"
        for name, (verdict, holds) in verdicts.items()
    }


def print_counts(counts: dict[tuple[str, str], collections.Counter]) -> None:
    """A table of outcomes by kind for each of the verdicts."""
    for name in ("reciprocity", "energy", "overall"):
        print(f"\n{name:<20}{'tables':>8}{'right':>8}{'WRONG':>8}{'undecided':>11}{'other':>8}")
        for kind in GRIDS + LISTS:
            if not (c := counts[name, kind]):
                continue
            known = [c[outcome] for outcome in ("right", "WRONG", "undecided")]
            print(f"{kind:<20}{c.total():8}{known[0]:8}{known[1]:8}{known[2]:11}{c.total() - sum(known):8}")


def main(tables: int, first: int, kinds: tuple[str, ...]) -> None:
    counts, seconds, noisy, alarms = collections.defaultdict(collections.Counter), [], 0, 0
    for seed in range(first, first + tables):
        kind, noise, wrong, truth, table = random_table(seed, kinds)
        began = time.perf_counter()
        certificate = gonio.check(table, name=f"{kind} {seed}")
        seconds.append(time.perf_counter() - began)
        by_level = noise in ("stored", "photons") and wrong == "nothing"
        noisy += by_level
        for name, outcome in judged(truth, certificate).items():
            counts[name, kind][outcome] += 1
            if outcome == "WRONG":
                alarms += by_level and name == "reciprocity"
                detail = "" if name == "overall" else f": {certificate[name].verdict}: {certificate[name].detail}"
                about = f"albedo {truth.largest:.4f}, difference {truth.difference:.3f} {truth.region}"
                print(f"WRONG {seed} {kind}, noise {noise}, {wrong} wrong, {about}: {name}{detail}", flush=True)
    print_counts(counts)
    print(f"\nhonest tables with stored noise: {noisy}, of which {alarms} fail reciprocity (level 1 %)")
    print(f"seconds a table: median {np.median(seconds):.2f}, largest {max(seconds):.1f}")


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:3]]
    named = tuple(sys.argv[3].replace("_", " ").split(",")) if len(sys.argv) > 3 else GRIDS + LISTS
    main(*(numbers + [2000, 0][len(numbers) :]), named)
