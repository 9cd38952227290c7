"""Campaigns whose workers and schedulers are killed at random moments, and run again: beside an undisturbed one.

    python kills.py [TABLES [KILLS_OF_WORKERS [KILLS_OF_SCHEDULERS [SEED]]]]

A scheduler is killed with the command that it is part of; and one of its own, to which the command was told to go.
Workers are killed as fast as results come: one after each that is new. A disk is filled where a tmpfs can be mounted.
"""

import pathlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

import psutil

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from support.process import gonio, python

RECIPE = """gonio_campaign = 1
fit = ["lambert"]
fit_options = {{starts = 0}}
[[measure]]
materials = ["lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)"]
scans = [{{step = 30}}]
photons = 1e6
seeds = "0:{tables}"
"""
RESULTS = ("tables", "fits")


def results(folder: pathlib.Path) -> dict[str, bytes]:
    """Every result by its name, without what killed processes were writing."""
    paths = (p for f in RESULTS for p in (folder / f).iterdir() if not p.name.endswith(".tmp"))
    return {f"{p.parent.name}/{p.name}": p.read_bytes() for p in paths}


def begin(folder: pathlib.Path, *words: str) -> subprocess.Popen[str]:
    """The command, with two workers unless the words say otherwise."""
    command = [*gonio(), "campaign", "r.toml", "-o", "runs", *(words or ("--workers", "2"))]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def workers_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """Worker processes that a command began."""
    try:
        every = psutil.Process(process.pid).children(recursive=True)
        return [p for p in every if "spawn_main" in " ".join(p.cmdline())]
    except psutil.Error:
        return []


def is_working(worker: psutil.Process) -> bool:
    """Whether a worker is beyond its imports: it has loaded what computes."""
    try:
        return any("jaxlib" in m.path for m in worker.memory_maps())
    except psutil.Error:
        return False


def forget(folder: pathlib.Path, rng: random.Random) -> None:
    """Removes half of the results, so that there is work again."""
    for path in (folder / "runs" / "records").iterdir():
        if rng.random() < 0.5:
            path.unlink()


def records(folder: pathlib.Path) -> int:
    """How many results have a record."""
    return sum(p.suffix == ".json" and p.name[0] != "." for p in (folder / "runs" / "records").iterdir())


def wait_for_result(folder: pathlib.Path, child: subprocess.Popen[str]) -> None:
    """Waits until a command has a new result, or has ended."""
    there = records(folder)
    while child.poll() is None and records(folder) <= there:
        time.sleep(0.05)


def kill_workers(folder: pathlib.Path, kills: int, rng: random.Random) -> tuple[int, int]:
    """(kills of workers that had done a task, commands that ended well meanwhile)."""
    done = ended = 0
    child = begin(folder)
    while done < kills:
        wait_for_result(folder, child)
        time.sleep(rng.uniform(0.0, 1.0))
        if child.poll() is not None:
            out = child.stdout.read()
            assert child.returncode == 1 and "not done" not in out, out  # a diffuser alone is a failed fit of a lobe
            ended += 1
            forget(folder, rng)
            child = begin(folder)
        victims = [w for w in workers_of(child) if is_working(w)]
        if victims:
            rng.choice(victims).send_signal(signal.SIGKILL)
            done += 1
    out = child.communicate()[0]
    assert child.returncode == 1 and "not done" not in out, out
    return done, ended + 1


def kill_commands(folder: pathlib.Path, kills: int, rng: random.Random) -> list[int]:
    """Results that were there after each kill of the command and its scheduler."""
    there = []
    forget(folder, rng)
    for _ in range(kills):
        child = begin(folder)
        wait_for_result(folder, child)
        time.sleep(rng.uniform(0.0, 1.0))
        child.send_signal(signal.SIGKILL)
        child.wait()
        there.append(records(folder))
    return there


def fill_disk(folder: pathlib.Path) -> str:
    """What a campaign says on a disk that is too small, and whether it goes on to the same results on a larger one."""
    disk = folder / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode:
        return "not tried: no tmpfs can be mounted here"
    try:
        shutil.copy(folder / "r.toml", disk)
        child = begin(disk)
        out = child.communicate()[0].strip()
        before = records(disk)
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        begin(disk).communicate()
        same = results(disk / "runs") == results(folder / "runs")
        return f"status {child.returncode}, {before} results: {out}; with room, bit for bit the same: {same}"
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def wait_for(port: int) -> None:
    """Waits until something listens at a port of this machine."""
    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.2)


def kill_schedulers(folder: pathlib.Path, kills: int, rng: random.Random) -> list[str]:
    """What the command says when the scheduler of a cluster of its own dies."""
    said = []
    for k in range(kills):
        forget(folder, rng)
        address = f"tcp://127.0.0.1:{18786 + k}"
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        options = ["--host", "127.0.0.1", "--port", str(18786 + k), "--no-dashboard"]
        scheduler = subprocess.Popen([*python(), "-m", "distributed.cli.dask_scheduler", *options], **quiet)
        options = [
            "--nthreads",
            "1",
            "--nworkers",
            "2",
            "--no-dashboard",
            "--memory-limit",
            "0",
            "--death-timeout",
            "20",
        ]
        workers = subprocess.Popen([*python(), "-m", "distributed.cli.dask_worker", address, *options], **quiet)
        wait_for(18786 + k)
        child = begin(folder, "--scheduler", address)
        wait_for_result(folder, child)
        time.sleep(rng.uniform(0.0, 2.0))
        scheduler.send_signal(signal.SIGKILL)
        out = child.communicate()[0]
        said.append(f"status {child.returncode}: {out.strip().splitlines()[-1] if out.strip() else ''}")
        workers.terminate()
        workers.wait()
        scheduler.wait()
    return said


def main() -> None:
    given = [int(a) for a in sys.argv[1:]]
    tables, of_workers, of_schedulers, seed = [*given, *(200, 100, 10, 1)[len(given) :]]
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "r.toml").write_text(RECIPE.format(tables=tables))
        assert begin(folder).wait() == 1
        whole = results(folder / "runs")
        assert len(whole) == 2 * tables
        print(f"undisturbed: {len(whole)} results", flush=True)
        print(f"full disk: {fill_disk(folder)}", flush=True)
        shutil.rmtree(folder / "runs" / "fits")
        done, ended = kill_workers(folder, of_workers, rng)
        same = results(folder / "runs") == whole
        print(f"{done} kills of workers over {ended} commands: bit for bit the same: {same}", flush=True)
        there = kill_commands(folder, of_schedulers, rng)
        begin(folder).wait()
        same = results(folder / "runs") == whole
        print(f"{of_schedulers} kills of the command, {there} results there: bit for bit the same: {same}", flush=True)
        for line in kill_schedulers(folder, max(1, of_schedulers // 3), rng):
            print(f"scheduler of its own killed: {line}", flush=True)
        begin(folder).wait()
        print(f"and run again: bit for bit the same: {results(folder / 'runs') == whole}")
        time.sleep(15)
        orphans = [p.pid for p in psutil.process_iter(["cmdline"]) if str(folder) in " ".join(p.info["cmdline"] or [])]
        print(f"processes that are left: {len(orphans)}")


if __name__ == "__main__":
    main()
