"""Checks of a sheet's BSDF in patches, a file of windows: its hemispherical values, and its exchanged directions."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from gonio.checks.albedos import Albedos
from gonio.checks.direction_search import directions, values
from gonio.checks.table.albedos.two_sided import REFLECTED, TRANSMITTED
from gonio.checks.table.pairs.pairs import Pairs
from gonio.data.interpolation.scattering_blocks import BLOCKS, ScatteringBlock, SheetBSDF, pair_of

POINTS = 8
"""Places in each patch at which the exchanged directions are read."""
MOST_PATCHES = 200_000
"""Of more patches so many are compared, chosen at random."""
METHOD = "Summed over the file's own patches, in each of which f is constant."


def sheet_albedos(bsdf: SheetBSDF, channels: Sequence[str]) -> Albedos:
    """R + T for light on each side, at the file's own incidences; exact by the file's own rule.

    Where a channel lacks a block its sum is of the other alone, and the method names what was not looked at.
    """
    lit = [_of_side(bsdf, side) for side in ("front", "back") if any(_blocks(bsdf, side))]
    theta, phi, total, shares = (np.concatenate(a) for a in zip(*lit, strict=True))
    nothing, never = np.zeros(total.shape), np.zeros(len(total), bool)
    both = {name: shares[:, :, k] for k, name in enumerate((REFLECTED, TRANSMITTED))}
    known = {name: share for name, share in both.items() if np.isfinite(share).any()}
    method = METHOD + _left_out(bsdf, channels)
    unknown = np.full(len(total), np.nan)
    return Albedos(theta, phi, total, nothing, nothing, method, (), nothing, never, unknown, never, shares=known)


def sheet_albedos_by_side(bsdf: SheetBSDF, channels: Sequence[str]) -> dict[tuple[int, int], Albedos | str]:
    """Reflectances and transmittances apart, by the sides of light and detector, of the blocks that the file has."""
    total, made = sheet_albedos(bsdf, channels), {}
    for light, lit in ((1, total.theta_i < np.pi / 2), (-1, total.theta_i > np.pi / 2)):
        for name, detector in ((REFLECTED, light), (TRANSMITTED, -light)):
            share = total.shares.get(name, np.full(total.value.shape, np.nan))[lit]
            known = np.isfinite(share).all(axis=1)
            if known.any():
                theta = np.minimum(total.theta_i, np.pi - total.theta_i)[lit][known]
                nothing, never = np.zeros(share[known].shape), np.zeros(theta.size, bool)
                made[light, detector] = dataclasses.replace(
                    total, theta_i=theta, phi_i=total.phi_i[lit][known], value=share[known], above=nothing,
                    below=nothing, noise=nothing, unseen=never, partial=never, shares={},
                    step_needed=np.full(theta.size, np.nan),
                )  # fmt: skip
    return made


def _left_out(bsdf: SheetBSDF, channels: Sequence[str]) -> str:
    """A sentence that names the blocks that the file lacks, and of which channels; nothing for a whole file."""
    lacking = {name: [c for c, b in zip(channels, bsdf.blocks[name], strict=True) if b is None] for name in BLOCKS}
    texts = [
        name if len(without) == len(channels) else f"{name} of {', '.join(without)}"
        for name, without in lacking.items()
        if without
    ]
    return f" The file lacks, so that it was not looked at: {'; '.join(texts)}." if texts else ""


def _blocks(bsdf: SheetBSDF, side: str) -> list[ScatteringBlock]:
    return [b for name in (f"reflection {side}", f"transmission {side}") for b in bsdf.blocks[name] if b is not None]


def _of_side(bsdf: SheetBSDF, side: str) -> tuple[np.ndarray, ...]:
    """(theta_i, phi_i) (n,), R + T (n, channels), both apart (n, channels, 2) of the finest incidences of a side."""
    arriving = max((b.incidences() for b in _blocks(bsdf, side)), key=len)
    unread = np.full(len(arriving), np.nan)
    shares = np.stack(
        [
            np.stack([unread if b is None else b.share(arriving) for b in bsdf.blocks[f"{kind} {side}"]], axis=-1)
            for kind in ("reflection", "transmission")
        ],
        axis=-1,
    )
    theta = arriving[:, 0] if side == "front" else np.pi - arriving[:, 0]
    return theta, (arriving[:, 1] + np.pi) % (2 * np.pi), np.nansum(shares, axis=-1), shares


def sheet_pairs(bsdf: SheetBSDF) -> Pairs:
    """The patches, and the mean of the exchanged directions over each: half their range is the error."""
    rng = np.random.default_rng(0)
    blocks: list[tuple[np.ndarray, ...]] = []
    for name in BLOCKS:
        for channel, block in enumerate(bsdf.blocks[name]):
            if block is not None:
                blocks.append(_exchanged(bsdf, block, name, channel, rng))
    a, b, error, angles = (np.concatenate(column) for column in zip(*blocks, strict=True))
    unknown = np.full_like(a, np.nan)
    how = "patches of the file, exchanged by its own rule"
    return Pairs.of_arrays((a, b, unknown, unknown), angles, len(a), how, error)


def _exchanged(
    bsdf: SheetBSDF, block: ScatteringBlock, name: str, channel: int, rng: np.random.Generator
) -> tuple[np.ndarray, ...]:
    """a, b and its error (n, channels), NaN but in this channel, and angles (n, 4)."""
    middle = block.samples()
    keep = np.arange(len(middle.f))
    if keep.size > MOST_PATCHES:
        keep = np.sort(rng.choice(keep.size, MOST_PATCHES, replace=False))
    back = []
    for _ in range(POINTS):
        places = block.within(rng.random((len(middle.f), 4)))
        wi, wo = pair_of(name, places.arriving[keep], places.leaving[keep])
        back.append(values(bsdf, directions(*wo), directions(*wi))[:, channel])
    wi, wo = pair_of(name, middle.arriving[keep], middle.leaving[keep])
    shape = keep.size, len(bsdf.blocks[name])
    a, b, error = (np.full(shape, np.nan) for _ in range(3))
    a[:, channel], b[:, channel] = middle.f[keep], np.mean(back, axis=0)
    size = np.maximum(np.abs(a[:, channel]) + np.abs(b[:, channel]), 1e-300)
    error[:, channel] = np.ptp(back, axis=0) / size
    return a, b, error, np.stack([*wi, *wo], axis=-1)
