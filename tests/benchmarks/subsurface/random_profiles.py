"""Verdicts and bounds on profiles of light below the surface whose truth is known.

    python random_profiles.py [PROFILES [FIRST]]     (150 0)

Each is read at random offsets by spots of random radii, some with noise, some too bright or brighter on one side. A
verdict is WRONG where it fails what holds or passes what does not; a bound misses where the light is beyond it.
"""

import collections
import dataclasses
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import gonio  # noqa: E402
from gonio.data.profile import Profile  # noqa: E402
from gonio.instrument.offsets_scan import measure_profile  # noqa: E402


def expression(rng: np.random.Generator) -> tuple[str, float]:
    """A random material, and the index of its surface."""
    name, eta = str(rng.choice(["dipole", "better_dipole", "normalised_diffusion"])), rng.uniform(1, 1.6)
    if name == "normalised_diffusion":
        return f"{name}(albedo={rng.uniform(0.3, 0.99):.4f}, mfp={10 ** rng.uniform(-1, 0.7):.4f})", 1.0
    sigma_a, sigma_s = 10 ** rng.uniform(-3, 0), 10 ** rng.uniform(-0.5, 1)
    return f"{name}(sigma_a={sigma_a:.5f}, sigma_s={sigma_s:.4f}, eta={eta:.3f})", eta


def offsets_of(rng: np.random.Generator) -> np.ndarray:
    count, farthest = int(rng.integers(4, 25)), 10 ** rng.uniform(-0.5, 1.5)
    even = np.linspace(0, farthest, count + 1)[1:]
    side = even if rng.random() < 0.5 else farthest * np.sort(10 ** rng.uniform(-2, 0, count))
    parts = [[-side[::-1], [0.0], side], [[0.0], side], [side]]
    return np.concatenate([np.asarray(a, float) for a in parts[int(rng.choice(3, p=[0.6, 0.2, 0.2]))]])


def random_profile(seed: int) -> tuple[str, float, bool, Profile]:
    """A material, its light as it leaves along the normal, whether places may be exchanged, and the profile."""
    rng = np.random.default_rng([41, seed])
    what, eta = expression(rng)
    surface = (1 - ((eta - 1) / (eta + 1)) ** 2) ** 2
    light = surface * float(np.max(np.asarray(gonio.material(what).brdf.bssrdf.total())))
    lit = 10 ** rng.uniform(-2, 0)
    spots = {"illuminated_radius": lit, "viewed_radius": lit * float(rng.choice([0.5, 1, 2]))}
    offsets = offsets_of(rng)
    read = measure_profile(what, gonio.Instrument(**spots), offsets)
    factor = float(rng.choice([1, 1, 1.3, 2]))
    more = 0.3 if rng.random() < 0.25 and (offsets < 0).any() else 0.0
    value = factor * np.where(offsets < 0, 1 + more, 1.0)[:, None] * read.value
    u = rng.uniform(0.002, 0.1) * value if rng.random() < 0.6 else np.full(value.shape, np.nan)
    value = value + np.nan_to_num(u) * rng.standard_normal(value.shape)
    return what, factor * (1 + more / 2) * light, not more, dataclasses.replace(read, value=value, u=u)


def main(profiles: int, first: int) -> None:
    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    for seed in range(first, first + profiles):
        what, light, exchanged, profile = random_profile(seed)
        certificate = gonio.check(profile)
        for name, holds in {"energy": light <= 1, "reciprocity": exchanged, "positivity": True}.items():
            verdict = certificate[name].verdict
            right = {"pass": holds, "fail": not holds}.get(verdict)
            counts[name, verdict if right is None else "right" if right else "WRONG"] += 1
            if right is False:
                print(
                    f"WRONG {seed} {what}: light {light:.4f}: {name} {verdict}: {certificate[name].detail}", flush=True
                )
        energy = certificate["energy"]
        if energy.residual is not None and energy.bound is not None:
            off = abs(energy.residual + 1 - light) / energy.bound
            counts["bound", "holds" if off <= 1 else "misses"] += 1
            if off > 1:
                print(f"misses {seed} {what}: light {light:.4f} is {off:.2f} bounds away", flush=True)
    for (name, outcome), number in sorted(counts.items()):
        print(f"{name:<14}{outcome:<14}{number:6}")


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:3]]
    main(*(numbers + [150, 0][len(numbers) :]))
