"""XML files of sheets, written as WINDOW and Radiance write them."""

import numpy as np

from gonio.data.interpolation.angle_basis import KLEMS_BASES

QUARTER = KLEMS_BASES[2]
TAG = "WindowElement"


def document(
    blocks, structure="Columns", wavelength="Visible", head='<?xml version="1.0" encoding="UTF-8"?>\n', more=""
):
    """A file of blocks {direction: the text of its scattering data}; matrices over the Quarter basis."""
    basis = (
        "<AngleBasis>LBNL/Shirley-Chiu</AngleBasis>"
        if structure.startswith("Tensor")
        else f"<ColumnAngleBasis>{QUARTER.name}</ColumnAngleBasis><RowAngleBasis>{QUARTER.name}</RowAngleBasis>"
    )
    data = "".join(
        f'<WavelengthData><Wavelength unit="Integral">{wavelength}</Wavelength><WavelengthDataBlock>'
        f"<WavelengthDataDirection>{direction}</WavelengthDataDirection>{basis}"
        f"<ScatteringData>{text}</ScatteringData></WavelengthDataBlock></WavelengthData>"
        for direction, text in blocks.items()
    )
    return (
        f'{head}<{TAG} xmlns="http://windows.lbl.gov"><WindowElementType>System</WindowElementType><Optical><Layer>'
        "<Material><Name>sheet</Name><Manufacturer>tests</Manufacturer></Material><DataDefinition>"
        f"<IncidentDataStructure>{structure}</IncidentDataStructure>{more}</DataDefinition>{data}</Layer></Optical></{TAG}>"
    )


def numbers(values):
    """The text of scattering data, to all digits."""
    return ",\n".join(repr(float(v)) for v in np.ravel(values))


def scattering(seed, strength):
    """f[leaving, arriving] over the Quarter basis, (41, 41): a lobe about the diagonal, its largest sum `strength`."""
    theta, phi = QUARTER.centres()
    x, y = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
    rng = np.random.default_rng(seed)
    lobe = np.exp(-rng.uniform(1, 4) * ((x[:, None] - x) ** 2 + (y[:, None] - y) ** 2))
    return strength * lobe / (QUARTER.projected_solid_angles() @ lobe).max()
