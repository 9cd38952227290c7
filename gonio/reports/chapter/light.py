"""Light alone: the solid angle of a patch, the irradiance of a luminous hemisphere, radiance along a ray."""

import math

import numpy as np
from matplotlib.axes import Axes

from gonio.figures.style import INK, PALETTE, legend_above, picture, plain_powers
from gonio.models.geometry import solid_angle
from gonio.models.geometry.directions import Direction, normalize
from gonio.models.radiometry import (
    irradiance_of_cap,
    radiance,
    solid_angle_of_element,
)
from gonio.reports.chapter.experiment import Experiment, Result
from gonio.reports.chapter.numbers import Numbers


def _estimate(samples: np.ndarray) -> tuple[float, float]:
    """(mean, three standard uncertainties of it)."""
    return float(samples.mean()), 3 * float(samples.std(ddof=1)) / math.sqrt(samples.size)


def patch(n: Numbers) -> Experiment:
    """The solid angle of a small patch: dA cosθ/d², exactly, and by random rays."""
    tilt, rng = math.radians(n.patch_tilt), np.random.default_rng(int(n.seed))

    def exact(distance: float) -> float:
        half = n.patch_side / 2
        corners = [
            normalize(Direction(x, y * math.cos(tilt), distance + y * math.sin(tilt)))
            for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))
        ]
        return float(solid_angle.triangle(*corners[:3]) + solid_angle.triangle(corners[0], *corners[2:]))

    def small(distance: float) -> float:
        return float(solid_angle_of_element(n.patch_side**2, math.cos(tilt), distance))

    # Points of the patch, each seen under its own dA cosθ/r².
    x, y = n.patch_side * (rng.random((2, int(n.rays))) - 0.5)
    z = n.patch_distance + y * math.sin(tilt)
    r2 = x**2 + (y * math.cos(tilt)) ** 2 + z**2
    normal = np.abs(-y * math.cos(tilt) * math.sin(tilt) + z * math.cos(tilt)) / np.sqrt(r2)
    value, error = _estimate(n.patch_side**2 * normal / r2)
    whole, of_small = exact(n.patch_distance), small(n.patch_distance)
    distances = n.patch_distance * np.geomspace(0.5, 8, 24)
    return Experiment(
        "The solid angle of a patch",
        "How large a thing looks is its area, foreshortened by its tilt, over the square of the distance. For a patch "
        "of finite size that is an approximation, whose error falls with the square of the distance.",
        "dω = dA cosθ / d²",
        [
            Result("exact, by two spherical triangles", whole, 1e-12, "sr"),
            Result("by random points on the patch", value, error, "sr", whole),
            Result("dA cosθ/d², as if it were small", of_small, abs(of_small - whole), "sr"),
        ],
        picture("Error of dA cosθ/d² against the distance", _draw_error, distances,
                np.array([abs(small(d) / exact(d) - 1) for d in distances])),
        "Relative error of dA cosθ/d² against the distance, both logarithmic: a slope of −2.",
        ["patch_side", "patch_distance", "patch_tilt", "rays", "seed"],
    )  # fmt: skip


def _draw_error(ax: Axes, distance: np.ndarray, error: np.ndarray) -> None:
    ax.loglog(distance, np.maximum(error, 1e-16), color=PALETTE[0])
    ax.set(xlabel="distance, m", ylabel="relative error")
    plain_powers(ax.xaxis, ax.yaxis)
    ax.grid(which="major")


def detector(n: Numbers) -> Experiment:
    """The irradiance of a luminous hemisphere and of a cap, by a detector that counts rays with their cosine."""
    rng = np.random.default_rng(int(n.seed) + 1)
    cosines, cap = rng.random(int(n.rays)), math.radians(n.cap)
    whole, error = _estimate(2 * math.pi * n.radiance * cosines)
    part, part_error = _estimate(2 * math.pi * n.radiance * cosines * (cosines > math.cos(cap)))
    angles = np.radians(np.arange(0, 91, 3.0))
    measured = np.array([(2 * math.pi * n.radiance * cosines * (cosines > math.cos(a))).mean() for a in angles])
    law = np.array([float(irradiance_of_cap(n.radiance, a)) for a in angles])
    return Experiment(
        "E = πL by a detector",
        "A flat detector under a hemisphere of uniform radiance: each direction counts with the cosine of its angle, "
        "so that the hemisphere of 2π steradians gives π times its radiance, not 2π times.",
        "E = ∫ L cosθ dω = πL;  a cap of half-angle s gives πL sin²s",
        [
            Result("irradiance of the hemisphere", whole, error, "W/m²", math.pi * n.radiance),
            Result(f"of a cap of {n.cap:g}°", part, part_error, "W/m²", float(irradiance_of_cap(n.radiance, cap))),
        ],
        picture("Irradiance against the half-angle of the cap", _draw_cap, np.degrees(angles), measured, law),
        "Irradiance against the half-angle of the luminous cap: dots by the detector, the line πL sin²s.",
        ["radiance", "cap", "rays", "seed"],
    )


def _draw_cap(ax: Axes, angles: np.ndarray, measured: np.ndarray, law: np.ndarray) -> None:
    ax.plot(angles, law, color=PALETTE[1], label="πL sin²s")
    ax.plot(angles, measured, "o", ms=3.5, color=PALETTE[0], label="detector")
    ax.set(xlabel="half-angle of the cap, degrees", ylabel="irradiance, W/m²")
    legend_above(ax)


def two_apertures(n: Numbers) -> Experiment:
    """Flux through two apertures at three distances: it falls, as the étendue does, and their ratio stays."""
    rng, a = np.random.default_rng(int(n.seed) + 2), n.aperture
    distances = [n.distance, 2 * n.distance, 4 * n.distance]
    results, flux, levels = [], [], []
    for d in distances:
        radius, turn = a * np.sqrt(rng.random((2, int(n.rays)))), 2 * math.pi * rng.random((2, int(n.rays)))
        x, y = radius * np.cos(turn), radius * np.sin(turn)
        r2 = (x[0] - x[1]) ** 2 + (y[0] - y[1]) ** 2 + d * d
        power, error = _estimate(n.radiance * (math.pi * a * a) ** 2 * d * d / r2**2)
        # Of two coaxial discs the étendue is known exactly: π A₁ times the form factor.
        ratio = 2 + (d / a) ** 2
        passed = math.pi * math.pi * a * a * 0.5 * (ratio - math.sqrt(ratio * ratio - 4))
        flux.append(power)
        levels.append(float(radiance(power, passed)))
        results.append(Result(f"flux at {d:g} m", power, error, "W"))
        results.append(Result(f"flux / étendue at {d:g} m", levels[-1], error / passed, "W/(m² sr)", n.radiance))
    return Experiment(
        "Radiance does not change along a ray",
        "A lamp of one radiance fills the first aperture; a detector behind the second one counts. Further away it "
        "counts less, by just as much as fewer directions pass both: flux over étendue, radiance, is the same.",
        "L = dΦ / (dA cosθ dω);  dA₁ cosθ₁ dω₁ = dA₂ cosθ₂ dω₂",
        results,
        picture("Flux and radiance by distance, relative to the first", _draw_flux, np.array(distances),
                np.array(flux) / flux[0], np.array(levels) / levels[0]),
        "Flux through both apertures, and flux over étendue, both relative to the first distance.",
        ["radiance", "aperture", "distance", "rays", "seed"],
    )  # fmt: skip


def _draw_flux(ax: Axes, distance: np.ndarray, flux: np.ndarray, level: np.ndarray) -> None:
    ax.loglog(distance, flux, "o-", color=PALETTE[0], label="flux")
    ax.loglog(distance, level, "s-", color=PALETTE[1], label="radiance")
    ax.set(xlabel="distance, m", ylabel="relative to the first")
    plain_powers(ax.xaxis, ax.yaxis)
    ax.axhline(1, color=INK, lw=0.5)
    legend_above(ax)
