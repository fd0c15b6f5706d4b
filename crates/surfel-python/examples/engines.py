"""Ray and Dask on this machine beside one process: 100 cameras of a scene, 16 tiles of an image, and 16 shares of a
conversion. What they give is compared with what one process gives.

Writes a table in Markdown; docs/data/engines.md has what it printed. Usage: python engines.py [WORKERS...]
"""

import pathlib
import struct
import sys
import tempfile
import time
from importlib.metadata import version

import numpy as np

import surfel

WORKERS = [int(word) for word in sys.argv[1:]] or [2, 4]
POINTS, CAMERAS, TILES, SHARES = 200_000, 100, 16, 16
SIZE, POSTER = (640, 480), (4096, 4096)
PLANES = ["color", "depth"]
LAND_TILES, LAND_POINTS = 4, 500_000


def scene():
    i = np.arange(POINTS)
    z, angle = 1 - 2 * (i + 0.5) / POINTS, i * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z * z)
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    return surfel.scene(points, colors=np.rint((points * 0.5 + 0.5) * 255).astype(np.uint8))


def cameras():
    for i in range(CAMERAS):
        c, s = np.cos(i / 9), np.sin(i / 9)
        pose = np.eye(4)
        pose[:3, :3] = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]).T
        pose[:3, 3] = -3 * pose[:3, 2]
        yield {"K": [[700, 0, 319.5], [0, 700, 239.5], [0, 0, 1]], "world_from_camera": pose, "name": f"view{i}"}


def land(folder):
    """Tiles of hills, as LAS 1.2."""
    random, paths = np.random.default_rng(1), []
    for tile in range(LAND_TILES):
        x, y = random.uniform(0, 500, (2, LAND_POINTS))
        steps = np.rint(np.stack([x + 500 * tile, y, 20 * np.sin(x / 40) * np.cos(y / 30)], axis=1) * 100)
        low, high = steps.min(axis=0) / 100, steps.max(axis=0) / 100
        head = b"LASF" + bytes(20) + bytes([1, 2]) + bytes(64)
        head += struct.pack("<HHHIIBHI5I", 1, 2026, 227, 227, 0, 0, 20, LAND_POINTS, LAND_POINTS, 0, 0, 0, 0)
        head += struct.pack("<6d", .01, .01, .01, 0, 0, 0)
        head += struct.pack("<6d", high[0], low[0], high[1], low[1], high[2], low[2])
        rows = np.zeros((LAND_POINTS, 20), np.uint8)
        rows[:, :12] = steps.astype("<i4").view(np.uint8)
        rows[:, 14], rows[:, 15] = 9, 2
        paths.append(folder / f"{tile}.las")
        paths[-1].write_bytes(head + rows.tobytes())
    return paths


class Ray:
    def __init__(self, workers):
        import ray

        self.ray = ray
        ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False)
        import surfel.ray

        self.module, self.options = surfel.ray, {"workers": workers}

    def close(self):
        self.ray.shutdown()


class Dask:
    def __init__(self, workers):
        from distributed import Client, LocalCluster

        self.cluster = LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
        self.client = Client(self.cluster)
        import surfel.dask

        self.module, self.options = surfel.dask, {"client": self.client}

    def close(self):
        self.client.close()
        self.cluster.close()


def timed(make):
    start = time.perf_counter()
    made = make()
    return time.perf_counter() - start, made


def row(name, times):
    print(f"| {name} | {' | '.join(f'{seconds:.1f}' for seconds in times)} |", flush=True)


def main():
    print("<!-- Printed by crates/surfel-python/examples/engines.py. -->\n")
    print("# Ray and Dask beside one process\n")
    print(f"Seconds from the call to the last result, workers of one core each: {CAMERAS} cameras of {POINTS} points at")
    print(f"{SIZE[0]}x{SIZE[1]}; {TILES} tiles of {POSTER[0]}x{POSTER[1]}; {SHARES} shares of {LAND_TILES} LAS tiles of")
    print(f"{LAND_POINTS} points, and the COPC of them. Each worker estimates the scene's normals. All give one process'")
    print(f"bytes. ray {version('ray')}, distributed {version('distributed')}.\n")
    print("| | cameras | tiles | shares |")
    print("| --- | --: | --: | --: |")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        inputs, one = land(folder), folder / "one.copc.laz"
        for threads in (1, 2):
            frames = timed(lambda: list(scene().render_many(cameras(), size=SIZE, planes=PLANES, threads=threads)))
            poster = timed(lambda: scene().render(size=POSTER, planes=PLANES, threads=threads))
            copc = timed(lambda: surfel.convert(inputs, one, threads=threads, force=True))
            row(f"one process, {threads} thread{'s' * (threads > 1)}", [frames[0], poster[0], copc[0]])
        wanted_frames, wanted_poster, wanted = frames[1], poster[1], one.read_bytes()
        for kind in (Ray, Dask):
            for workers in WORKERS:
                engine, output = kind(workers), folder / f"{kind.__name__}-{workers}.copc.laz"
                many, options = engine.module.render_many, engine.options
                frames = timed(lambda: list(many(scene(), cameras(), size=SIZE, planes=PLANES, **options)))
                poster = timed(lambda: engine.module.render(scene(), tiles=TILES, size=POSTER, planes=PLANES, **options))
                copc = timed(lambda: list(engine.module.convert(inputs, output, shares=SHARES, **options)))
                engine.close()
                same = all(np.array_equal(a.linear, b.linear) for a, b in zip(frames[1], wanted_frames))
                if not same or not np.array_equal(poster[1].linear, wanted_poster.linear):
                    raise SystemExit(f"{kind.__name__} draws other pictures than one process")
                if output.read_bytes() != wanted:
                    raise SystemExit(f"{kind.__name__} converts to other bytes than one process")
                row(f"{kind.__name__}, {workers} workers", [frames[0], poster[0], copc[0]])


if __name__ == "__main__":
    main()
