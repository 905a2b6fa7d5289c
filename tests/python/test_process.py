"""Threads, interrupts, forks, silence and the time of an import."""

import multiprocessing
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import druse
from conftest import ball_distance

LONG = {"druse": 1, "band": {"voxel_size": 0.008}, "op": [{"union": {"sphere": {"radius": 5}}}]}


def test_two_threads_get_the_same_bytes(schwarz, block):
    tiling = druse.Tiling(block, schwarz)
    hashes, values = [], []
    points = np.random.default_rng(1).uniform(0, 10, (20_000, 3))

    def work():
        hashes.append(tiling.level_set(voxel_size=0.2).content_hash)
        values.append(schwarz(points).tobytes())

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(hashes) == 4 and len(set(hashes)) == 1 and len(set(values)) == 1


def test_the_number_of_threads_changes_no_byte(schwarz, block):
    hashes = set()
    for threads in (1, 3, 0):
        druse.set_threads(threads)
        hashes.add(druse.Tiling(block, schwarz).level_set(voxel_size=0.25).content_hash)
    assert len(hashes) == 1


def test_the_interpreter_runs_during_work(schwarz):
    """A second thread of Python counts while the library works."""
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (400_000, 3))
    cell = druse.Cell.graph("octet", element="hex", radius=0.08, band_limit=6)
    finished = threading.Event()
    worker = threading.Thread(target=lambda: (cell(points), finished.set()))
    worker.start()
    steps = 0
    while not finished.is_set():
        steps += 1
    worker.join()
    assert steps > 1000


def test_one_level_set_in_two_threads_is_refused_or_right(ball):
    failures, volumes = [], []

    def work():
        try:
            volumes.append(ball.volume)
            ball.dilate(0.01)
        except druse.ArgumentError as error:
            failures.append(str(error))

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all("another thread" in f or "empty" in f for f in failures)
    assert ball.volume > 0


def test_a_thread_that_raises_keeps_none_waiting(ball, monkeypatch):
    """While one thread makes the exception of an empty level set, another puts the level set back."""
    make = druse._errors.make
    monkeypatch.setattr(druse._errors, "make", lambda *a: (time.sleep(0.001), make(*a))[1])
    own, refused, end = ball.copy(), [], time.monotonic() + 30

    def work(call):
        while sum("empty" in r for r in refused) < 3 and time.monotonic() < end:
            try:
                call()
            except druse.ArgumentError as error:
                refused.append(str(error))

    # Readers pause, so that the operation takes the level set in between.
    calls = [lambda: own.dilate(1e-4), lambda: (time.sleep(0.002), own.volume), lambda: (time.sleep(0.003), own.voxel_size)]
    threads = [threading.Thread(target=work, args=(call,), daemon=True) for call in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=60)
        assert not thread.is_alive()
    assert any("empty" in r for r in refused)


@pytest.mark.parametrize("what", ["run", "function", "homogenize", "fit"])
def test_an_interrupt_ends_the_work(what, schwarz):
    def slow(points):
        time.sleep(0.01)
        return ball_distance(points)

    began = []

    def interrupt():
        time.sleep(0.4)
        began.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Thread(target=interrupt)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        if what == "run":
            druse.run(LONG)
        elif what == "function":
            druse.LevelSet.from_function(slow, [[-4, -4, -4], [4, 4, 4]], 0.01)
        elif what == "homogenize":
            schwarz.homogenize(resolution=96)
        else:
            druse.fit("hypot(x, y) - 0.2", element="hex", band_limit=30)
    taken = time.perf_counter() - began[0]
    timer.join()
    print(f"figure: Python: Ctrl-C ends {what} after {taken:.2f} s")
    assert taken < 1.0


def _volume(queue):
    queue.put(druse.run({"druse": 1, "band": {"voxel_size": 0.5}, "op": [{"union": {"sphere": {"radius": 5}}}]}).volume)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_fork_works(ball):
    assert ball.volume > 0
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_volume, args=(queue,), daemon=True)  # ended with the tests if it hangs
    child.start()
    volume = queue.get(timeout=60)
    child.join(timeout=60)
    assert child.exitcode == 0 and volume == pytest.approx(4 / 3 * np.pi * 125, rel=0.01)


def test_nothing_is_printed(capfd, ball):
    druse.run({"druse": 1, "band": {"voxel_size": 0.5}, "op": [{"union": {"sphere": {"radius": 5}}}]})
    ball.dilate(0.1).mesh()
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


def test_the_import_is_fast():
    """The least of several, after numpy, which the package needs, and with it."""
    code = "import sys, time; t = time.perf_counter(); import numpy; m = time.perf_counter(); import druse; " \
        "print(m - t, time.perf_counter() - m)"
    runs = [
        [float(v) for v in subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()]
        for _ in range(5)
    ]
    own, whole = min(r[1] for r in runs), min(sum(r) for r in runs)
    print(f"figure: Python: import of druse {1000 * own:.0f} ms, {1000 * whole:.0f} ms with numpy")
    assert own < 0.2


def test_only_the_libraries_of_the_wheel_are_used():
    """In an installed wheel; a build in place uses the system's OpenVDB."""
    package = pathlib.Path(druse.__file__).parent
    if not (package.parent / "druse.libs").is_dir():
        pytest.skip("not an installed wheel")
    maps = pathlib.Path("/proc/self/maps").read_text()
    used = {line.split()[-1] for line in maps.splitlines() if "openvdb" in line or "libtbb" in line}
    assert used and all("druse.libs" in path for path in used), used


def test_what_the_interpreter_costs():
    """A function of Python in the band, beside the same level set from the library."""
    bounds = [[-4, -4, -4], [4, 4, 4]]
    start = time.perf_counter()
    own = druse.LevelSet.from_function(ball_distance, bounds, 0.05)
    python = time.perf_counter() - start
    recipe = {"druse": 1, "band": {"voxel_size": 0.05}, "op": [{"union": {"sphere": {"radius": 4}}}]}
    start = time.perf_counter()
    part = druse.run(recipe, brief=True)
    library = time.perf_counter() - start
    assert own.volume == pytest.approx(part.volume, rel=1e-4)
    print(f"figure: Python: a ball of 160 voxels as a function of numpy {python:.2f} s, as a recipe {library:.2f} s")
