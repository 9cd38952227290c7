"""Cells of a table that physics says are equal: the reciprocal one, and the mirror image."""

import dataclasses

import numpy as np

from gonio.data.flags import Flag
from gonio.data.layout import Layout
from gonio.data.table import Table

SAME = 1e-9
"""Angles of nodes that differ by less than this many radians are one."""

MOST_CELLS = 2_000_000
"""Cells of a larger table are drawn at random."""


@dataclasses.dataclass(frozen=True)
class Pairs:
    """Readings a and b, (n, channels), NaN where not valid, that should be equal; their uncertainties and places."""

    a: np.ndarray
    b: np.ndarray
    u_a: np.ndarray
    u_b: np.ndarray
    angles: np.ndarray
    """(n, 4): theta_i, phi_i, theta_o, phi_o of a, radians."""
    eligible: int
    """Cells that were asked for, with a partner or without."""


def find(axis: np.ndarray, angles: np.ndarray, period: float | None = None) -> np.ndarray:
    """Number of the node of an increasing axis at each angle (modulo the period), or −1 where there is none."""
    if period is not None:
        angles = np.mod(angles - axis[0] + SAME, period) + axis[0] - SAME
    at = np.clip(np.searchsorted(axis, angles), 1, max(axis.size - 1, 1))
    low, high = at - 1, np.minimum(at, axis.size - 1)
    nearest = np.where(np.abs(axis[low] - angles) <= np.abs(axis[high] - angles), low, high)
    return np.where(np.abs(axis[nearest] - angles) <= SAME, nearest, -1)


def folded(layout: Layout) -> bool:
    """Whether azimuth differences stop at π: the other half is its mirror image."""
    return layout.name == "isotropic" and layout.axes["delta_phi"][-1] <= np.pi + SAME


def one_light_azimuth(layout: Layout) -> bool:
    """Whether the light of a spherical grid stands at one azimuth: the surface is taken as isotropic."""
    return layout.name == "spherical" and layout.axes["phi_i"].size == 1


def reciprocal_nodes(layout: Layout) -> list[tuple[int, np.ndarray]] | None:
    """For each dimension of the partner: from which dimension of the cell, and by which map of node numbers.

    None where reciprocity is built into the layout, which stores one value for both.
    """
    ax, turn = layout.axes, 2 * np.pi
    if layout.name == "half_difference":
        if layout.phi_d_period < 6:
            return None
        same = [(k, np.arange(n)) for k, n in enumerate(layout.shape)]
        same[2] = (2, find(ax["phi_d"], ax["phi_d"] + np.pi, turn))
        return same
    if layout.name == "isotropic":
        back = ax["delta_phi"] if folded(layout) else -ax["delta_phi"]
        return [
            (1, find(ax["theta_i"], ax["theta_o"])),
            (0, find(ax["theta_o"], ax["theta_i"])),
            (2, find(ax["delta_phi"], back, turn)),
        ]
    swap = [
        (2, find(ax["theta_i"], ax["theta_o"])),
        (3, find(ax["phi_i"], ax["phi_o"], turn)),
        (0, find(ax["theta_o"], ax["theta_i"])),
        (1, find(ax["phi_o"], ax["phi_i"], turn)),
    ]
    if one_light_azimuth(layout):
        swap[1] = (1, np.arange(1))
        swap[3] = (3, find(ax["phi_o"], 2 * ax["phi_i"][0] - ax["phi_o"], turn))
    return swap


def mirrored_nodes(layout: Layout) -> list[tuple[int, np.ndarray]] | None:
    """As `reciprocal_nodes`, for both directions mirrored at a plane through the normal; None where built in."""
    ax, turn = layout.axes, 2 * np.pi
    same = [(k, np.arange(n)) for k, n in enumerate(layout.shape)]
    if layout.name == "half_difference":
        same[2] = (2, find(ax["phi_d"], -ax["phi_d"], layout.phi_d_period))
        if "phi_h" in ax:
            same[3] = (3, find(ax["phi_h"], -ax["phi_h"], turn))
        return same
    if layout.name == "isotropic" and not folded(layout):
        same[2] = (2, find(ax["delta_phi"], -ax["delta_phi"], turn))
        return same
    if layout.name == "spherical":
        axis = ax["phi_i"][0]
        same[1] = (1, find(ax["phi_i"], 2 * axis - ax["phi_i"], turn))
        same[3] = (3, find(ax["phi_o"], 2 * axis - ax["phi_o"], turn))
        return same
    return None


def partner_cells(layout: Layout, cells: np.ndarray, nodes: list[tuple[int, np.ndarray]]) -> np.ndarray:
    """The partner's number of each cell, or −1 where the grid has none."""
    at = np.unravel_index(cells, layout.shape)
    if layout.name == "in_plane":
        return _in_plane_partner(layout, *at)
    moved = [table[at[source]] for source, table in nodes]
    there = np.all([m >= 0 for m in moved], axis=0)
    return np.where(there, np.ravel_multi_index([np.maximum(m, 0) for m in moved], layout.shape), -1)


def paired_cells(layout: Layout, cells: np.ndarray, turns: dict[str, float]) -> np.ndarray:
    """The cells whose azimuths, by axis, are further on by so many radians; −1 where the grid has none."""
    same = [(k, np.arange(n)) for k, n in enumerate(layout.shape)]
    for k, (name, nodes) in enumerate(layout.axes.items()):
        if name in turns:
            same[k] = (k, find(nodes, nodes + turns[name], 2 * np.pi))
    return partner_cells(layout, cells, same)


def _in_plane_partner(layout, i, o):
    theta_i, signed = layout.axes["theta_i"][i], layout.axes["theta_o"][o]
    light = find(layout.axes["theta_i"], np.abs(signed))
    detector = find(layout.axes["theta_o"], np.where(signed < 0, -theta_i, theta_i))
    return np.where((light >= 0) & (detector >= 0), light * layout.shape[1] + detector, -1)


def gathered(table: Table, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(f, u_f) of cells in any order, each (n, channels), float64; f is NaN where it is not valid."""
    order = np.argsort(cells, kind="stable")
    wanted = cells[order]
    f, u = (np.full((cells.size, len(table.channels)), np.nan) for _ in range(2))
    for start, stop in table.blocks():
        first, last = np.searchsorted(wanted, (start, stop))
        if first == last:
            continue
        block = table.read(start, stop)
        at, here = wanted[first:last] - start, order[first:last]
        f[here] = np.where(block.flag[at] == Flag.VALID, block.f[at], np.nan)
        u[here] = block.u_f[at]
    return f, u


def paired(table: Table, nodes: list[tuple[int, np.ndarray]], theta_max: float) -> Pairs:
    """The readings of a gridded table whose polar angles are below `theta_max`, each with its partner."""
    layout = table.layout
    cells = np.arange(layout.size)
    if cells.size > MOST_CELLS:
        cells = np.sort(np.random.default_rng(0).choice(cells.size, MOST_CELLS, replace=False))
    cells = cells[_inside(layout, cells, theta_max)]
    partner = partner_cells(layout, cells, nodes)
    # A cell that is its own partner says nothing; a pair counts once.
    use = (partner >= 0) & (partner > cells)
    eligible = int(np.count_nonzero(partner != cells))
    cells, partner = cells[use], partner[use]
    (a, u_a), (b, u_b) = gathered(table, cells), gathered(table, partner)
    return Pairs(a, b, u_a, u_b, angles_of(layout, cells), eligible)


def angles_of(layout: Layout, cells: np.ndarray) -> np.ndarray:
    """theta_i, phi_i, theta_o, phi_o, radians, of some cells: shape (n, 4)."""
    from gonio.data.layout import spherical_angles

    wi, wo = layout.directions_at(cells)
    return np.stack([*spherical_angles(*wi), *spherical_angles(*wo)], axis=-1)


def _inside(layout, cells, theta_max):
    wi, wo = layout.directions_at(cells)
    return np.minimum(wi.z, wo.z) > np.cos(theta_max)
