"""Neighbours and normals of points by Surfel, kiddo, nanoflann, Open3D and CloudCompare: time, memory, and how far the
normals are from those of exact surfaces.

Writes tables in Markdown; docs/data/preparation.md has what it printed. A rival that isn't installed is said to be left
out: pip install numpy open3d pynanoflann; apt-get install cloudcompare. Needs Linux. Usage: python prepare.py [times|normals]
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from importlib.util import find_spec

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
TARGET = HERE.parents[2] / "target" / "rivals"
COUNT = 1_000_000
NEIGHBOURS = 16
THREADS = [1, 2]
RUNS = 3
QUALITY_POINTS = 100_000


def torus(count, seed=1):
    """Points spread evenly over a torus, its normals, their mean distance, and whether an edge is near."""
    rng = np.random.default_rng(seed)
    major, minor = 1.0, 0.4
    u, v, keep = rng.uniform(0, 2 * np.pi, (3, 2 * count))
    keep = keep / (2 * np.pi) < (major + minor * np.cos(v)) / (major + minor)
    u, v = u[keep][:count], v[keep][:count]
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=1)
    points = major * np.stack([np.cos(u), np.sin(u), 0 * u], axis=1) + minor * normals
    return points, normals, np.sqrt(4 * np.pi**2 * major * minor / count), np.zeros(count, bool)


def cube(count, seed=2):
    """As `torus`, of a cube of side 1; an edge is near within two distances between points."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis, sign = rng.integers(0, 3, count), rng.choice([-1.0, 1.0], count)
    normals = np.zeros((count, 3))
    normals[np.arange(count), axis] = sign
    points[np.arange(count), axis] = 0.5 * sign
    spacing = np.sqrt(6 / count)
    from_edge = np.sort(0.5 - np.abs(points), axis=1)[:, 1]
    return points, normals, spacing, from_edge < 2 * spacing


def resident(starts):
    """Bytes in memory, from where on the most of them is noted; or the most since then."""
    if starts:
        pathlib.Path("/proc/self/clear_refs").write_text("5")
    name = "VmRSS:" if starts else "VmHWM:"
    lines = pathlib.Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith(name)).split()[1])


def nanoflann(points, threads):
    from pynanoflann import KDTree

    start = time.perf_counter()
    tree = KDTree(n_neighbors=NEIGHBOURS + 1)
    tree.fit(points)
    tree.kneighbors(points, n_jobs=threads)
    return None, [time.perf_counter() - start, None, None]


def open3d(points, _):
    from open3d import geometry, utility

    cloud = geometry.PointCloud(utility.Vector3dVector(points))
    start = time.perf_counter()
    cloud.estimate_normals(geometry.KDTreeSearchParamKNN(NEIGHBOURS + 1))
    seconds = time.perf_counter() - start
    if os.environ.get("RIVALS_ORIENT"):
        cloud.orient_normals_consistent_tangent_plane(NEIGHBOURS)
    return np.asarray(cloud.normals), [None, seconds, None]


def one(who, threads, source, target):
    """In a process of its own: seconds of the search, of search and normals and of all, and bytes a point."""
    points = np.fromfile(source).reshape(-1, 3)
    rival = {"nanoflann": nanoflann, "open3d": open3d}[who]
    rival(points[:100], 1)
    held = resident(True)
    normals, times = rival(points, threads)
    print(json.dumps([*times, (resident(False) - held) / len(points)]))
    if target is not None:
        normals.tofile(target)


def run(who, threads, source, target=None):
    """What a rival takes; its normals go to a file."""
    if who in ("surfel", "kiddo"):
        words = [TARGET / "release" / "rivals", who, str(threads), source]
    else:
        words = [sys.executable, __file__, "--one", who, str(threads), source]
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
    if target is not None:
        words, environment["RIVALS_ORIENT"] = [*words, target], "1"
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        raise SystemExit(f"{who}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def cloudcompare(source, target):
    """Normals by CloudCompare's own choice of radius and its spanning tree."""
    with tempfile.TemporaryDirectory() as folder:
        text = pathlib.Path(folder) / "in.asc"
        np.savetxt(text, np.fromfile(source).reshape(-1, 3), fmt="%.9f")
        words = ["CloudCompare", "-SILENT", "-AUTO_SAVE", "OFF", "-NO_TIMESTAMP", "-C_EXPORT_FMT", "ASC", "-PREC", "9",
                 "-O", text, "-OCTREE_NORMALS", "AUTO", "-ORIENT_NORMS_MST", str(NEIGHBOURS),
                 "-SAVE_CLOUDS", "FILE", pathlib.Path(folder) / "out.asc"]
        subprocess.run(words, capture_output=True, check=True, env={**os.environ, "QT_QPA_PLATFORM": "offscreen"})
        np.loadtxt(pathlib.Path(folder) / "out.asc")[:, 3:6].tofile(target)


def cell(value, form="{:.2f}"):
    return "" if value is None else form.format(value)


def times(folder, rivals):
    print(f"{COUNT} points of a torus in random order, {NEIGHBOURS} neighbours each; seconds, the fastest of {RUNS} runs, and")
    print("bytes a point besides the points.\n")
    print("| | threads | neighbours, s | normals too, s | splats, s | bytes a point |")
    print("| --- | --: | --: | --: | --: | --: |")
    torus(COUNT)[0].tofile(f"{folder}/points")
    for who in rivals:
        for threads in THREADS:
            runs = [run(who, threads, f"{folder}/points") for _ in range(RUNS)]
            best = [None if column[0] is None else min(column) for column in zip(*runs)]
            cells = [cell(value) for value in best[:3]]
            print(f"| {who} | {threads} | {' | '.join(cells)} | {cell(best[3], '{:.0f}')} |", flush=True)


def normals_of(folder, rivals):
    print(f"Normals of {QUALITY_POINTS} points, moved by so many mean distances between points in each axis (standard")
    print("deviation), against those of the exact surface: angles between lines, and wrong signs, where all are turned")
    print("around if most are wrong. An edge is near within two distances.\n")
    print("| surface | noise | | median | 95 % | over 30° | wrong signs |")
    print("| --- | --: | --- | --: | --: | --: | --: |")
    source, target = f"{folder}/points", f"{folder}/normals"
    for name, make in [("torus", torus), ("cube", cube)]:
        points, normals, spacing, is_edge = make(QUALITY_POINTS)
        for noise in (0.0, 0.7, 1.0):
            moved = np.random.default_rng(7).normal(0, noise * spacing, points.shape) + points
            moved.tofile(source)
            for who in rivals:
                if who == "CloudCompare":
                    cloudcompare(source, target)
                else:
                    run(who, 2, source, target)
                dots = np.sum(np.fromfile(target).reshape(-1, 3) * normals, axis=1)
                angles = np.degrees(np.arccos(np.clip(np.abs(dots), 0, 1)))
                # The rivals don't estimate the outside. A normal that agrees with the majority counts as right, even if
                # all face inward.
                is_wrong = dots * np.sign(np.mean(np.sign(dots))) < 0
                parts = [(name, ~is_edge), (f"{name}, edges", is_edge)] if is_edge.any() else [(name, ~is_edge)]
                for part, chosen in parts:
                    these = angles[chosen]
                    print(f"| {part} | {noise:g} | {who} | {np.median(these):.2f}° | {np.percentile(these, 95):.2f}° | "
                          f"{100 * np.mean(these > 30):.2f} % | {100 * np.mean(is_wrong[chosen]):.2f} % |", flush=True)


def main():
    what = sys.argv[1] if len(sys.argv) > 1 else "all"
    build = ["cargo", "build", "--release", "--quiet", "--manifest-path", HERE / "Cargo.toml", "--target-dir", TARGET]
    subprocess.run(build, check=True)
    rivals, names = ["surfel", "kiddo"], ["kiddo 6"]
    for who, package in [("nanoflann", "pynanoflann"), ("open3d", "open3d")]:
        if find_spec(package) is None:
            print(f"{who} left out: pip install {package}", file=sys.stderr)
            continue
        rivals.append(who)
        names.append(f"{package} {version(package)}")
    oriented = [who for who in rivals if who not in ("kiddo", "nanoflann")]
    if shutil.which("CloudCompare"):
        oriented.append("CloudCompare")
        names.append("CloudCompare of the system")
    with tempfile.TemporaryDirectory() as folder:
        print("<!-- Printed by crates/surfel-bench/rivals/prepare.py. -->\n\n# Preparation beside other programs\n")
        print(f"{', '.join(names)}.\n")
        if what in ("all", "times"):
            times(folder, rivals)
        if what in ("all", "normals"):
            print()
            normals_of(folder, oriented)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        one(sys.argv[2], int(sys.argv[3]), sys.argv[4], sys.argv[5] if len(sys.argv) > 5 else None)
    else:
        main()
