"""The residual beside each closed form of microfacets, diffuse and volumetric scattering, and Fresnel's equations."""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from gonio.models.albedo import directional_albedo, hemispherical_albedo  # noqa: E402
from gonio.models.expression.builder import build  # noqa: E402
from gonio.models.fresnel import fresnel_conductor, fresnel_dielectric, fresnel_schlick1994  # noqa: E402
from gonio.models.geometry.directions import Direction  # noqa: E402
from gonio.models.microfacet import distributions as slopes  # noqa: E402
from gonio.models.microfacet.gtr import gtr_d  # noqa: E402
from gonio.models.microfacet.student_t import student_d  # noqa: E402

MU = np.array([1.0, 0.8, 0.5, 0.2, 0.05, 0.01])
THETA = np.arccos(MU)


def albedos(expression, theta=THETA):
    """(directional albedos, their bounds)."""
    found = directional_albedo(build(expression), theta, 0.0, 1e-11)
    return np.asarray(found.value), np.asarray(found.bound)


def row(name, found, exact, bound=0.0):
    error = float(np.max(np.abs(np.asarray(found) - exact)))
    print(f"{name:64} {error:9.1e}   claimed {float(np.max(bound)):8.1e}")


def facets(density):
    """∫ D cosθ dω over slopes s = tanθ, by tan of Gauss–Legendre nodes."""
    x, w = np.polynomial.legendre.leggauss(4000)
    u = (x + 1) / 2
    s = (u / (1 - u)) ** 2
    ds = w / 2 * 2 * u / (1 - u) ** 3
    z = 1 / np.sqrt(1 + s * s)
    d = np.asarray(density(Direction(jnp.asarray(s * z), jnp.zeros_like(s), jnp.asarray(z))))
    return float(np.sum(d * z**4 * 2 * np.pi * s * ds))


def main() -> None:
    lost = MU * np.log1p(1 / MU)
    for name, expression, exact in (
        ("Lambert: ρ", "lambert(rho=0.7)", 0.7),
        ("Minnaert: ρ μ^(k−1), k = 1.7", "minnaert(rho=0.5, k=1.7)", 0.5 * MU**0.7),
        ("Lommel–Seeliger: (w/2)(1 − μ ln(1 + 1/μ))", "lommel_seeliger(w=0.8)", 0.4 * (1 - lost)),
        ("Chandrasekhar, w = 1: 1", "chandrasekhar(w=1)", 1.0),
        ("EON, ρ = 1: 1", "eon(rho=1, r=1)", 1.0),
        ("white standard: 1", "white_standard()", 1.0),
        ("GGX α = 1, correlated: 1 − μ ln(1 + 1/μ)", "ggx(alpha=1)", 1 - lost),
        ("GGX α = 1, separable: 2(1 − ln 2)/(1 + μ)", "ggx(alpha=1, smith=separable)", 2 * (1 - np.log(2)) / (1 + MU)),
        ("GGX Kulla–Conty, F = 1: 1", "ggx(alpha=0.3, energy=kulla_conty)", 1.0),
        ("Beckmann Kulla–Conty, F = 1: 1", "beckmann(alpha=0.3, energy=kulla_conty)", 1.0),
        ("Kelemen, ρ = 1: 1", "kelemen(rho=1, alpha=0.3, f0=0.04)", 1.0),
    ):
        row(f"albedo of {name}", albedos(expression)[0], exact, albedos(expression)[1])
    s = np.sqrt(1 - MU**2)
    c1, r = 0.5 - 2 / (3 * np.pi), 0.7
    g = s * (np.arccos(MU) - s * MU) + 2 / 3 * (s / MU * (1 - s**3) - s)
    row("albedo of Fujii: A + (rA/π)G", albedos("fujii(rho=1, r=0.7)")[0], (1 + r * g / np.pi) / (1 + c1 * r))
    row("albedo of Blinn–Phong at normal: 1", albedos("blinn_phong(n=60)", np.zeros(1))[0], 1.0)
    for alpha, exact in ((0.5, 0.6878485151), (0.25, 0.9158124303), (0.1, 0.9883040566)):
        row(f"GGX at normal, α = {alpha} (ten digits)", albedos(f"ggx(alpha={alpha})", np.zeros(1))[0], exact)
    for name, expression, exact in (
        ("GGX α = 1, correlated: (4/3)(1 − ln 2)", "ggx(alpha=1)", 4 / 3 * (1 - np.log(2))),
        ("GGX α = 1, separable: 4(1 − ln 2)²", "ggx(alpha=1, smith=separable)", 4 * (1 - np.log(2)) ** 2),
        ("Fujii: A(1 + c₂r)", "fujii(rho=1, r=0.7)", (1 + (2 / 3 - 28 / (15 * np.pi)) * r) / (1 + c1 * r)),
    ):
        found = hemispherical_albedo(build(expression))
        row(f"average albedo of {name}", found.value, exact, found.bound)
    for name, density in (
        ("GGX, α = 0.3", lambda m: slopes.ggx_d(m, 0.3, 0.3)),
        ("Beckmann, α = 0.3", lambda m: slopes.beckmann_d(m, 0.3, 0.3)),
        ("STD, α = 0.3, γ = 3", lambda m: jax.vmap(lambda x, y, z: student_d(Direction(x, y, z), 0.3, 0.3, 3.0))(*m)),
        ("GTR, α = 0.3, γ = 1.5", lambda m: jax.vmap(lambda x, y, z: gtr_d(Direction(x, y, z), 0.3, 1.5))(*m)),
    ):
        row(f"∫ D cosθ dω = 1 of {name}", facets(density), 1.0)
    x, w = np.polynomial.legendre.leggauss(200)
    c, w = (x + 1) / 2, w / 2
    row("Schlick's average: F₀ + (1 − F₀)/21", np.sum(w * 2 * c * fresnel_schlick1994(c, 0.04)), 0.04 + 0.96 / 21)
    row("normal incidence ((n−1)² + k²)/((n+1)² + k²)", fresnel_conductor(1.0, 0.2, 3.0), (0.64 + 9) / (1.44 + 9))
    row("grazing: 1", fresnel_dielectric(0.0, 1.5), 1.0)
    row("total internal reflection: 1", fresnel_dielectric(0.3, 1 / 1.5), 1.0)
    brewster = np.cos(np.arctan(1.5))
    r_s = (
        (brewster - 1.5 * np.sqrt(1 - (1 - brewster**2) / 2.25))
        / (brewster + 1.5 * np.sqrt(1 - (1 - brewster**2) / 2.25))
    ) ** 2
    row("Brewster: R = R_s/2", fresnel_dielectric(brewster, 1.5), r_s / 2)


if __name__ == "__main__":
    main()
