"""Threads, memory, interruption, forks and start-up."""

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
from conftest import sphere


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
        "print('ready', flush=True)\n"
        "try:\n"
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
    assert time.monotonic() - start < 2
    child.kill()
    child.wait()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_forked_processes_draw():
    scene = surfel.scene(sphere(500)[0], up="+y")
    wanted = scene.render(size=(32, 32), view="front").linear.sum()
    child = os.fork()
    if child == 0:
        same = scene.render(size=(32, 32), view="front").linear.sum() == wanted
        os._exit(0 if same else 1)
    for _ in range(600):
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
