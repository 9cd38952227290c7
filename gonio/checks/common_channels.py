"""Which channels of a subject and of what it is compared with are the same: by wavelength, by name, or by place."""

import numpy as np

from gonio.data.channels import Channels
from gonio.models.display import listed
from gonio.models.errors import GonioError

SAME_NM = 1.0
"""Wavelengths that are nearer are one, nm: 632.8 is called 633."""


def common_channels(judged: Channels, reference: Channels) -> list[tuple[int, int]] | None:
    """Numbers of the same channels in both, in the order of the reference; None where neither tells, so by place.

    Raises GonioError where both state their wavelengths, and have none in common.
    """
    if judged.wavelengths_nm is not None and reference.wavelengths_nm is not None:
        pairs = _by_wavelength(np.array(judged.wavelengths_nm), np.array(reference.wavelengths_nm))
        # Several channels of one wavelength differ by their names.
        if (
            pairs
            and len({*judged.wavelengths_nm}) == len(judged)
            and len({*reference.wavelengths_nm}) == len(reference)
        ):
            return pairs
        if not pairs:
            raise GonioError(
                f"the channels are of {listed(judged.names)}, those of the reference of {listed(reference.names)}:"
                " none is the same; compare readings of the same wavelengths"
            )
    by_name = [(judged.names.index(name), k) for k, name in enumerate(reference.names) if name in judged.names]
    return by_name or None


def _by_wavelength(judged: np.ndarray, reference: np.ndarray) -> list[tuple[int, int]]:
    apart = np.abs(judged[:, None] - reference)
    nearest = [(int(np.argmin(apart[:, k])), k) for k in range(reference.size)]
    return [(j, k) for j, k in nearest if apart[j, k] < SAME_NM and int(np.argmin(apart[j])) == k]


def without_partner(names: tuple[str, ...], numbers: set[int]) -> str:
    """A sentence on channels that the reference lacks; nothing where it has all."""
    alone = [name for k, name in enumerate(names) if k not in numbers]
    return f" The reference has no {listed(alone)}: undecided there." if alone else ""
