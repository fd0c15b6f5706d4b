"""Ray and Dask give what one process gives, to the bit, also where a worker is killed. Run by `cargo xtask test --full`,
which installs them."""

import os
import pathlib
import signal
import threading
import time

import conftest
import numpy as np
import pytest
import surfel

pytestmark = pytest.mark.engines
SIZE = (96, 72)


class Ray:
    """Ray with so many workers."""

    def __init__(self, workers):
        self.ray = pytest.importorskip("ray")
        self.workers = workers
        self.ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False)
        import surfel.ray

        self.module, self.options = surfel.ray, {"workers": workers}

    def pids(self):
        """Workers that draw, by the names that Ray gives its processes."""
        found = []
        for folder in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                words = (folder / "cmdline").read_bytes()
            except OSError:
                continue
            if words.startswith(b"ray::_Actor.draw"):
                found.append(int(folder.name))
        return found

    def close(self):
        self.ray.shutdown()


class Dask:
    """Dask with so many worker processes."""

    def __init__(self, workers):
        distributed = pytest.importorskip("distributed")
        self.cluster = distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
        self.client = distributed.Client(self.cluster)
        import surfel.dask

        self.module, self.options = surfel.dask, {"client": self.client}

    def pids(self):
        return list(self.client.run(os.getpid).values())

    def close(self):
        self.client.close()
        self.cluster.close()


@pytest.fixture(scope="module", params=[(Ray, 2), (Ray, 4), (Dask, 2), (Dask, 4)],
                ids=lambda param: f"{param[0].__name__}{param[1]}")
def engine(request):
    kind, workers = request.param
    engine = kind(workers)
    yield engine
    engine.close()


def scene():
    points, colors = conftest.sphere(20_000)
    return surfel.scene(points, colors=colors, size=SIZE)


def cameras(count):
    K, listed = [[110.0, 0, 47.5], [0, 110.0, 35.5], [0, 0, 1]], []
    for i in range(count):
        c, s = np.cos(i / 9), np.sin(i / 9)
        T = np.eye(4)
        T[:3, :3] = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]).T
        T[:3, 3] = -3 * T[:3, 2]
        listed.append({"K": K, "world_from_camera": T, "name": f"view{i}"})
    return listed


def same(a, b, planes=("linear", "depth", "normal", "weight")):
    return a.name == b.name and all(np.array_equal(getattr(a, p), getattr(b, p)) for p in planes)


def kill_one(engine):
    """Kills a worker that draws, without a chance to say good-bye."""
    # On a loaded machine, Ray takes more than ten seconds to start its workers.
    for _ in range(12_000):
        if pids := engine.pids():
            os.kill(pids[0], signal.SIGKILL)
            return pids[0]
        time.sleep(0.01)
    pytest.fail("no worker draws")


def test_pictures_are_those_of_one_process_though_a_worker_is_killed(engine, tmp_path):
    wanted = list(scene().render_many(cameras(100)))
    found, killed = [], None
    for image in engine.module.render_many(scene(), cameras(100), **engine.options):
        found.append(image)
        if len(found) == 10:
            killed = kill_one(engine)
    assert killed not in engine.pids()
    assert len(found) == 100 and all(map(same, found, wanted))
    # Files, too: they carry what the image was drawn by.
    for ending in ("png", "exr"):
        found[3].save(tmp_path / f"a.{ending}")
        wanted[3].save(tmp_path / f"b.{ending}")
        assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()
    assert found[3].notes == wanted[3].notes and found[3].scene_file == wanted[3].scene_file


def test_tiles_are_the_whole_though_a_worker_is_killed(engine, tmp_path):
    flags = {"size": (300, 230), "edge_aa": True, "planes": ["color", "depth", "normal", "index", "position"]}
    wanted = scene().render(**flags)
    killed = []
    killer = threading.Timer(0.1, lambda: killed.append(kill_one(engine)))
    killer.start()
    found = engine.module.render(scene(), tiles=16, **flags, **engine.options)
    killer.join()
    assert killed and killed[0] not in engine.pids()
    assert same(found, wanted, ("linear", "rgba", "depth", "normal", "index", "position"))
    found.save(tmp_path / "a.exr")
    wanted.save(tmp_path / "b.exr")
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_files_are_those_of_one_process_and_are_kept(engine, tmp_path, data):
    names = list(engine.module.render_many(surfel.open(data / "disks.ply", size=SIZE), cameras(5),
                                           output=tmp_path / "{name}.exr", **engine.options))
    assert [os.path.basename(name) for name in names] == [f"view{i}.exr" for i in range(5)]
    os.makedirs(tmp_path / "one")
    for image in surfel.open(data / "disks.ply", size=SIZE).render_many(cameras(5)):
        image.save(tmp_path / "one" / f"{image.name}.exr")
        wanted, found = (tmp_path / "one" / f"{image.name}.exr"), (tmp_path / f"{image.name}.exr")
        assert surfel.compare(wanted, found)["max_abs"] == 0
    (tmp_path / "view2.exr").write_bytes(b"mine")
    again = list(engine.module.render_many(surfel.open(data / "disks.ply", size=SIZE), cameras(5),
                                           output=tmp_path / "{name}.exr", **engine.options))
    assert again == names and (tmp_path / "view2.exr").read_bytes() == b"mine"


def test_tiles_of_a_collection_are_converted(engine, tmp_path, data):
    inputs = [data / "points.ply", data / "values.ply", data / "colored.ply"]
    names = list(engine.module.convert(inputs, tmp_path / "{stem}.splats.ply", **engine.options))
    for path, name in zip(inputs, names):
        surfel.convert(path, tmp_path / "one.ply", force=True)
        assert pathlib.Path(name).read_bytes() == (tmp_path / "one.ply").read_bytes()
    assert [pathlib.Path(name).name for name in names] == [f"{path.stem}.splats.ply" for path in inputs]


def test_shares_of_a_collection_are_put_together_though_a_worker_is_killed(engine, tmp_path):
    inputs = [tmp_path / f"{i}.las" for i in range(4)]
    for path, points in zip(inputs, conftest.land(4, 100_000)):
        conftest.las(path, points)
    surfel.convert(inputs, tmp_path / "one.copc.laz")
    output, killed = tmp_path / "all.copc.laz", []

    def kill():
        # While it converts, and not before or after.
        while not list(tmp_path.glob("all.*.shard*")):
            time.sleep(0.01)
        killed.append(kill_one(engine))

    killer = threading.Thread(target=kill)
    killer.start()
    names = list(engine.module.convert(inputs, output, shares=8, **engine.options))
    killer.join()
    assert killed and killed[0] not in engine.pids() and names == [str(output)]
    assert output.read_bytes() == (tmp_path / "one.copc.laz").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        [path.name for path in inputs] + ["one.copc.laz", "all.copc.laz"])
    # A file that exists is left as it is; shares that exist are used, and others' are refused.
    output.write_bytes(b"mine")
    assert list(engine.module.convert(inputs, output, shares=8, **engine.options)) == names
    assert output.read_bytes() == b"mine"
    output.unlink()
    surfel.convert(inputs[:3], tmp_path / "all.0001.shard", shard=(1, 2))
    with pytest.raises(surfel.InputError, match="a shard of other inputs"):
        list(engine.module.convert(inputs, output, shares=2, **engine.options))


def test_errors_are_those_of_one_process(engine):
    render, many = engine.module.render, engine.module.render_many
    with pytest.raises(surfel.UsageError, match="tiles=0"):
        render(scene(), tiles=0, **engine.options)
    with pytest.raises(surfel.UsageError, match="at most as many tiles"):
        render(scene(), tiles=100, size=(8, 8), **engine.options)
    with pytest.raises(TypeError, match="did you mean size"):
        render(scene(), sise=3, **engine.options)
    with pytest.raises(surfel.UsageError, match="{name}"):
        many(scene(), cameras(2), output="a.png", **engine.options)
    with pytest.raises(surfel.UsageError, match="stem"):
        engine.module.convert(["a/x.laz", "b/x.laz"], "{stem}.ply", **engine.options)
    with pytest.raises(surfel.UsageError, match="shares=0"):
        engine.module.convert(["x.laz"], "x.copc.laz", shares=0, **engine.options)
    with pytest.raises(surfel.UsageError, match="attribute"):
        list(many(scene(), cameras(2), color_by="heat", **engine.options))
    with pytest.raises(FileNotFoundError, match="absent.laz"):
        list(engine.module.convert(["absent.laz"], "{stem}.ply", **engine.options))
    assert list(many(scene(), [], **engine.options)) == []


def test_pictures_are_given_as_they_come(engine):
    """A thousand pictures aren't drawn before the first is given, and leaving them ends the work."""
    scene_, start = scene(), time.perf_counter()
    next(many := engine.module.render_many(scene_, cameras(1000), size=(640, 480), **engine.options))
    first = time.perf_counter() - start
    many.close()
    start = time.perf_counter()
    assert len(list(engine.module.render_many(scene_, cameras(30), size=(640, 480), **engine.options))) == 30
    assert first < 15 * (time.perf_counter() - start), "the first of 1000 takes less than half of all"
