"""Tables a second of a campaign on 1, 2 and 4 local workers, and on two clusters of one machine: overhead, efficiency.

    python local_workers.py [TABLES [WORKERS,WORKERS,...]]

On a machine that is shared wall times say little: processor time of a task, that of everything beside the tasks, and
the share of the workers' time in tasks are compared. What is beside them is split into the start (imports of every
process, catalogue and page: a campaign of four tables) and what each task adds. Efficiency: processor time of the tasks
with one worker over that with n, times the share of time that the workers were busy between their first and last task.
"""

import json
import os
import pathlib
import resource
import socket
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from support.process import gonio, python

os.environ["PYTHONDONTWRITEBYTECODE"] = ""  # as users have it: modules are compiled once
RECIPE = """gonio_campaign = 1
fit = ["lambert + ggx(f0=0.04)"]
fit_options = {{starts = 2}}
[[measure]]
materials = ["lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)"]
scans = [{{step = 15}}]
photons = 1e6
seeds = "0:{tables}"
"""
PORT = 18686


def processor_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def records(folder: pathlib.Path) -> list[tuple[dict, float]]:
    """Records with the times at which they were written."""
    return [(json.loads(p.read_text()), p.stat().st_mtime) for p in (folder / "records").glob("*.json")]


def campaign(folder: pathlib.Path, tables: int, runs: str, *words: str) -> tuple[float, float]:
    """Wall and processor seconds of a command and all that it began."""
    (folder / "r.toml").write_text(RECIPE.format(tables=tables))
    began, worked = time.perf_counter(), processor_seconds()
    done = subprocess.run(
        [*gonio(), "campaign", "r.toml", "-o", runs, *words], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return time.perf_counter() - began, processor_seconds() - worked


def two_clusters(folder: pathlib.Path, tables: int, runs: str) -> tuple[float, float]:
    """Two schedulers with a worker each do half of the subjects at the same time, into one folder."""
    (folder / "r.toml").write_text(RECIPE.format(tables=tables))
    began, worked = time.perf_counter(), processor_seconds()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    helpers, commands = [], []
    for k in range(2):
        address, port = f"tcp://127.0.0.1:{PORT + k}", str(PORT + k)
        options = ["--host", "127.0.0.1", "--port", port, "--no-dashboard"]
        helpers.append(subprocess.Popen([*python(), "-m", "distributed.cli.dask_scheduler", *options], **quiet))
        options = ["--nthreads", "1", "--no-dashboard", "--memory-limit", "0", "--death-timeout", "60"]
        environment = os.environ | {"NPROC": "1", "OPENBLAS_NUM_THREADS": "1"}
        worker = [*python(), "-m", "distributed.cli.dask_worker", address, *options]
        helpers.append(subprocess.Popen(worker, env=environment, **quiet))
    for k in range(2):
        while socket.socket().connect_ex(("127.0.0.1", PORT + k)):
            time.sleep(0.2)
        words = ["-o", runs, "--scheduler", f"tcp://127.0.0.1:{PORT + k}", "--part", f"{k + 1}/2"]
        commands.append(subprocess.Popen([*gonio(), "campaign", "r.toml", *words], cwd=folder, **quiet))
    assert [c.wait() for c in commands] == [0, 0]
    wall = time.perf_counter() - began
    for helper in reversed(helpers):
        helper.terminate()
        helper.wait()
    return wall, processor_seconds() - worked


def beside(folder: pathlib.Path, tables: int, runs: str, workers: str) -> tuple[float, float, float]:
    """Wall seconds of a campaign, its processor seconds, and those that are not in its tasks."""
    wall, cpu = (
        two_clusters(folder, tables, runs)
        if workers == "clusters"
        else campaign(folder, tables, runs, "--workers", workers)
    )
    return wall, cpu, cpu - sum(r["cpu_seconds"] for r, _ in records(folder / runs))


def main() -> None:
    tables = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    counts = sys.argv[2].split(",") if len(sys.argv) > 2 else ["1", "2", "4"]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        campaign(folder, 4, "warm", "--workers", "1")  # programs are compiled
        print(f"{tables} tables, each measured and fitted; load of the machine {os.getloadavg()[0]:.1f}")
        print("          tables/s  CPU/task ms  start s  overhead/task ms: with start, without  busy  efficiency")
        alone, first = None, None
        for label in [*counts, "clusters"]:
            start = beside(folder, 4, f"start_{label}", label)[2]
            wall, _, more = beside(folder, tables, label, label)
            kept = records(folder / label)
            workers = 2 if label == "clusters" else int(label)
            # From when the workers are warm: the first tasks of each load programs.
            warm = sorted(kept, key=lambda item: item[1])[4 * workers :]
            each = sum(r["cpu_seconds"] for r, _ in warm) / len(warm)
            busy = sum(r["seconds"] for r, _ in warm[1:]) / (workers * (warm[-1][1] - warm[0][1]))
            alone = alone or each
            results = {p.name: p.read_bytes() for f in ("tables", "fits") for p in (folder / label / f).iterdir()}
            first = first or results
            print(
                f"{label:9} {tables / wall:8.2f} {1e3 * each:12.1f} {start:8.1f} {1e3 * more / len(kept):29.1f}"
                f" {1e3 * (more - start) / len(kept):8.1f} {busy:5.2f} {busy * alone / each:11.2f}"
                f"   same bytes: {results == first}, {wall:.0f} s, load {os.getloadavg()[0]:.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
