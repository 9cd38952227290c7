"""A command as a process of its own: wall time, processor time, peak memory."""

import os
import subprocess
import sys
import sysconfig
import time
from typing import NamedTuple


class Run(NamedTuple):
    """Exit status, wall and processor seconds, peak memory in MB, and what it printed."""

    status: int
    wall: float
    cpu: float
    peak_mb: float
    output: str


def gonio() -> list[str]:
    """The installed program, of the interpreter that runs this."""
    return [os.path.join(sysconfig.get_path("scripts"), "gonio")]


def python() -> list[str]:
    """The interpreter that runs this."""
    return [sys.executable]


def timed(command: list[str], cwd: str, **environment: str) -> Run:
    """Run a command to its end."""
    began = time.perf_counter()
    child = subprocess.Popen(
        command, cwd=cwd, env=os.environ | environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    output = child.stdout.read()
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - began
    return Run(child.returncode, wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, output)
