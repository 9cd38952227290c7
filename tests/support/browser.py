"""A real Chromium, spoken to by its own protocol over a pipe: pages loaded, looked at and printed with no network."""

import base64
import contextlib
import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
import time

CHROMIUM = next((p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None)


class Browser:
    """One tab. `console` holds every message and error of the pages, `requests` every address that they asked for."""

    def __init__(self, to, back):
        self.to, self.back, self.number, self.rest = to, back, 0, b""
        self.console, self.requests, self.loaded, self.session = [], [], False, None
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def ask(self, method, timeout=60, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            got = self._next(timeout)
            if got.get("id") == self.number:
                assert "error" not in got, (method, got["error"])
                return got["result"]

    def _next(self, timeout):
        end = time.monotonic() + timeout
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.back], [], [], max(0, end - time.monotonic()))
            assert ready, "the browser does not answer"
            data = os.read(self.back, 1 << 20)
            assert data, "the browser has gone"
            self.rest += data
        message, _, self.rest = self.rest.partition(b"\0")
        got = json.loads(message)
        method, params = got.get("method"), got.get("params", {})
        if method == "Page.loadEventFired":
            self.loaded = True
        elif method == "Runtime.consoleAPICalled":
            self.console.append(str(params["args"]))
        elif method == "Runtime.exceptionThrown":
            self.console.append(str(params["exceptionDetails"]))
        elif method == "Log.entryAdded":
            self.console.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"][:200])
        return got

    def screen(self, width, height=900, mobile=False, dark=False):
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1 + mobile,
            mobile=mobile,
        )
        self.ask(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}],
        )

    def open(self, url):
        """Seconds until the page has loaded."""
        self.loaded = False
        began = time.monotonic()
        self.ask("Page.navigate", url=url)
        while not self.loaded:
            self._next(60)
        return time.monotonic() - began

    def evaluate(self, expression):
        got = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in got, got
        return got["result"].get("value")

    def picture(self, clip=None):
        more = {"clip": {**clip, "scale": 1}} if clip else {}
        got = self.ask("Page.captureScreenshot", captureBeyondViewport=True, **more)
        return base64.b64decode(got["data"])

    def pdf(self):
        got = self.ask("Page.printToPDF", printBackground=True, paperWidth=8.27, paperHeight=11.69)
        return base64.b64decode(got["data"])


def _pipe():
    # Numbers out of the way of those that the browser uses.
    low = os.pipe()
    ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 20) for end in low]
    for end in low:
        os.close(end)
    return ends


@contextlib.contextmanager
def browser():
    # The browser reads its commands from 3 and answers on 4. Not by fork, which threads of JAX do not survive.
    (there, to), (back, here) = _pipe(), _pipe()
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--no-first-run"]
    options += ["--host-resolver-rules=MAP * ~NOTFOUND", "--disable-dev-shm-usage"]
    silent = [(os.POSIX_SPAWN_OPEN, k, os.devnull, os.O_RDWR, 0) for k in (0, 1, 2)]
    places = [(os.POSIX_SPAWN_DUP2, there, 3), (os.POSIX_SPAWN_DUP2, here, 4)]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [CHROMIUM, *options, f"--user-data-dir={profile}"]
        process = os.posix_spawn(CHROMIUM, command, os.environ, file_actions=[*silent, *places])
        os.close(there), os.close(here)
        try:
            yield Browser(to, back)
        finally:
            os.kill(process, signal.SIGTERM)
            os.waitpid(process, 0)
            os.close(to), os.close(back)
