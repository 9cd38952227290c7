"""Directional albedos of half/difference tables: integrated over half vectors, at the table's own nodes of theta_h.

dωo = 4 cosθd dωh [Walter 2007, eq. 14]: lobes are narrow in theta_h alone, where the nodes are, and f is interpolated
in the other angles only, in which it is smooth.
"""

import numpy as np

from gonio.checks.grid_resolution import excess, hat_weights, log_values, surprise
from gonio.checks.table.albedo_on_grid import FLOOR, Albedos, no_albedo
from gonio.data.flags import Flag
from gonio.data.table import Table

AZIMUTHS = 180
"""Azimuths of the half vector, even."""

COARSER = 1.5
"""Factor on the change by every second node, which for smooth lobes is four times the error."""

MOST_VALUES = 60_000_000
"""Values of a table that are held in memory at once."""


def half_difference_albedos(table: Table, reach: float) -> Albedos:
    """Albedos at polar angles of incidence 0, 5, ... 85° (and azimuths 0, 45, 90, 135° where there is a phi_h)."""
    axes = table.layout.axes
    if why := why_not(table):
        return no_albedo(why)
    valid = np.asarray(table.flag[...]) == Flag.VALID
    f = np.where(valid, np.asarray(table.f[...], dtype=float), 0.0)
    u = np.zeros(1) if table.u_f is None else np.nan_to_num(np.where(valid, np.asarray(table.u_f[...], float), 0.0))
    period = table.layout.periods["phi_d"]
    typical = _one(axes, period, f, None, u, valid, np.radians(40.0), 0.0)
    if typical is None:
        return no_albedo("too many of its cells have no reading")
    floor = np.maximum(FLOOR * np.abs(typical[0]) / np.pi, 1e-300)
    off = excess(f, floor, _surprises(f, valid, floor, table), _relative(u, f, floor)) * valid
    found = [(t, p, _one(axes, period, f, off, u, valid, t, p)) for t, p in incidences(axes)]
    found = [(t, p, o) for t, p, o in found if o is not None]
    if not found:
        return no_albedo("too many of its cells have no reading")
    value, bound, noise = (np.stack([o[j] for *_, o in found]) for j in range(3))
    bound += COARSER * np.stack([_coarser(axes, period, f, u, valid, t, p, o[0]) for t, p, o in found])
    unseen = np.full(len(found), 2 * axes["theta_h"][0] > reach)
    above = np.where(unseen[:, None], np.inf, bound)
    method = "Integrated over half vectors at the table's own theta_h, interpolated in the other angles."
    angles = (np.array([o[k] for o in found]) for k in (0, 1))
    return Albedos(*angles, value, above, bound, noise, unseen, method)


def why_not(table: Table) -> str:
    """Why a table has no albedo; nothing if it has."""
    axes = table.layout.axes
    if table.layout.size * len(table.channels) > MOST_VALUES:
        return "it is too large to be integrated in memory"
    if axes["theta_h"].size < 4 or axes["theta_h"][-1] < np.radians(60) or axes["theta_d"].size < 4:
        return "its half vectors do not cover the hemisphere"
    return ""


def incidences(axes: dict) -> list[tuple[float, float]]:
    """(theta_i, phi_i), radians, at which albedos are integrated."""
    last = min(axes["theta_d"][-1], np.radians(85.0))
    theta = np.arange(0, np.degrees(last) + 1e-9, 5.0) * np.pi / 180
    azimuths = np.radians([0.0, 45.0, 90.0, 135.0]) if "phi_h" in axes else np.zeros(1)
    return [(t, p) for t in theta for p in azimuths]


def _relative(u, f, floor):
    return u / np.maximum(f, floor) if u.size > 1 else 0.0


def _surprises(f, valid, floor, table):
    # Where a neighbour has no reading it says nothing about its node.
    logs = np.where(valid, log_values(f, floor), np.nan)
    return [
        np.nan_to_num(surprise(logs, nodes, k, table.layout.periods[name]))
        for k, (name, nodes) in enumerate(table.layout.axes.items())
    ]


def _coarser(axes, period, f, u, valid, theta_i, phi_i, value):
    """The largest change of an albedo by every second node of one axis: of theta_h by either half."""
    changes = []
    for k, name in enumerate(axes):
        for first in (0, 1) if name == "theta_h" else (0,):
            if axes[name].size < 6:
                continue
            at = (slice(None),) * k + (slice(first, None, 2),)
            fewer = {**axes, name: axes[name][first::2]}
            rougher = _one(fewer, period, f[at], None, u[at] if u.size > 1 else u, valid[at], theta_i, phi_i)
            changes.append(np.full_like(value, np.inf) if rougher is None else np.abs(rougher[0] - value))
    return np.max(changes, axis=0)


def corners(axes: dict, period: float | None, theta_i: float, phi_i: float) -> tuple[np.ndarray, list]:
    """f cosθo dωo of each half vector, (theta_h, azimuths), and the cells to read f from: (indices, shares)."""
    theta_h = axes["theta_h"]
    phi_h = (np.arange(AZIMUTHS) + 0.5) * 2 * np.pi / AZIMUTHS
    sin_h, cos_h = np.sin(theta_h)[:, None], np.cos(theta_h)[:, None]
    c, s = np.cos(phi_h)[None], np.sin(phi_h)[None]
    x, y, z = np.sin(theta_i) * np.cos(phi_i), np.sin(theta_i) * np.sin(phi_i), np.cos(theta_i)
    along, across = x * c + y * s, -x * s + y * c
    # The light in the half vector's frame: turned back by phi_h, then by theta_h.
    d_x, d_z = along * cos_h - z * sin_h, along * sin_h + z * cos_h
    cos_o = 2 * d_z * cos_h - z
    up = (d_z > 0) & (cos_o > 0)
    theta_d = np.arctan2(np.hypot(d_x, across), d_z)
    places = [_bracket(axes["theta_d"], theta_d, None), _bracket(axes["phi_d"], np.arctan2(across, d_x), period)]
    if "phi_h" in axes:
        places.append(_bracket(axes["phi_h"], np.broadcast_to(phi_h, theta_d.shape), 2 * np.pi))
    w_h = hat_weights(theta_h, 0.0, np.pi / 2, np.sin)[:, None] * (2 * np.pi / AZIMUTHS)
    weight = np.where(up, w_h * 4 * d_z * cos_o, 0.0)
    row = np.broadcast_to(np.arange(theta_h.size)[:, None], weight.shape)
    found = []
    for corner in np.ndindex(*[2] * len(places)):
        at = (row, *(p[0][k] for p, k in zip(places, corner, strict=True)))
        found.append((at, np.prod([p[1][k] for p, k in zip(places, corner, strict=True)], axis=0)))
    return weight, found


def _one(axes, period, f, off, u, valid, theta_i, phi_i):
    weight, cells = corners(axes, period, theta_i, phi_i)
    weight = weight[..., None]
    total, error, variance, have = 0.0, 0.0, 0.0, 0.0
    for at, share in cells:
        w = share[..., None] * valid[at]
        have = have + w
        total = total + w * f[at]
        error = error + w * off[at] if off is not None else error
        variance = variance + (w * u[at]) ** 2 if u.size > 1 else 0.0
    known = have > 1e-12
    scale = np.where(known, have, 1.0)
    if np.max(np.sum(weight * ~known, axis=(0, 1))) > 0.2 * np.pi:
        return None
    value = np.sum(weight * total / scale, axis=(0, 1))
    # Where corners had no reading the others stood for them, as wrong as they may be.
    guessed = np.sum(weight * np.abs(total / scale) * np.clip(1 - have, 0, 1), axis=(0, 1))
    empty = np.sum(weight * ~known, axis=(0, 1)) * np.max(np.abs(total / scale * (weight > 0)), initial=0.0) * 0.05
    noise = np.sqrt(np.sum(weight**2 * variance / scale**2, axis=(0, 1)))
    noise = np.broadcast_to(noise, value.shape)
    return value, np.sum(weight * error / scale, axis=(0, 1)) + guessed + empty + 2 * noise, noise


def _bracket(nodes, x, period):
    if nodes.size == 1:
        zero = np.zeros(x.shape, int)
        return (zero, zero), (np.ones(x.shape), np.zeros(x.shape))
    if period is None:
        low = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
        t = np.clip((x - nodes[low]) / (nodes[low + 1] - nodes[low]), 0, 1)
        return (low, low + 1), (1 - t, t)
    x = nodes[0] + np.mod(x - nodes[0], period)
    low = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 1)
    high = (low + 1) % nodes.size
    stop = np.where(high == 0, nodes[0] + period, nodes[high])
    t = np.clip((x - nodes[low]) / (stop - nodes[low]), 0, 1)
    return (low, high), (1 - t, t)
