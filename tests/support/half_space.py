"""A half space by Monte Carlo: where light leaves that came in as a narrow beam along the normal. Lengths: 1/σt."""

import numpy as np


def fresnel(cosine, eta):
    """Reflectance from within a medium of index eta."""
    sine2 = eta**2 * (1 - cosine**2)
    outside = np.sqrt(np.maximum(1 - sine2, 0.0))
    s = (eta * cosine - outside) / (eta * cosine + outside)
    p = (cosine - eta * outside) / (cosine + eta * outside)
    return np.where(sine2 < 1, (s**2 + p**2) / 2, 1.0)


def scattered_cosine(rng, g, n):
    """Of Henyey and Greenstein."""
    u = rng.random(n)
    if g == 0:
        return 2 * u - 1
    return (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)


def turned(rng, x, y, z, cosine):
    """The directions turned by angles of these cosines, at random azimuths."""
    phi = 2 * np.pi * rng.random(z.size)
    sine = np.sqrt(np.maximum(1 - cosine**2, 0.0))
    a, b = sine * np.cos(phi), sine * np.sin(phi)
    sign = np.where(z >= 0, 1.0, -1.0)  # an orthonormal frame without a pole [Duff et al. 2017]
    c = -1 / (sign + z)
    d = x * y * c
    new = (
        a * (1 + sign * x * x * c) + b * d + cosine * x,
        a * sign * d + b * (sign + y * y * c) + cosine * y,
        -a * sign * x - b * y + cosine * z,
    )
    length = np.sqrt(sum(v * v for v in new))
    return tuple(v / length for v in new)


def leaving_light(albedo, photons, seed, g=0.0, eta=1.0, least=1e-4):
    """(distances, weights) of the light that leaves, per unit of light that passed the surface.

    Absorption by weights, Russian roulette below `least`, reflection from within by splitting off what leaves.
    """
    rng = np.random.default_rng(seed)
    px, py, depth = np.zeros(photons), np.zeros(photons), np.zeros(photons)
    x, y, z = np.zeros(photons), np.zeros(photons), np.ones(photons)  # z: down
    weight = np.full(photons, 1.0 / photons)
    floor, distances, weights = least / photons, [], []
    while weight.size:
        step = -np.log1p(-rng.random(weight.size))
        up = z < 0
        to_surface = np.where(up, depth / np.where(up, -z, 1.0), np.inf)
        out = to_surface < step
        move = np.where(out, to_surface, step)
        px, py, depth = px + move * x, py + move * y, np.where(out, 0.0, depth + move * z)
        if out.any():
            back = fresnel(-z[out], eta)
            distances.append(np.hypot(px[out], py[out]))
            weights.append(weight[out] * (1 - back))
            weight[out] *= back
            z[out] = -z[out]
        inside = ~out
        weight[inside] *= albedo
        turned_to = turned(rng, x[inside], y[inside], z[inside], scattered_cosine(rng, g, int(inside.sum())))
        x[inside], y[inside], z[inside] = turned_to
        faint = weight < floor
        weight[faint] = np.where(rng.random(int(faint.sum())) < 0.1, weight[faint] * 10, 0.0)
        alive = weight > 0
        px, py, depth, x, y, z, weight = (v[alive] for v in (px, py, depth, x, y, z, weight))
    return np.concatenate(distances), np.concatenate(weights)


def total_with_error(albedo, photons, seed, batches=10, **options):
    """(total, its standard error, shares beyond 1, 3, 10 and 30 mean free paths with theirs)."""
    rows = []
    for k in range(batches):
        r, w = leaving_light(albedo, photons // batches, [seed, k], **options)
        rows.append([w.sum(), *(w[r > d].sum() for d in (1, 3, 10, 30))])
    rows = np.array(rows)
    mean = rows.mean(0)
    error = rows.std(0, ddof=1) / np.sqrt(batches)
    return mean[0], error[0], mean[1:] / mean[0], error[1:] / mean[0]
