"""What the tests share: the program beside which the package is held, and small data."""

import json
import os
import pathlib
import struct
import subprocess

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]


def pytest_configure(config):
    config.addinivalue_line("markers", "engines: needs Ray and Dask, which `cargo xtask test --full` installs")
    config.addinivalue_line("markers", "packages: needs trimesh, PyVista and others, which `--full` installs, too")


def find_program():
    """The program, from SURFEL_PROGRAM or the newest build of this checkout."""
    given = os.environ.get("SURFEL_PROGRAM")
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    built = [target / profile / "surfel" for profile in ("debug", "release")]
    found = [pathlib.Path(given)] if given else [path for path in built if path.is_file()]
    return max(found, key=lambda path: path.stat().st_mtime, default=None)


@pytest.fixture(scope="session")
def program():
    """Runs `surfel` with words in a folder; what it wrote to stdout."""
    path = find_program()
    if path is None:
        pytest.skip("no program: cargo build -p surfel-cli, or SURFEL_PROGRAM")

    def run(folder, *words, data=None):
        done = subprocess.run([path, *map(str, words)], cwd=folder, input=data, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr.decode()
        return done.stdout

    return run


def sphere(count=3000, seed=1):
    """Points of a unit sphere, with colours by position."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z * z)
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    colors = np.rint((points * 0.5 + 0.5) * 255).astype(np.uint8)
    return points, colors


def ply(path, points, colors=None, normals=None, radii=None, attributes=(), face=None):
    """Writes a PLY of text, as another program would."""
    names = ["x", "y", "z"]
    columns = [points]
    header = ["property double x", "property double y", "property double z"]
    if normals is not None:
        header += [f"property double n{axis}" for axis in "xyz"]
        columns.append(normals)
    if radii is not None:
        header.append("property double radius")
        columns.append(radii[:, None])
    if colors is not None:
        kind = "uchar" if colors.dtype == np.uint8 else "float"
        header += [f"property {kind} {name}" for name in ("red", "green", "blue")]
    for name, values in attributes:
        header.append(f"property double {name}")
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *header]
    if face is not None:
        lines += [f"element face {len(face)}", "property list uchar int vertex_indices"]
    lines.append("end_header")
    for i in range(len(points)):
        words = [repr(float(v)) for column in columns for v in column[i]]
        if colors is not None:
            words += [str(v) for v in colors[i].tolist()]
        words += [repr(float(values[i])) for _, values in attributes]
        lines.append(" ".join(words))
    if face is not None:
        lines += [f"3 {a} {b} {c}" for a, b, c in face.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return names


@pytest.fixture(scope="session")
def data(tmp_path_factory):
    """A folder of ten scenes: name to inputs, keywords of open, keywords of render."""
    folder = tmp_path_factory.mktemp("data")
    points, colors = sphere()
    ply(folder / "points.ply", points)
    ply(folder / "colored.ply", points + [1e5, 2e5, 3e3], colors)
    ply(folder / "normals.ply", points, colors, normals=points)
    ply(folder / "disks.ply", points, colors, normals=points, radii=np.full(len(points), 0.05))
    values = [("intensity", points[:, 2]), ("classification", np.arange(3000) % 7)]
    ply(folder / "values.ply", points, attributes=values)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    box = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                    [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    ply(folder / "box.ply", corners, face=box)
    scene = {
        "up": "+z",
        "camera": {"eye": [3, -2, 1.5], "target": [0, 0, 0], "up": [0, 0, 1],
                   "projection": {"perspective": {"fov_y_deg": 45}}, "near": 0.01, "size": [160, 120]},
        "lights": [{"directional": {"direction": [-1, 1, -1], "color": [1, 1, 1], "shadow": True}}],
        "objects": [{"splats": "disks.ply"}, {"mesh": "box.ply", "matrix": [.5, 0, 0, 0, 0, .5, 0, 0, 0, 0, .5, 0, 1, 0,
                                                                            0, 1]}],
        "settings": {"shader": "phong"},
    }
    (folder / "scene.json").write_text(json.dumps(scene))
    return folder


SCENES = {
    "points": (["points.ply"], {}, {}),
    "colored": (["colored.ply"], {}, {"preset": "fast", "view": "front"}),
    "normals": (["normals.ply"], {"radius_scale": 1.5}, {"view": (30, -20.5), "fov_y": 25.0, "shader": "normal"}),
    "disks": (["disks.ply"], {}, {"background": "transparent", "edge_aa": "samples", "filter": "ewa"}),
    "values": (["values.ply"], {"color_by": "intensity", "colormap": "turbo", "range": (-0.5, 0.75)}, {"up": "+z"}),
    "chosen": (["values.ply"], {"color_by": "classification", "classes": [2, 4], "crop": (-1, -1, -1, 1, 1, 0.5)}, {}),
    "box": (["box.ply"], {"splats": 4000}, {"ortho": True, "edge_aa": True, "background": (0.2, 0.3, 0.4, 1)}),
    "sharp": (["box.ply"], {"sharp": True, "crease_angle": 30}, {"eye": (2, 3, 2), "target": [0.5, 0.5, 0.5]}),
    "two": (["points.ply", "box.ply"], {}, {"shader": "toon", "region": (20, 10, 90, 70), "depth_tolerance": "abs:.1"}),
    "scene file": (["scene.json"], {}, {"shadows": True, "transparency": "peel:2"}),
}


def words_of(flags):
    """Keywords as a command line, by other means than the package's."""
    words = []
    for name, value in flags.items():
        flag = "--" + name.replace("_", "-")
        if value is True:
            words.append(flag)
        elif isinstance(value, (tuple, list)):
            joined = ("x" if name == "size" else ",").join(str(part) for part in value)
            words.append(f"{flag}={joined}")
        else:
            words.append(f"{flag}={value}")
    return words


def las(path, points):
    """Writes a LAS file of version 1.2, points of format 0 in steps of 0.001."""
    steps = np.rint(points * 1000).astype("<i4")
    low, high = steps.min(axis=0) / 1000, steps.max(axis=0) / 1000
    head = b"LASF" + bytes(20) + bytes([1, 2]) + bytes(64) + struct.pack("<HHHIIBHI", 1, 2026, 227, 227, 0, 0, 20,
                                                                           len(points))
    head += struct.pack("<5I", len(points), 0, 0, 0, 0) + struct.pack("<6d", .001, .001, .001, 0, 0, 0)
    head += struct.pack("<6d", high[0], low[0], high[1], low[1], high[2], low[2])
    rows = np.zeros((len(points), 20), np.uint8)
    rows[:, :12] = steps.view(np.uint8)
    rows[:, 14], rows[:, 15] = 9, 2
    path.write_bytes(head + rows.tobytes())


def land(tiles, count, seed=3):
    """Points of hills in so many tiles side by side, of `count` points each."""
    random = np.random.default_rng(seed)
    for tile in range(tiles):
        x, y = random.uniform(0, 100, (2, count))
        yield np.stack([x + 100 * tile, y, 5 * np.sin(x / 9) * np.cos(y / 7)], axis=1)
