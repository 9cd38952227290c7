"""The machine and the versions that measured a chart: for its caption, and to compare charts of one machine only."""

import datetime
import os
import platform
from pathlib import Path

from gonio import __version__


def machine() -> dict[str, str]:
    """Processor, its cores that this process may use, system and versions, by name."""
    import jax
    import numpy
    import scipy

    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    device = jax.devices()[0]
    return {
        "processor": _processor(),
        "cores": str(usable),
        "device": "the processor" if device.platform == "cpu" else device.device_kind,
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "gonio": __version__,
        "jax": jax.__version__,
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
    }


def sentence(of: dict[str, str], when: datetime.datetime) -> str:
    """The machine in a line of a caption."""
    versions = ", ".join(f"{name} {of[name]}" for name in ("gonio", "jax", "numpy", "scipy", "python"))
    on = "" if of["device"] == "the processor" else f", {of['device']}"
    return f"{of['processor']}, {of['cores']} cores{on}; {versions}; {when:%Y-%m-%d %H:%M} UTC"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
