"""Beyond reflection at a point: light through a surface, light below it, and light as waves."""

import math

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes

from gonio.data.subject import load_material
from gonio.figures.disc import lit_disc
from gonio.figures.spheres import png
from gonio.figures.style import PALETTE, degree_axis, legend_above, picture, plain_powers
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical
from gonio.models.subsurface.dipole import Dipole
from gonio.models.subsurface.evaluation import evaluated, totals
from gonio.models.subsurface.spots import kept_share
from gonio.models.surface_scatter.grating import Grating
from gonio.reports.chapter.experiment import Experiment, Result
from gonio.reports.chapter.numbers import Numbers

INCIDENCES = np.radians([0.0, 20, 40, 60, 75, 85])


def through(n: Numbers) -> Experiment:
    """R, T and their sum by incidence, and the reciprocity of the BTDF across an interface."""
    brdf = load_material(n.interface).brdf
    reflected, passed = (g(brdf, INCIDENCES, tolerance=1e-6) for g in (directional_albedo, directional_transmittance))
    r, t = (np.asarray(a.value).reshape(INCIDENCES.size, -1)[:, 0] for a in (reflected, passed))
    bound = float(np.max(reflected.bound) + np.max(passed.bound))
    eta = float(np.ravel(np.asarray(getattr(brdf, "eta", 1.0)))[0])
    front, behind = from_spherical(np.radians(30.0), 0.0, np), from_spherical(np.radians(160.0), np.pi, np)
    there, back = (float(np.ravel(evaluate(brdf, *pair))[0]) for pair in ((front, behind), (behind, front)))
    return Experiment(
        "Through the surface: the BTDF",
        "Some light passes, and its BTDF is dL/dE as well, with the detector behind. What is reflected and what passes "
        "is together no more than what arrives. Exchanging the arms, radiance changes by the square of the index.",
        "R + T ≤ 1;  f_t(i → o)/η_o² = f_t(o → i)/η_i²",
        [
            Result("R at normal incidence", r[0], bound, "1"),
            Result("T at normal incidence", t[0], bound, "1"),
            Result("R + T above 1, at most", max(float((r + t).max()) - 1, 0.0), bound, "1", 0.0),
            Result("f_t from air at 30° to 160°, over η²", there / eta**2, 1e-9 * abs(there), "1/sr", back),
        ],
        picture("R, T and their sum against the incidence", _draw_shares, np.degrees(INCIDENCES), r, t),
        "Reflected and transmitted shares against the angle of incidence, and their sum.",
        ["interface"],
    )


def _draw_shares(ax: Axes, angles: np.ndarray, r: np.ndarray, t: np.ndarray) -> None:
    for value, name, colour in zip((r, t, r + t), ("R", "T", "R + T"), PALETTE, strict=False):
        ax.plot(angles, value, "o-", ms=3, color=colour, label=name)
    degree_axis(ax.xaxis)
    ax.set(xlabel="angle of incidence", ylabel="share", ylim=(0, 1.05))
    legend_above(ax)


def below(n: Numbers) -> Experiment:
    """The dipole's exitance by distance, its total, and what a spot of finite size loses."""
    model = Dipole(jnp.asarray(n.absorption), jnp.asarray(n.scattering))
    r = np.geomspace(0.02, 30, 120) / n.scattering
    profile, total = evaluated(model, "profile", r)[:, 0], float(totals(model)[0])
    far = float(evaluated(model, "cumulative", np.array([1e4 / n.scattering]))[0, 0])
    kept = kept_share(model, n.spot, n.spot)
    exchanged = [kept_share(model, a, b) for a, b in ((n.spot, 3 * n.spot), (3 * n.spot, n.spot))]
    return Experiment(
        "Below the surface: the BSSRDF",
        "In milk, skin or marble light leaves elsewhere than it entered. The BRDF is what remains where everything lit "
        "is larger than that distance; a spot that is not loses light at its edge. (The dipole's own limits: "
        f"{Dipole.limits}.)",
        "dL(xo, Θ) = S(xi, Ψ; xo, Θ) dΦ(xi, Ψ)",
        [
            Result("reflected in all, ∫ R dA", far, 1e-6, "1", total),
            Result(f"kept by spots of {n.spot:g} mm", float(kept.value[0]), float(kept.bound[0]), "1"),
            Result("lit 3 times as wide as viewed", float(exchanged[0].value[0]), float(exchanged[0].bound[0]), "1"),
            Result("viewed 3 times as wide as lit", float(exchanged[1].value[0]),
                   float(exchanged[1].bound[0] + exchanged[0].bound[0]), "1", float(exchanged[0].value[0])),
        ],
        picture("Exitance by the distance from a narrow beam", _draw_profile, r, profile),
        "Exitance R against the distance from a narrow beam of 1 W, by the dipole of Jensen et al. (2001).",
        ["absorption", "scattering", "spot"],
    )  # fmt: skip


def _draw_profile(ax: Axes, r: np.ndarray, profile: np.ndarray) -> None:
    ax.loglog(r, profile, color=PALETTE[0])
    ax.set(xlabel="distance, mm", ylabel="R, 1/mm²")
    plain_powers(ax.xaxis, ax.yaxis)
    ax.grid(which="major")


def waves(n: Numbers) -> Experiment:
    """The orders of a compact disc: where a scan of its BRDF finds them, and where the grating equation puts them."""
    disc = load_material(n.disc)
    grating, nodes = disc.brdf, disc.channels.wavelengths_nm
    if not isinstance(grating, Grating) or nodes is None:
        raise GonioError(f"{disc.name} is no grating with wavelengths; give one, such as compact_disc")
    theta_i, step = n.disc_theta_i, 0.01
    # Signed angles in the plane across the tracks; the light comes from the negative side.
    signed = np.arange(-89.0, 89.0, step)
    f = disc.f(theta_i, 180, np.abs(signed), np.where(signed < 0, 180.0, 0.0), degrees=True)
    sines, period = np.sin(np.radians(signed)), float(np.ravel(np.asarray(grating.period))[0])
    results = []
    for k in (0, len(nodes) // 2, len(nodes) - 1):
        expected = math.sin(math.radians(theta_i)) + nodes[k] / 1000 / period
        if expected > 0.98:
            expected = math.sin(math.radians(theta_i)) - nodes[k] / 1000 / period
        near = np.abs(sines - expected) < 3 * float(np.max(np.asarray(grating.lobe_width)))
        # The middle of the lobe, by its own weights; efficiencies change a little across it.
        middle = float(np.sum(sines[near] * f[near, k]) / np.sum(f[near, k]))
        shift = float(np.max(np.asarray(grating.lobe_width))) ** 2 * 10
        angle = math.degrees(math.asin(expected))
        angle_read = math.degrees(math.asin(middle))
        error = math.degrees((shift + math.radians(step)) / math.cos(math.radians(angle)))
        results.append(Result(f"first order of {disc.channels.names[k]}", angle_read, error, "deg", angle))
    picture_of_disc = lit_disc(disc)
    return Experiment(
        "Light as waves: the rainbow on a disc",
        "Where tracks are a few wavelengths apart, their waves add up in some directions only, others for each "
        "wavelength. No formula of rays has that; the BRDF has it all the same, one for each wavelength. "
        "The disc below has its tracks all around and a lamp behind it.",
        "sinθm = sinθi + mλ/d",
        results,
        picture("Orders of the disc in the plane across its tracks", _draw_orders, signed, f, np.asarray(nodes)),
        "f in the plane across the tracks by wavelength, each line in its colour; the strongest is the mirror image. "
        f"The disc under a lamp: {picture_of_disc.words}.",
        ["disc", "disc_theta_i"],
        png(picture_of_disc.rgba),
    )


def _draw_orders(ax: Axes, signed: np.ndarray, f: np.ndarray, nodes: np.ndarray) -> None:
    from gonio.figures.spheres import encoded
    from gonio.fitting.residuals.colour_difference import LINEAR_SRGB, observer

    for k, wavelength in enumerate(nodes):
        rgb = np.maximum(np.linalg.inv(LINEAR_SRGB) @ observer(np.array([wavelength]))[:, 0], 0)
        r, g, b = encoded(rgb / max(rgb.max(), 1e-12)) / 255
        ax.semilogy(signed, np.maximum(f[:, k], 1e-12), color=(0.85 * r, 0.85 * g, 0.85 * b), lw=1.1)
    ax.set(xlabel="angle of the detector", ylabel="f, 1/sr", ylim=(f.max() * 1e-6, f.max() * 2))
    plain_powers(ax.yaxis)
    degree_axis(ax.xaxis, range(-90, 91, 30))
