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
from gonio.stability.problems import ALBEDOS  # noqa: E402

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
    for problem in ALBEDOS:
        brdf = build(problem.expression)
        directional, average = directional_albedo(brdf, THETA, 0.0, 1e-11), hemispherical_albedo(brdf)
        row(f"albedo of {problem.name}", directional.value, problem.exact(MU), directional.bound)
        row(f"average albedo of {problem.name}", average.value, problem.average, average.bound)
    row("albedo of Blinn–Phong at normal: 1", albedos("blinn_phong(n=60)", np.zeros(1))[0], 1.0)
    for alpha, exact in ((0.5, 0.6878485151), (0.25, 0.9158124303), (0.1, 0.9883040566)):
        row(f"GGX at normal, α = {alpha} (ten digits)", albedos(f"ggx(alpha={alpha})", np.zeros(1))[0], exact)
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
