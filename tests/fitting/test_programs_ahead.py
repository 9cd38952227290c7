"""Programs got ready ahead: begun once, waited for where they are needed, and by nobody where they are not."""

import subprocess
import sys
import threading

from gonio.fitting.programs_ahead import ahead, finished

AHEAD = "gonio-ahead"


def test_a_job_is_begun_once_and_finished_before_it_is_needed():
    done = []
    for _ in range(2):
        ahead("a job of this test", lambda: done.append(threading.current_thread().name))
    finished()
    assert done == [AHEAD]


def test_what_goes_wrong_ahead_is_left_to_where_it_is_needed():
    begun = []
    ahead("another job of this test", lambda: begun.append(1 / 0))
    ahead("one beside it", lambda: begun.append(AHEAD))
    finished()
    assert begun == [AHEAD]  # and what a thread raises is a warning, which is an error here


SLOW = """
import sys, threading
from gonio.__main__ import command
from gonio.fitting.programs_ahead import ahead
begun, never = threading.Event(), threading.Event()
ahead("slow", lambda: (begun.set(), never.wait()))
begun.wait()
sys.argv = ["gonio", *sys.argv[1:]]
command()
"""


def test_the_program_ends_at_once_while_one_is_still_compiled():
    """With what it had to say; the limit is there to end a program that waits for ever."""
    for words, status, said in ((["models"], 0, "lambert"), (["info", "nowhere.h5"], 2, "gonio: nowhere.h5")):
        run = subprocess.run([sys.executable, "-c", SLOW, *words], capture_output=True, text=True, timeout=100)
        assert run.returncode == status and said in run.stdout + run.stderr
        assert len(run.stderr.splitlines()) == (status == 2)
