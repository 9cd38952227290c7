"""Pictures drawn in a second process while the first one computes: two threads of Python would take turns."""

import contextlib
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future
from contextvars import ContextVar
from typing import Protocol

START = "import sys; sys.path[:] = sys.argv[1:]; from gonio.figures.drawing_process import serve; serve()"


LENGTH = 8
"""Bytes of the number of bytes that follow."""


class Drawable(Protocol):
    """What a process can be handed to draw."""

    def svg(self) -> str: ...


class DrawingProcess:
    """A process that draws pictures in the order in which they come."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", START, *sys.path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self.waiting: deque[Future[str | None]] = deque()
        self.ended = threading.Event()
        # The process waits for nobody to take its answers: a full pipe would stop it.
        self.answers = threading.Thread(target=self._take_answers, daemon=True)
        self.answers.start()

    def draw(self, picture: Drawable) -> "Future[str | None] | None":
        """The SVG element of a picture to come; None, there too, where only this process can draw it."""
        try:
            sent = pickle.dumps(picture)
        except (pickle.PicklingError, AttributeError, TypeError):  # drawn by a function that has no name
            return None
        assert self.process.stdin is not None
        future: Future[str | None] = Future()
        self.waiting.append(future)
        try:
            self.process.stdin.write(len(sent).to_bytes(LENGTH) + sent)
            self.process.stdin.flush()
        except OSError:
            self.ended.set()
        if self.ended.is_set():  # a pipe may take what nobody reads
            self._give_up()
        return future

    def close(self) -> None:
        """Ends the process, whatever it still had to draw."""
        self.process.kill()
        self.process.wait()
        self.answers.join()
        for pipe in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):
                assert pipe is not None
                pipe.close()

    def _take_answers(self) -> None:
        assert self.process.stdout is not None
        with contextlib.suppress(EOFError, pickle.UnpicklingError, IndexError):
            while True:
                answer = pickle.load(self.process.stdout)
                self.waiting.popleft().set_result(answer)
        self.ended.set()
        self._give_up()

    def _give_up(self) -> None:
        with contextlib.suppress(IndexError):
            while True:
                self.waiting.popleft().set_result(None)


DRAWING: ContextVar[DrawingProcess | None] = ContextVar("drawing", default=None)
"""The process that draws for this thread, if any."""


@contextlib.contextmanager
def drawing_beside() -> Iterator[None]:
    """Pictures made while the block lasts are drawn in a process of their own.

    Not where there is one processor, nor where Matplotlib has been loaded: it takes the time of a dozen pictures.
    """
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if usable < 2 or "matplotlib" in sys.modules or not sys.executable:
        yield
        return
    try:
        process = DrawingProcess()
    except OSError:
        yield
        return
    token = DRAWING.set(process)
    try:
        yield
    finally:
        DRAWING.reset(token)
        process.close()


def serve() -> None:
    """The process: draws what comes on standard input until that ends."""
    import gc
    import signal

    gc.set_threshold(100_000, 50, 100)  # figures are many objects that go one by one: as `gonio.cli.program.main`
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # its parent ends it
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    pictures: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_take_pictures, args=(pictures,), daemon=True).start()
    # Matplotlib is loaded before the first picture comes; half of its time would go to a text on the properties of each
    # class, which nobody reads here.
    import matplotlib.artist

    matplotlib.artist.kwdoc = lambda artist: ""
    import matplotlib.backends.backend_svg
    import matplotlib.figure

    from gonio.figures import style  # noqa: F401

    while sent := pictures.get():
        answer: str | None = None
        with contextlib.suppress(Exception):  # its parent draws it again, and meets the fault
            answer = pickle.loads(sent).svg()
        out.write(pickle.dumps(answer))
        out.flush()
    os._exit(0)


def _take_pictures(pictures: "queue.SimpleQueue[bytes]") -> None:
    """Takes pictures as bytes: to load them imports modules, which two threads must not do at once."""
    while length := int.from_bytes(sys.stdin.buffer.read(LENGTH)):
        pictures.put(sys.stdin.buffer.read(length))
    pictures.put(b"")
