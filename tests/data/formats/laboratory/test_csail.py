"""CSAIL's anisotropic files: made here plane by plane from a closed form at the centres or edges of bins."""

import numpy as np
import pytest

from gonio.data.formats.registry import read
from gonio.models.errors import GonioError
from support.closed_form import anisotropic, largest_error, vector


def made(path, counts=(3, 4, 8, 5), half=0, shift=0.5):
    spans = (np.pi / 2, np.pi / 2, np.pi if half else 2 * np.pi, 2 * np.pi)
    axes = [(np.arange(n) + shift) / n * span for n, span in zip(counts, spans, strict=True)]
    theta_i, theta_o, difference, phi_i = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
    f = anisotropic(vector(theta_i, phi_i), vector(theta_o, phi_i + difference))
    planes = np.stack([f, 2 * f, 3 * f]).astype("<f4")
    planes[:, 7] = -1
    header = np.zeros(16, "<i4")
    header[:4], header[6], header[9], header[10] = counts, 1, half, 3
    path.write_bytes(header.tobytes() + planes.tobytes())
    return path


@pytest.mark.parametrize("half", [0, 1])
@pytest.mark.parametrize(("nodes", "shift"), [("centre", 0.5), ("lower", 0.0)])
def test_every_number_is_where_its_directions_are_and_negative_means_not_measured(tmp_path, half, nodes, shift):
    options = {} if nodes == "centre" else {"nodes": nodes}
    table = read(made(tmp_path / "brushed.bin", half=half, shift=shift), **options)
    assert table.layout.name == "turned" and table.counts()["not_measured"] == 3
    for k in range(3):
        assert largest_error(table, lambda wi, wo, k=k: (k + 1) * anisotropic(wi, wo), k) < 1e-6
    assert bool(table.layout.mirrored_axes) == bool(half)


def test_a_header_that_does_not_fit_its_file_is_refused(tmp_path):
    path = made(tmp_path / "brushed.bin")
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(GonioError, match="claims 3 × 4 × 8 × 5 bins"):
        read(path)
