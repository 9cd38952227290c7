"""Threads of the compiled loops."""

import subprocess
import sys

import pytest

from gonio.models.compiled import workers


def test_every_piece_is_done_once():
    done = []

    def work(start, stop):
        done.extend(range(start, stop))
        return 1 << (start % 3)

    assert workers.share(work, 1000, 7) & 1 and sorted(done) == list(range(1000))


@pytest.mark.parametrize(("total", "step"), [(1000, 64), (1001, 64), (64 * 7, 100), (63, 64), (100_000, 1 << 14)])
def test_pieces_that_begin_at_multiples_are_not_empty(total, step):
    pieces = []
    workers.share(lambda start, stop: pieces.append((start, stop)) or 0, total, step, 64)
    pieces.sort()
    assert pieces[0][0] == 0 and pieces[-1][1] == total and all(a < b and a % 64 == 0 for a, b in pieces)
    assert [b for _, b in pieces[:-1]] == [a for a, _ in pieces[1:]]


@pytest.mark.parametrize(("stated", "expected"), [("1", 1), ("100000", None), ("0", None), ("two", None)])
def test_processes_that_are_as_many_as_processors_have_one_thread_each(stated, expected):
    script = "from gonio.models.compiled import workers; print(workers.count())"
    of_all = int(subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout)
    made = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env={"NPROC": stated}
    )
    assert int(made.stdout) == (expected or of_all)
