"""Mueller matrices made here of Jones matrices: mixtures of these, on grids reciprocal and mirror symmetric."""

import dataclasses

import numpy as np

import gonio
from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.table import Table, whole_table_of_values

NAMES = [f"m{r}{c}" for r in range(4) for c in range(4)]
THETA, PHI = np.radians(np.arange(10, 81, 10)), np.radians(np.arange(0, 360, 30))
# Rows: total, s − p, +45° − −45°, and circular intensity by the products of the fields ss*, sp*, ps*, pp*.
STOKES = np.array([[1, 0, 0, 1], [1, 0, 0, -1], [0, 1, 1, 0], [0, 1j, -1j, 0]])


def of_jones(jones: np.ndarray) -> np.ndarray:
    """(..., 4, 4) of (..., 2, 2)."""
    product = np.einsum("...ab,...cd->...acbd", jones, jones.conj()).reshape(*jones.shape[:-2], 4, 4)
    return np.real(STOKES @ product @ np.linalg.inv(STOKES))


def mixtures(rng: np.random.Generator, n: int, terms: int = 3) -> np.ndarray:
    """(n, 16) of random Jones matrices, in units of their first element."""
    jones = rng.normal(size=(terms, n, 2, 2)) + 1j * rng.normal(size=(terms, n, 2, 2))
    made = of_jones(jones).sum(axis=0).reshape(n, 16)
    return made / made[:, :1]


def surface(seed: int, theta_i: np.ndarray, theta_o: np.ndarray, phi: np.ndarray, terms: int = 3) -> np.ndarray:
    """(..., 16) of a random isotropic surface, 1/sr: σ A(θo)ᵀ σ S(Δφ) A(θi) summed over several, reciprocal for
    Q = diag(1, 1, −1, 1)."""
    rng, sigma = np.random.default_rng(seed), np.diag([1.0, -1.0])
    total = np.zeros((*theta_i.shape, 4, 4))
    for _ in range(terms):
        a = rng.normal(size=(2, 2, 2)) + 1j * rng.normal(size=(2, 2, 2))
        a[:, [0, 1], [1, 0]] = 0.0
        light, detector = (a[0] + a[1] * np.cos(t)[..., None, None] for t in (theta_i, theta_o))
        b, d = rng.normal(size=2)
        turn = np.zeros((*phi.shape, 2, 2), complex)
        turn[..., 0, 0], turn[..., 1, 1] = 1.0, d * np.cos(phi) + 1j
        turn[..., 0, 1] = turn[..., 1, 0] = b * np.sin(phi)
        total += of_jones(sigma @ np.swapaxes(detector, -1, -2) @ sigma @ turn @ light)
    return 0.1 * (total / total[..., 0, 0].max()).reshape(*theta_i.shape, 16)


def grid_of(values: np.ndarray, names: list[str], u_f: np.ndarray | None = None) -> Table:
    """A table of THETA, THETA, PHI."""
    table = whole_table_of_values(layouts.isotropic(THETA, THETA, PHI), values, Channels(tuple(names)))
    if u_f is not None:
        table = dataclasses.replace(table, u_f=np.broadcast_to(u_f, table.shape).copy())
    return table


def list_of(values: np.ndarray, names: list[str], u_f: np.ndarray | None = None) -> Table:
    """The same as a list of readings."""
    theta_i, theta_o, phi = (a.ravel() for a in np.meshgrid(THETA, THETA, PHI, indexing="ij"))
    u = None if u_f is None else np.broadcast_to(u_f, values.shape).reshape(theta_i.size, -1)
    f = values.reshape(theta_i.size, -1)
    return gonio.Table.from_arrays(theta_i, 0, theta_o, phi, f, u_f=u, channels=names)


def on_grid(seed: int, terms: int = 3) -> np.ndarray:
    """A random surface on THETA, THETA, PHI: (8, 8, 12, 16)."""
    return surface(seed, *np.meshgrid(THETA, THETA, PHI, indexing="ij"), terms=terms)
