"""Radiance's own BSDF library (pyradiance), asked in a process of its own.

Its Python objects free what the library's list of loaded files still points to, and that list goes by the bare name of
a file: once an object is gone, the next load walks freed memory or answers with the values of another file. So one
process loads one file, answers, and ends without destructors; nothing that it does can take the tests along.
"""

import importlib.util
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

Angles = Iterable[tuple[float, ...]]
SECONDS = 60
COMMAND = [sys.executable, "-P", __file__]


class Answers(NamedTuple):
    """Hemispherical shares and values, in the order of the questions."""

    shares: np.ndarray
    values: np.ndarray


def installed() -> bool:
    """Whether Radiance's own reader is installed; asks without loading it."""
    return importlib.util.find_spec("pyradiance") is not None


def ask(path: str | os.PathLike[str], shares: Iterable[tuple[float, float, str]] = (), pairs: Angles = ()) -> Answers:
    """What Radiance's library says of a BSDF file.

    Args:
        path: an XML file.
        shares: polar angle and azimuth of the light in degrees, and "reflection" or "transmission".
        pairs: polar angle and azimuth of the light and of the detector in degrees.

    Returns:
        The share that leaves for each of `shares`, and f in 1/sr for each of `pairs`; its front is gonio's back.

    Raises:
        RuntimeError: the library crashed, hung, or cannot read the file.
    """
    questions = {
        "path": os.fspath(path),
        "shares": [[float(t), float(p), part] for t, p, part in shares],
        "pairs": np.asarray(list(pairs), float).reshape(-1, 4).tolist(),
    }
    try:
        child = subprocess.run(
            COMMAND,
            input=json.dumps(questions),
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"Radiance's library did not answer within {SECONDS} s on {path}") from None
    if child.returncode:
        status = child.returncode
        end = f"signal {signal.Signals(-status).name}" if status < 0 else f"status {status}"
        raise RuntimeError(f"Radiance's library ended with {end} on {path}: {child.stderr.strip()[-500:]}")
    answers = json.loads(child.stdout)
    return Answers(np.array(answers["shares"], float), np.array(answers["values"], float))


def _answer() -> None:
    """Answers the questions on standard input, in the process of its own."""
    import pyradiance.bsdf as bsdf  # its destructors would run in any process that loads it

    questions = json.load(sys.stdin)
    loaded = bsdf.load_file(questions["path"])
    if loaded is None:
        sys.exit("it cannot read the file")
    parts = {"reflection": bsdf.SAMPLE_ALL & ~bsdf.SAMPLE_T, "transmission": bsdf.SAMPLE_ALL & ~bsdf.SAMPLE_R}
    answers = {
        "shares": [bsdf.direct_hemi(loaded, t, p, parts[part]) for t, p, part in questions["shares"]],
        "values": [float(bsdf.query(loaded, *pair)[1]) for pair in questions["pairs"]],
    }
    print(json.dumps(answers), flush=True)
    os._exit(0)


if __name__ == "__main__":
    _answer()
