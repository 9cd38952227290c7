"""Light on a surface: the BRDF by differentials, reciprocity, energy, the hours of a scan, wavelengths."""

import math

import numpy as np
from matplotlib.axes import Axes

from gonio.data.layouts import scattered
from gonio.data.material import Material
from gonio.data.subject import load_material
from gonio.figures.spectral_colour import channel_colour
from gonio.figures.spheres import encoded
from gonio.figures.style import INK, PALETTE, degree_axis, legend_above, picture, plain_powers
from gonio.instrument.instrument import Instrument
from gonio.instrument.measurement import measure
from gonio.instrument.pace import Pace
from gonio.instrument.scans import scan
from gonio.reports.chapter.experiment import Experiment, Result
from gonio.reports.chapter.numbers import Numbers

POWERS = np.array([0.0, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0])


def differentials(n: Numbers) -> Experiment:
    """L against E with the light of the room on: the ratio is no property of the surface, the slope is."""
    material, rng = load_material(n.material), np.random.default_rng(int(n.seed) + 3)
    f = float(material.f(n.theta_i, 0, n.theta_o, 180, degrees=True)[0])
    counts_per_radiance = n.photons * math.pi  # of the white diffuser under E = 1: L = 1/π
    irradiance = POWERS * math.cos(math.radians(n.theta_i))
    expected = f * irradiance + n.ambient / math.pi
    counts = rng.poisson(expected * counts_per_radiance)
    level, sigma = counts / counts_per_radiance, np.sqrt(np.maximum(counts, 1)) / counts_per_radiance
    lit, dark = level[-1], level[0]
    slope, u = (lit - dark) / irradiance[-1], math.hypot(sigma[-1], sigma[0]) / irradiance[-1]
    ratios = {p: (level[k] / irradiance[k], sigma[k] / irradiance[k]) for k, p in enumerate(POWERS) if p}
    return Experiment(
        "The BRDF is dL/dE, not L/E",
        "The lamp at several powers, the light of the room always on. The ratio of radiance to irradiance depends on "
        "the lamp; the change of one with the other does not, and that is the BRDF.",
        "f(Ψ ↔ Θ) = dL(Θ) / dE(Ψ)",
        [
            *(
                Result(f"L/E at {p:.0%} of the lamp", v, 3 * e, "1/sr")
                for p, (v, e) in ratios.items()
                if p in (0.05, 1)
            ),
            Result("ΔL/ΔE, lamp on and off", slope, 3 * u, "1/sr", f),
        ],
        picture("Radiance against irradiance, with the light of the room", _draw_slope, irradiance, level, f, dark),
        "Radiance against the lamp's irradiance, whose unit is the full lamp at normal incidence. Dotted: L/E of the "
        "full lamp; solid: the slope.",
        ["material", "theta_i", "theta_o", "ambient", "photons", "seed"],
    )


def _draw_slope(ax: Axes, irradiance: np.ndarray, level: np.ndarray, f: float, dark: float) -> None:
    ax.plot(irradiance, dark + f * irradiance, color=PALETTE[1], label="slope f")
    ax.plot(irradiance[[0, -1]], [0, level[-1]], ":", color=INK, label="L/E")
    ax.plot(irradiance, level, "o", ms=4, color=PALETTE[0], label="readings")
    ax.set(xlabel="E of the lamp", ylabel="L")
    ax.set_ylim(0, None)
    legend_above(ax)


def reciprocity(n: Numbers) -> Experiment:
    """The simulated instrument reads once, and again with the arms exchanged."""
    theta = np.radians([n.theta_i, n.theta_o, 10.0, 75.0, 20.0, 60.0])
    others = theta.reshape(3, 2)[:, ::-1].ravel()
    azimuth = np.radians(np.repeat([180.0, 180.0, 90.0], 2))
    layout = scattered(theta, np.zeros(6), others, azimuth)
    table = measure(n.material, Instrument(photons=n.photons), layout, seed=int(n.seed), log=lambda line: None)
    f, u = np.asarray(table.f)[:, 0], np.asarray(table.u_f)[:, 0]
    results = []
    for k in range(0, 6, 2):
        name = f"f({math.degrees(theta[k]):g}°→{math.degrees(others[k]):g}°)"
        results.append(Result(name, f[k], 3 * u[k], "1/sr"))
        results.append(Result("with the arms exchanged", f[k + 1], 3 * math.hypot(u[k], u[k + 1]), "1/sr", f[k]))
    return Experiment(
        "Exchanging the arms",
        "The simulated instrument reads the surface, then the lamp goes where the detector was and the detector where "
        "the lamp was. By Helmholtz reciprocity both readings are the same within their noise.",
        "f(Ψ → Θ) = f(Θ → Ψ)",
        results,
        picture("Readings with the arms one way and exchanged", _draw_pairs, f[::2], f[1::2], u[::2], u[1::2]),
        "Readings against those with exchanged arms; bars are three standard uncertainties.",
        ["material", "theta_i", "theta_o", "photons", "seed"],
    )


def _draw_pairs(ax: Axes, x: np.ndarray, y: np.ndarray, u_x: np.ndarray, u_y: np.ndarray) -> None:
    most = 1.15 * max(x.max(), y.max())
    ax.plot([0, most], [0, most], color=PALETTE[1], lw=1)
    ax.errorbar(x, y, 3 * u_y, 3 * u_x, "o", ms=4, color=PALETTE[0])
    ax.set(xlabel="f, 1/sr", ylabel="f with exchanged arms, 1/sr", xlim=(0, most), ylim=(0, most))


INCIDENCES = np.array([0.0, 20, 40, 60, 70, 80, 85, 88])


def energy(n: Numbers) -> Experiment:
    """Directional albedos of the surface and of a model that breaks the law."""
    curves, results = [], []
    for name in (n.material, n.liar):
        albedo = load_material(name).albedo(INCIDENCES, degrees=True)
        value, bound = albedo.value[:, 0], albedo.bound[:, 0]
        curves.append((name, value))
        k = int(np.argmax(value))
        results.append(Result(f"largest albedo of {name}, at {INCIDENCES[k]:g}°", value[k], bound[k], "1"))
        results.append(Result("its share above 1", max(value[k] - 1, 0.0), bound[k], "1", 0.0))
    return Experiment(
        "No more leaves than arrives",
        "All that a surface reflects of the light from one direction, by an integral over the hemisphere with a bound "
        "on its error, must not exceed what arrives. A formula may break that, and many published ones do: the second "
        "one differs from what the law expects, and is meant to.",
        "∫ f cosθo dωo ≤ 1 for every direction of the light",
        results,
        picture("Directional albedo against the angle of incidence", _draw_albedos, curves),
        "Directional albedo against the angle of incidence; the law's limit is the line at 1.",
        ["material", "liar"],
    )


def _draw_albedos(ax: Axes, curves: list[tuple[str, np.ndarray]]) -> None:
    for (name, value), colour in zip(curves, PALETTE, strict=False):
        ax.plot(INCIDENCES, value, "o-", ms=3, color=colour, label=name if len(name) < 45 else f"{name[:42]}…")
    ax.axhline(1, color=INK, lw=0.8)
    degree_axis(ax.xaxis)
    ax.set(xlabel="angle of incidence", ylabel="albedo")
    ax.set_ylim(0, None)
    legend_above(ax)


def hours(n: Numbers) -> Experiment:
    """The readings of a scan by its step, and the hours that arms of some speed need for them."""
    pace = Pace(axis_speed=math.radians(n.axis_speed), settling=n.settling)
    steps = sorted({n.step, 2.5, 5.0, 10.0, 15.0, 30.0})
    layouts = [scan("isotropic", step=math.radians(s)) for s in steps]
    readings = np.array([int(layout.readable().sum()) for layout in layouts])
    needed = np.array([pace.seconds(layout, n.photons) / 3600 for layout in layouts])
    k = steps.index(n.step)
    return Experiment(
        "The hours of a scan",
        "A gonioreflectometer turns two arms and the sample. For an isotropic surface three angles remain: half the "
        "step is eight times the readings. That is why tables are coarse, and models are fitted.",
        "readings ∝ 1/step³ (isotropic), 1/step⁴ (anisotropic)",
        [
            Result(f"readings at a step of {n.step:g}°", float(readings[k]), 0.0, "1"),
            Result("hours of this instrument", needed[k], 1e-9 * needed[k], "h"),
            Result("hours if all four angles had that step", needed[k] * 360 / n.step, 1e-9 * needed[k], "h"),
        ],
        picture("Hours against the step of a scan", _draw_hours, np.array(steps), needed),
        f"Hours against the step. {pace.sentence()} The numbers follow from that; no noise is in them.",
        ["step", "axis_speed", "settling", "photons"],
    )


def _draw_hours(ax: Axes, steps: np.ndarray, needed: np.ndarray) -> None:
    ax.loglog(steps, needed, "o-", color=PALETTE[0], label="isotropic scan")
    ax.loglog(steps, needed[-1] * (steps[-1] / steps) ** 3, ":", color=INK, label="slope −3")
    ax.set(xlabel="step, degrees", ylabel="hours")
    plain_powers(ax.xaxis, ax.yaxis)
    ax.grid(which="major")
    legend_above(ax)


def wavelengths(n: Numbers) -> Experiment:
    """Reflectance of a metal by wavelength, and the colour that it makes."""
    metal = load_material(n.metal)
    nodes = metal.channels.wavelengths_nm or tuple(range(len(metal.channels)))
    albedo = metal.albedo(0, degrees=True)
    value, bound = np.ravel(albedo.value), np.ravel(albedo.bound)
    chosen = sorted({int(np.argmin(value)), int(np.argmax(value))}, key=lambda k: nodes[k])
    return Experiment(
        "One BRDF for each wavelength",
        "Everything above holds at each wavelength by itself. The colour of a metal is that of its BRDF: where it "
        "reflects less of the blue it is yellow.",
        "f(λ; Ψ ↔ Θ)",
        [Result(f"albedo at {metal.channels.names[k]}", value[k], bound[k], "1") for k in chosen],
        picture(f"Albedo of {metal.name} by wavelength", _draw_spectrum, metal, np.asarray(nodes, float), value),
        f"Albedo of {metal.name} at normal incidence by wavelength; the band has its colour in daylight (D65).",
        ["metal"],
    )


def _draw_spectrum(ax: Axes, metal: Material, nodes: np.ndarray, value: np.ndarray) -> None:
    ax.set_ylim(0, 1.02)
    matrix = channel_colour(metal.channels).matrix
    if matrix is not None:
        r, g, b = encoded(matrix @ value) / 255
        ax.axhspan(0, 0.12, color=(r, g, b))
    ax.plot(nodes, value, "o-", color=PALETTE[0])
    ax.set(xlabel="wavelength, nm", ylabel="albedo")
