"""Threads, memory, interruption, forks and start-up."""

import io
import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import surfel
from conftest import land, las, sphere
from surfel import _progress


def resident_bytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs Linux's /proc")
def test_a_thousand_images_take_no_more_memory():
    scene = surfel.scene(sphere(500)[0], up="+y")
    for _ in range(50):
        scene.render(size=(64, 64), view="front")
    before = resident_bytes()
    for _ in range(1000):
        image = scene.render(size=(64, 64), view="front")
    grown = resident_bytes() - before
    # An image's planes are 147,456 bytes: one in fifty kept would show.
    assert grown < 3 << 20, f"{grown} bytes"
    assert image.size == (64, 64)


def test_two_threads_draw_at_once_and_others_run():
    scene = surfel.scene(sphere(20_000)[0], up="+y", backend="reference", threads=1)
    scene.prepare(view="front")
    wanted = scene.render(size=(96, 96), view="front").linear
    found, ticks, over = [], [0], threading.Event()

    def draw():
        found.append(scene.render(size=(96, 96), view="front").linear)

    def tick():
        while not over.is_set():
            ticks[0] += 1
            time.sleep(0.001)

    ticker = threading.Thread(target=tick)
    ticker.start()
    drawers = [threading.Thread(target=draw) for _ in range(2)]
    for drawer in drawers:
        drawer.start()
    for drawer in drawers:
        drawer.join()
    over.set()
    ticker.join()
    assert len(found) == 2 and all(np.array_equal(linear, wanted) for linear in found)
    assert ticks[0] > 3, "Python's other threads run while images are drawn"


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_ends_the_waiting():
    code = (
        "import surfel, numpy as np, signal\n"
        # What runs the tests in the background may ignore the signal, and a child would, too.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "rng = np.random.default_rng(1)\n"
        "scene = surfel.scene(rng.normal(size=(200000, 3)), backend='reference', threads=1)\n"
        "try:\n"
        # Within, since the signal may come before the next line on a busy machine.
        "    print('ready', flush=True)\n"
        "    scene.render(size=(1500, 1500), samples=8)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "ready\n"
    time.sleep(0.5)
    start = time.monotonic()
    child.send_signal(signal.SIGINT)
    assert child.stdout.readline() == "interrupted\n"
    # The image takes minutes.
    assert time.monotonic() - start < 20
    child.kill()
    child.wait()


LIMITED = """
import resource
import numpy as np, surfel
points = np.zeros((12_000_000, 3), np.float32)
scene = surfel.scene(np.random.default_rng(1).normal(size=(500, 3)), size=(16, 16), threads=1, up="+y", view="front")
scene.render()
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + (300 << 20), resource.getrlimit(resource.RLIMIT_AS)[1]))
for call in (
    lambda: surfel.scene(points),
    lambda: surfel.scene(points[:1_000_000]).render(up="+y", view="front", threads=1),
    lambda: scene.render(size=(8000, 8000)),
    lambda: scene.render(size=(400, 400), samples=20, backend="reference"),
    lambda: scene.render(size=(16384, 16384), planes=["depth", "position"]),
    lambda: scene.render(threads=1024),
    lambda: surfel.compare(*[points[:1_210_000].reshape(1100, 1100, 3)] * 2),
    lambda: next(iter(scene.render_many(frames=1_000_000))),
):
    try:
        call()
        print("drawn")
    except MemoryError as error:
        print("MemoryError", error)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs limits of memory")
def test_what_does_not_fit_is_a_memory_error():
    # The limit is one of address space, of which glibc reserves 64 MiB for each thread that meets others: how many do
    # is a matter of timing.
    done = subprocess.run([sys.executable, "-c", LIMITED], env={**os.environ, "MALLOC_ARENA_MAX": "1"},
                          capture_output=True, text=True, check=False)
    told = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    # The last one draws its first image: frames are counted, not listed.
    assert [line.split()[0] for line in told] == ["MemoryError"] * 7 + ["drawn"], done.stdout
    for line, what in zip(told, ("points: ", "points: ", "size: ", "size: ", "size: ", "threads: ", "a and b: ")):
        assert f"MemoryError {what}cannot fit into memory" in line, line


SWEPT = """
import os, pathlib, resource, sys
import numpy as np, surfel
points = np.random.default_rng(1).normal(size=(5000, 3))
flags = dict(size=(64, 64), threads=2)
file = pathlib.Path("points.ply")
calls = {
    "render": lambda: surfel.scene(points, **flags).render(),
    "reference": lambda: surfel.scene(points, **flags).render(backend="reference"),
    "render_many": lambda: list(surfel.scene(points, **flags).render_many(frames=3)),
    "save": lambda: surfel.open(file, **flags).render().save(f"{os.getpid()}.png"),
    "info": lambda: surfel.info(file),
    "convert": lambda: surfel.convert(file, f"{os.getpid()}.ply", threads=2),
    "ortho": lambda: surfel.ortho(file, dsm=f"{os.getpid()}.tif", gsd=0.1, threads=2),
    "compare": lambda: surfel.compare(np.zeros((300, 300, 4)), np.ones((300, 300, 4))),
}
for room in (0, 4, 8, 12, 20, 28, 60, 72, 80, 100, 140, 150, 210, 2000):
    for name, call in calls.items():
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + (room << 20), resource.getrlimit(resource.RLIMIT_AS)[1]))
            told = "done"
            try:
                call()
            except MemoryError:
                told = "refused"
            except BaseException as error:
                told = f"{type(error).__name__}: {error}"
            os.write(1, f"{room} {name} {told}\\n".encode())
            os._exit(0)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if status:
            os.write(1, f"{room} {name} exit {status}\\n".encode())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs limits of memory")
def test_calls_fit_or_are_refused_whatever_address_space_is_left(tmp_path):
    surfel.scene(np.random.default_rng(1).normal(size=(5000, 3))).save(tmp_path / "points.ply")
    done = subprocess.run([sys.executable, "-c", SWEPT], cwd=tmp_path, capture_output=True,
                          text=True, check=False)
    told = [line.split(maxsplit=2) for line in done.stdout.splitlines()]
    assert done.returncode == 0 and len(told) == 8 * 14, done.stdout + done.stderr[-2000:]
    assert [line for line in told if line[2] not in ("done", "refused")] == [], done.stderr[-2000:]
    assert {end for room, _, end in told if room == "2000"} == {"done"}
    assert {end for room, _, end in told if room == "0"} == {"refused"}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_forked_processes_draw_and_read(tmp_path):
    scene = surfel.scene(sphere(500)[0], up="+y")
    las(tmp_path / "tile.las", next(land(1, 100_000)))
    wanted = scene.render(size=(32, 32), view="front").linear.sum(), surfel.info(tmp_path / "tile.las")
    child = os.fork()
    if child == 0:
        found = scene.render(size=(32, 32), view="front").linear.sum(), surfel.info(tmp_path / "tile.las")
        os._exit(0 if found == wanted else 1)
    for _ in range(1200):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        time.sleep(0.05)
    else:
        os.kill(child, signal.SIGKILL)
        pytest.fail("the child hangs")
    assert os.waitstatus_to_exitcode(status) == 0


def test_scenes_and_images_are_pickled(data, tmp_path):
    flags = {"size": (64, 48), "planes": ["color", "depth", "normal", "weight", "index", "object", "position"]}
    for scene in (surfel.open(data / "disks.ply"), surfel.scene(sphere(500)[0], shader="normal")):
        image = scene.render(**flags)
        for other in (pickle.loads(pickle.dumps(image)), pickle.loads(pickle.dumps(scene)).render(**flags)):
            for plane in ("linear", "rgba", "depth", "normal", "weight", "index", "object", "position"):
                assert np.array_equal(getattr(other, plane), getattr(image, plane)), plane
                assert not getattr(other, plane).flags.writeable
            for ending in ("png", "exr", "npz"):
                image.save(tmp_path / f"a.{ending}", force=True)
                other.save(tmp_path / f"b.{ending}", force=True)
                assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes(), ending
            assert other.notes == image.notes and other.stats.keys() == image.stats.keys()
            assert other.scene_file == image.scene_file
            with pytest.raises(surfel.UsageError, match="label"):
                _ = other.label
    few = surfel.scene(sphere(500)[0]).render(size=(8, 8), planes="depth", tile=(1, 2))
    assert pickle.loads(pickle.dumps(few)).depth.shape == (4, 8)


def test_progress_is_written_when_it_changes(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stderr", Terminal())
    for share in (0.1, 0.1, 0.2, 0.2):
        _progress.show("radii", share)
    assert sys.stderr.getvalue() == "\rsurfel: radii  10%\rsurfel: radii  20%"
    _progress.clear()
    assert sys.stderr.getvalue().endswith("20%\r" + " " * 18 + "\r")
    _progress.show("radii", 0.2)
    assert sys.stderr.getvalue().endswith("\r" + " " * 18 + "\r\rsurfel: radii  20%")
    _progress.clear()


def test_importing_loads_nothing_large():
    code = "import sys, surfel; print('numpy' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout == "False\n"


def test_left_iterators_end_their_threads():
    scene = surfel.scene(sphere(500)[0], up="+y", size=(16, 16))
    K, T = [[16, 0, 8], [0, 16, 8], [0, 0, 1]], np.eye(4)
    T[2, 3] = -4
    many = scene.render_many([(K, T)] * 200)
    next(many)
    many.close()
    assert list(scene.render_many([])) == []


def test_failures_within_many_say_which_camera():
    scene = surfel.scene(sphere(500)[0], size=(16, 16), where="nothing>1")
    K, T = [[16, 0, 8], [0, 16, 8], [0, 0, 1]], np.eye(4)
    with pytest.raises(surfel.Error) as caught:
        list(scene.render_many([{"K": K, "world_from_camera": T, "name": "left"}]))
    if sys.version_info >= (3, 11):
        assert caught.value.__notes__ == ["camera left"]
