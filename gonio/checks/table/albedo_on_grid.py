"""Directional albedos of tables on a grid of polar angles and azimuths (spherical, isotropic), with their bounds.

∫ f cosθ dω by product rules exact for what is linear between the nodes. The bound is the sum of what the grid may have
missed between its nodes (`grid_resolution`), of the cap and the rim beyond its outermost nodes, of the cells
without a reading, and of the noise.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from gonio.checks.grid_resolution import LARGEST, RESOLVED, excess, hat_weights, log_values, periodic_weights, surprise
from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.data.table import Table

FLOOR = 1e-3
"""What is below this share of the mean of f cosθ is not asked whether the grid resolves it; it counts as bound."""

WIDEST_GAP = np.radians(46.0)
"""Largest step in azimuth, and the largest polar angle that may be missing at the rim is 30°."""

MOST_MISSING = 0.2
"""Share of the hemisphere's projected solid angle without readings beyond which there is no albedo."""


@dataclasses.dataclass
class Albedos:
    """Directional albedos (n, channels) of n incidences; how much larger and smaller they may be; what was done."""

    theta_i: np.ndarray
    phi_i: np.ndarray
    value: np.ndarray
    above: np.ndarray
    below: np.ndarray
    noise: np.ndarray
    """Standard uncertainty that the readings' own make."""
    unseen: np.ndarray
    """Whether the readings of an incidence leave out the mirror direction, so that a narrow lobe may hide there."""
    method: str
    why_not: str = ""
    """Where nothing could be integrated: why."""
    step_needed: np.ndarray | None = None
    """(n,): about the step, radians, at which a lobe such as the readings suggest would be resolved; NaN: unknown."""


def no_albedo(why: str) -> Albedos:
    """The answer of a table that cannot be integrated."""
    nothing = np.zeros((0, 1))
    return Albedos(np.zeros(0), np.zeros(0), *[nothing] * 4, np.zeros(0, bool), "", why)


def grid_albedos(table: Table, reach: float) -> Albedos:
    """Albedos at every incidence of a spherical or isotropic table.

    `reach`, radians: how near to the mirror direction a node has to be for no lobe to hide there.
    """
    grid = hemisphere_grid(table.layout)
    if isinstance(grid, str):
        return no_albedo(grid)
    theta_o, azimuth, incidences = grid.theta_o, grid.azimuth, grid.incidences
    cells = grid.inner[0] * grid.inner[1]
    inner = (*grid.inner, len(table.channels))
    out = []
    for *_, k in incidences:
        block = table.read(k * cells, (k + 1) * cells)
        f, u, flag = (a.reshape(inner)[grid.rows][:, grid.source] for a in (block.f, block.u_f, block.flag))
        out.append(_one(f.astype(float), u.astype(float), flag == Flag.VALID, theta_o, azimuth))
    found = [k for k, o in enumerate(out) if o is not None]
    if not found:
        return no_albedo("too many of its cells have no reading")
    value, bound, noise = (np.stack([out[k][j] for k in found]) for j in range(3))
    needed = np.array([out[k][3] for k in found])
    theta, phi = (np.array([incidences[k][j] for k in found]) for j in (0, 1))
    unseen = np.array([_distance_to_mirror(t, p, theta_o, azimuth) > reach for t, p in zip(theta, phi, strict=True)])
    above = np.where(unseen[:, None], np.inf, bound)
    method = "Integrated on the table's own grid"
    if grid.fold:
        method += ", taking the surface as mirror symmetric, as azimuth differences stop at 180°"
    return Albedos(theta, phi, value, above, bound, noise, unseen, method + ".", step_needed=needed)


class HemisphereGrid(NamedTuple):
    """Where the directions of one incidence lie, once around the normal, and the incidences there are."""

    inner: tuple[int, int]
    """Polar angles and azimuths of the cells of one incidence, as stored."""
    rows: np.ndarray
    """Those polar angles that are above the horizon, and"""
    source: np.ndarray
    """for each azimuth the column that it comes from."""
    theta_o: np.ndarray
    azimuth: np.ndarray
    fold: bool
    incidences: list
    """(theta_i, phi_i, number) of each."""


def hemisphere_grid(layout: Layout) -> HemisphereGrid | str:
    """The directions of a spherical or isotropic layout, or why they do not cover the hemisphere."""
    outgoing = layout.outgoing_grid()
    if outgoing is None:
        return "its directions are not those of one grid at every incidence"
    theta_i, phi_i, theta_o, phi_o = outgoing
    fold = bool(layout.mirrored_axes)
    inner = (theta_o.size, phi_o.size)
    rows = np.flatnonzero(theta_o < np.pi / 2 - 1e-9)
    theta_o = theta_o[rows]
    azimuth, source = _closed(phi_o, fold)
    if theta_o.size < 3 or theta_o[-1] < np.radians(60) or np.ptp(azimuth) == 0:
        return "its directions do not cover the hemisphere"
    if np.diff(np.append(azimuth, azimuth[0] + 2 * np.pi)).max() > WIDEST_GAP or theta_o[0] > np.radians(30):
        return "its directions leave a gap in the hemisphere"
    incidences = [
        (t, p, i * phi_i.size + j) for i, t in enumerate(theta_i) for j, p in enumerate(phi_i) if t < np.pi / 2 - 1e-9
    ]
    return HemisphereGrid(inner, rows, source, theta_o, azimuth, fold, incidences)


def weights_of(grid: HemisphereGrid) -> np.ndarray:
    """Projected solid angle of each direction, sr, shape (theta_o, azimuth, 1): exact for what is linear between."""
    return _weights(grid.theta_o, grid.azimuth)


def _closed(phi: np.ndarray, fold: bool) -> tuple[np.ndarray, np.ndarray]:
    # Azimuths once around, increasing, and the column that each comes from.
    if not fold:
        last = phi[-1] - phi[0] >= 2 * np.pi - 1e-9
        return (phi[:-1], np.arange(phi.size - 1)) if last else (phi, np.arange(phi.size))
    back = 2 * np.pi - phi
    both, column = np.concatenate([phi, back]), np.tile(np.arange(phi.size), 2)
    _, first = np.unique(np.round(np.mod(both, 2 * np.pi), 9), return_index=True)
    angles = np.mod(both[first], 2 * np.pi)
    order = np.argsort(angles)
    return angles[order], column[first][order]


def _distance_to_mirror(theta_i, phi_i, theta_o, azimuth):
    cos = np.cos(theta_o[:, None]) * np.cos(theta_i) + np.sin(theta_o[:, None]) * np.sin(theta_i) * np.cos(
        azimuth - phi_i - np.pi
    )
    return np.arccos(np.clip(cos.max(), -1, 1))


def _one(f, u, valid, theta, azimuth):
    weight = _weights(theta, azimuth)
    if np.max(np.sum(weight * ~valid, axis=(0, 1))) > MOST_MISSING * np.pi:
        return None
    f = np.where(valid, f, 0.0)
    whole = filled(f, valid)
    value = np.sum(weight * whole, axis=(0, 1))
    u = np.where(valid & np.isfinite(u), u, 0.0)
    noise = np.sqrt(np.sum((weight * u) ** 2, axis=(0, 1)))
    floor = np.maximum(FLOOR * np.abs(value) / np.pi, 1e-300)
    # A negative reading has no logarithm: its place takes its neighbours', and the difference counts as bound.
    shown = filled(np.where(whole < 0, 0.0, whole), valid & (f >= 0))
    logs = log_values(shown, floor)
    relative = u / np.maximum(shown, floor)
    surprises = [_across_the_pole(logs, theta, azimuth), surprise(logs, azimuth, 1, 2 * np.pi)]
    missed = np.sum(weight * excess(shown, floor, surprises, relative), axis=(0, 1))
    missed += np.max([np.abs(_every_second(whole, theta, azimuth, *k) - value) for k in np.ndindex(2, 2)], axis=0)
    guessed = np.sum(weight * (np.where(valid, 0.0, np.abs(whole)) + np.abs(shown - whole)), axis=(0, 1))
    bound = missed + guessed + _beyond(whole, logs, theta, azimuth) + 2 * noise
    return value, bound, noise, _step_needed(shown, surprises, theta)


def _step_needed(f, surprises, theta):
    # Two limits on the width of the lobe, as if it were a Gaussian: nodes a step h apart surprise by h²/2w² along each
    # axis; and of a lobe that is no brighter than all light together, f cosθ 2π w² ≤ 1. Resolved where h ≤ w; half of
    # that, as what lies between the nodes is commonly narrower.
    total = np.minimum(sum(surprises), LARGEST)
    flux = f * np.cos(theta)[:, None, None]
    k = np.unravel_index(np.argmax(flux * np.expm1(total)), f.shape)
    step = np.median(np.diff(theta))
    by_slope = step * np.sqrt(RESOLVED / max(total[k], 1e-12))
    by_height = np.sqrt(1 / (2 * np.pi * max(flux.max(), 1e-12)))
    return min(by_slope, by_height) / 2


def _weights(theta, azimuth):
    w_theta = hat_weights(theta, 0.0, np.pi / 2, lambda t: np.sin(t) * np.cos(t))
    return w_theta[:, None, None] * periodic_weights(azimuth)[None, :, None]


def _every_second(f, theta, azimuth, row, column):
    # The sum over every second ring and azimuth; the outermost rings stay, so that only the resolution differs.
    rings = np.unique(np.concatenate([[0], np.arange(row, theta.size, 2), [theta.size - 1]]))
    sides = np.arange(column, azimuth.size, 2) if azimuth.size >= 8 else np.arange(azimuth.size)
    return np.sum(_weights(theta[rings], azimuth[sides]) * f[rings][:, sides], axis=(0, 1))


def _across_the_pole(logs, theta, azimuth):
    # On the other side of the normal the azimuths are turned by π: the innermost nodes have neighbours there.
    opposite = np.argmin(np.abs(np.mod(azimuth[None] - azimuth[:, None], 2 * np.pi) - np.pi), axis=1)
    first = 1 if theta[0] < 1e-9 else 0
    longer = np.concatenate([logs[first : first + 1][:, opposite], logs])
    return surprise(longer, np.append(-theta[first], theta), 0)[1:]


def filled(f: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """f, (theta_o, azimuth, channels), where a cell without a reading takes the nearest of its ring, or azimuth."""
    if valid.all():
        return f
    out, have = f.copy(), valid.copy()
    for axis in (1, 0):
        for step in range(1, f.shape[axis] // 2 + 1):
            for sign in (1, -1):
                if axis == 1:
                    there, value = np.roll(valid, sign * step, 1), np.roll(f, sign * step, 1)
                else:
                    there, value = _shifted(have, sign * step, False), _shifted(out, sign * step, 0.0)
                take = ~have & there
                out[take], have[take] = value[take], True
            if have.all():
                return out
    return out


def _shifted(a, step, fill):
    out = np.full_like(a, fill)
    if step > 0:
        out[step:] = a[:-step]
    else:
        out[:step] = a[-step:]
    return out


def _beyond(f, logs, theta, azimuth):
    # The cap inside the first node and the rim outside the last: held constant, and as wrong as the slope there says.
    around = periodic_weights(azimuth)[:, None]
    total = 0.0
    for edge, inner, gap, share in (
        (0, 1, theta[0], np.sin(theta[0]) ** 2 / 2),
        (-1, -2, np.pi / 2 - theta[-1], np.cos(theta[-1]) ** 2 / 2),
    ):
        slope = np.abs(logs[edge] - logs[inner]) / np.abs(theta[edge] - theta[inner])
        grown = np.maximum(np.expm1(np.minimum(slope * gap, 40.0)), 0.1 if gap > 1e-9 else 0.0)
        total = total + share * np.sum(around * np.abs(f[edge]) * grown, axis=0)
    return total
