"""Files of formats that gonio does not read are named as what they are, and not as faulty CSV."""

import io
import json
import zipfile

import numpy as np
import pytest

from gonio.data.formats.foreign import foreign_kind
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
    "CxF": b'<?xml version="1.0" encoding="utf-8"?>\n<cc:CxF xmlns:cc="http://colorexchangeformat.com/CxF3-core"/>\n',
    "HTML": b"<!DOCTYPE html><html>",
    "Zemax": b"# a comment, theta, phi\nSource  Measured\nSymmetry  PlaneSymmetrical\n",
    "LightTools": b"Source Measured\nScatterAzimuth 2\n0 90\nScatterRadial 1\n0\nDataBegin\nAOI 10\nPOI 0\n",
    "MATLAB": b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + bytes(90),
    "ALTA": b"#DIM 6 1\n#PARAM_IN CARTESIAN\n#FORMAT binary\n#BEGIN_STREAM\n" + bytes(56),
    "MDL": b"NVIDIA ARC MBSDF V1\n" + bytes(40),
    "AxF": b"\x89HDF\r\n\x1a\n" + bytes(40) + b"com.xrite.Materials",
    "Integra": b";; measured\nSIGMAT\n0 10 20\n",
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
        assert foreign_kind(text) is None


def test_what_nothing_in_a_file_tells_its_name_may(tmp_path):
    (tmp_path / "a.bsdf180").write_bytes(bytes(range(256)))
    with pytest.raises(GonioError, match=r"is a Speos \.bsdf180 file, which gonio does not read"):
        read(tmp_path / "a.bsdf180")
