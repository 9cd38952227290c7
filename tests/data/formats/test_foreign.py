"""Files of formats that gonio does not read are named as what they are, and not as faulty CSV."""

import io
import json
import zipfile

import numpy as np
import pytest

from gonio.data.formats.foreign import UTIA_BYTES, foreign_kind
from gonio.data.formats.registry import read
from gonio.models.errors import GonioError


def archive(name):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as file:
        file.writestr(name, "x")
    return content.getvalue()


def npz():
    content = io.BytesIO()
    np.savez(content, theta_i=np.zeros(3))
    return content.getvalue()


FILES = {
    "JSON": json.dumps({"head": {}, "rows": [[1, 2], [3, 4]]}).encode(),
    "NumPy archive": npz(),
    "Excel": archive("[Content_Types].xml"),
    "ZIP": archive("a.txt"),
    "XML": b'<?xml version="1.0"?>\n<brdf/>\n',
    "HTML": b"<!DOCTYPE html><html>",
    "Zemax": b"# a comment, theta, phi\nSource  Measured\nSymmetry  PlaneSymmetrical\n",
    "LightTools": b"Source Measured\nScatterAzimuth 2\n0 90\nScatterRadial 1\n0\nDataBegin\nAOI 10\nPOI 0\n",
    "MATLAB": b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + bytes(90),
    "UTIA": bytes(UTIA_BYTES),
    "OpenEXR": b"v/1\x01" + bytes(40),
}


@pytest.mark.parametrize("kind", FILES)
def test_a_foreign_file_is_named(tmp_path, kind):
    (tmp_path / "t.dat").write_bytes(FILES[kind])
    with pytest.raises(GonioError, match=f"{kind}.*export its readings as CSV") as error:
        read(tmp_path / "t.dat")
    assert "\n" not in str(error.value)


def test_a_table_of_text_is_not_foreign():
    for text in (b"theta_i,phi_i,theta_o,phi_o,f\n1,2,3,4,5\n", b"# measured to ASTM E2387\ntheta_i\n", b"0.1,0.2\n"):
        assert foreign_kind(text, len(text)) is None
