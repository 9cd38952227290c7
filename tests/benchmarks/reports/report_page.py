"""One report page of all of RGL's isotropic files and NIST's PTFE: seconds to make it, its size, its loading time.

python report_page.py FOLDER [OUT.html]
"""

import os
import pathlib
import statistics
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

import jax

from support.browser import CHROMIUM, browser

jax.config.update("jax_enable_x64", True)

from gonio import report  # noqa: E402

LOADS = 5


def main(folder: str, output: str | None = None) -> None:
    files = [*sorted(pathlib.Path(folder, "rgl").glob("*.bsdf")), pathlib.Path(folder, "nist_ptfe", "PTFE.data.csv")]
    with tempfile.TemporaryDirectory() as temporary:
        path = pathlib.Path(output or os.path.join(temporary, "page.html"))
        began, wall = time.process_time(), time.perf_counter()
        report([str(f) for f in files], path, title="Measured materials", force=True)
        print(f"made in {time.process_time() - began:.1f} CPU s, {time.perf_counter() - wall:.1f} s of wall time")
        for written in (path, path.with_suffix(".json")):
            print(f"{written.name}: {written.stat().st_size:,} bytes")
        if CHROMIUM is None:
            print("no Chromium to load it in")
            return
        for width, mobile in ((1280, False), (390, True)):
            with browser() as b:
                b.screen(width, mobile=mobile)
                loads = [b.open(path.resolve().as_uri()) for _ in range(LOADS)]
                pictures = b.evaluate("document.querySelectorAll('svg.panel').length")
                wide = b.evaluate("document.documentElement.scrollWidth")
                print(
                    f"{width} px: loaded in {statistics.median(loads):.2f} s (median of {LOADS}, up to the load"
                    f" event), {pictures} pictures, {wide} px wide, console {b.console or 'silent'}"
                )


if __name__ == "__main__":
    main(*sys.argv[1:])
