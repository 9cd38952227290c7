"""How often the 95 % intervals of σa and σs from noisy profiles hold the truth.

python tests/benchmarks/subsurface/profile_coverage.py [DRAWS] [PHOTONS]
"""

import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import gonio  # noqa: E402
from gonio.fitting.subsurface.profile_fit import fit_profile  # noqa: E402
from gonio.instrument.offsets_scan import measure_profile  # noqa: E402

OFFSETS = np.array([-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 12.0])
TRUTHS = ((0.01, 1.0), (0.1, 2.0), (0.002, 0.7))


def main(draws: int, photons: float) -> None:
    device = gonio.Instrument(photons=photons, illuminated_radius=0.5, viewed_radius=0.3)
    for name in ("dipole", "better_dipole", "normalised_diffusion"):
        truth = {"sigma_a": [a for a, _ in TRUTHS], "sigma_s": [s for _, s in TRUTHS]}
        material = f"{name}(sigma_a={truth['sigma_a']}, sigma_s={truth['sigma_s']}, eta=1.3)"
        inside, z = {n: [] for n in truth}, {n: [] for n in truth}
        for seed in range(-(-draws // len(TRUTHS))):
            fit = fit_profile(measure_profile(material, device, OFFSETS, seed=seed), f"{name}(eta=1.3)")
            assert fit.converged
            for parameter in fit.parameters:
                number = parameter.name.split(".")[1]
                if number in truth:
                    value = truth[number][fit.material.channels.names.index(parameter.channel)]
                    low, high = parameter.interval95
                    inside[number].append(low <= value <= high)
                    z[number].append((parameter.value - value) / parameter.standard_uncertainty)
        for number in truth:
            count = len(inside[number])
            print(
                f"{name:24}{number:10}{100 * np.mean(inside[number]):6.1f} % of {count}   "
                f"rms of error/u {np.sqrt(np.mean(np.square(z[number]))):.3f}   mean {np.mean(z[number]):+.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if sys.argv[1:] else 300, float(sys.argv[2]) if sys.argv[2:] else 1e5)
