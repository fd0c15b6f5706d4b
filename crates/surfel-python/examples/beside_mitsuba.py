"""Surfel beside Mitsuba 3: the same three scenes below the same sky, with FLIP and CPU-seconds of both.

Each scene stands on a floor, below an even sky and a large light. Mitsuba traces paths of max_depth 2, which is Surfel's
sky without bounce, and of max_depth 6, beside Surfel's bounce. Writes a table in Markdown. Usage: python beside_mitsuba.py
SURFEL FOLDER [SAMPLES [SIDE]], where SURFEL is the program and FOLDER has what `cargo xtask assets` generates;
docs/data/mitsuba.md has what it printed. Needs the packages mitsuba and numpy.
"""

import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import mitsuba as mi
import numpy as np

PROGRAM, ASSETS = sys.argv[1], Path(sys.argv[2])
SAMPLES = int(sys.argv[3]) if len(sys.argv) > 3 else 1024
SIDE = int(sys.argv[4]) if len(sys.argv) > 4 else 512
ABOVE, AREA, HALF_ANGLE_DEG = 0.6, 0.55, 15.0
TOWARD = np.array([-0.55, -0.6, 0.9]) / np.linalg.norm([-0.55, -0.6, 0.9])
FOV_DEG = 40.0
ALBEDO = {"floor": (0.7, 0.7, 0.7), "object": (0.28, 0.44, 0.65)}
FLOOR_HALF, FLOOR_STEPS = 1.5, 160

mi.set_variant("scalar_rgb")


def cpu_seconds(children):
    usage = resource.getrusage(resource.RUSAGE_CHILDREN if children else resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def fitted(points):
    """Points moved and scaled to stand on z = 0 about the origin, at most 1 from it."""
    low, high = points.min(axis=0), points.max(axis=0)
    moved = points - [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
    return moved / np.linalg.norm(moved, axis=1).max()


def read_obj(path, upright):
    vertices, faces = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            corners = [int(word.split("/")[0]) - 1 for word in words[1:]]
            faces += [[corners[0], corners[i], corners[i + 1]] for i in range(1, len(corners) - 1)]
    vertices = np.array(vertices)
    if not upright:
        vertices = vertices[:, [0, 2, 1]] * [1, -1, 1]
    return fitted(vertices), np.array(faces)


def write_obj(path, vertices, faces):
    lines = ["v %.6f %.6f %.6f" % tuple(v) for v in vertices] + ["f %d %d %d" % tuple(f + 1) for f in faces]
    path.write_text("\n".join(lines) + "\n")


def floor():
    """A square at z = 0, finely divided, since Surfel stores light at vertices."""
    line = np.linspace(-FLOOR_HALF, FLOOR_HALF, FLOOR_STEPS)
    x, y = np.meshgrid(line, line)
    vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    i = (np.arange(FLOOR_STEPS - 1)[:, None] * FLOOR_STEPS + np.arange(FLOOR_STEPS - 1)).ravel()
    right, below = i + 1, i + FLOOR_STEPS
    return vertices, np.concatenate([np.stack([i, right, below], 1), np.stack([right, below + 1, below], 1)])


def sky_image():
    """The sky as an environment map in Mitsuba's convention, with its pole at +y."""
    height, width = 1024, 2048
    theta = (np.arange(height) + 0.5) / height * math.pi
    phi = (np.arange(width) + 0.5) / width * 2 * math.pi
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    direction = np.stack([np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta)], axis=-1)
    # From y up to z up.
    world = np.stack([direction[..., 0], -direction[..., 2], direction[..., 1]], axis=-1)
    image = np.where(world[..., 2] > 0, ABOVE, 0.0)
    half = math.radians(HALF_ANGLE_DEG)
    image += np.where(world @ TOWARD > math.cos(half), AREA / math.sin(half) ** 2, 0.0)
    return np.repeat(image[..., None], 3, axis=-1).astype(np.float32)


def mitsuba_image(shapes, eye, target, depth):
    to_world = mi.ScalarTransform4f()
    look_at = to_world.look_at(origin=list(eye), target=list(target), up=[0, 0, 1])
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth, "hide_emitters": True},
        "sensor": {
            "type": "perspective", "fov": FOV_DEG, "fov_axis": "y", "to_world": look_at,
            "film": {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"},
                     "pixel_format": "rgba"},
            "sampler": {"type": "independent", "sample_count": SAMPLES},
        },
        "sky": {
            "type": "envmap", "bitmap": mi.Bitmap(sky_image()), "scale": 1.0,
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], 90),
        },
    }
    scene.update(shapes)
    loaded = mi.load_dict(scene)
    start = cpu_seconds(False)
    image = np.array(mi.render(loaded, spp=SAMPLES))
    return image, cpu_seconds(False) - start


def shape(kind, albedo, **more):
    bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(albedo)}}}
    return {"type": kind, "bsdf": bsdf, **more}


def surfel_image(folder, objects, eye, target, bounce):
    scene = {
        "camera": {"eye": list(eye), "target": list(target), "up": [0, 0, 1],
                   "projection": {"perspective": {"fov_y_deg": FOV_DEG}}, "size": [SIDE, SIDE]},
        "objects": objects,
        "background": [0, 0, 0, 0],
        "sky": {"up": [0, 0, 1], "above": ABOVE, "below": 0.0, "bounce": bounce,
                "areas": [{"toward": list(TOWARD), "half_angle_deg": HALF_ANGLE_DEG, "strength": AREA}]},
        "settings": {"edge_aa": "samples"},
    }
    (folder / "scene.json").write_text(json.dumps(scene))
    start, clock = cpu_seconds(True), time.perf_counter()
    words = [PROGRAM, str(folder / "scene.json"), "-o", str(folder / "surfel.exr"), "--exr-f32", "--force", "--quiet"]
    subprocess.run(words, check=True)
    return cpu_seconds(True) - start, time.perf_counter() - clock


def write_exr(path, image):
    mi.Bitmap(image.astype(np.float32), mi.Bitmap.PixelFormat.RGBA).write(str(path))


def flip(a, b):
    result = subprocess.run([PROGRAM, "compare", str(a), str(b), "--json"], check=True, capture_output=True, text=True)
    return json.loads(result.stdout)["flip"]


def scenes(folder):
    """Names of scenes, their objects in Surfel and shapes in Mitsuba."""
    vertices, faces = floor()
    write_obj(folder / "floor.obj", vertices, faces)
    hexed = {name: "#%02x%02x%02x" % tuple(srgb(c) for c in color) for name, color in ALBEDO.items()}
    ground = {"mesh": "floor.obj", "material": {"color": hexed["floor"]}}
    # The colour after rounding to eight bits.
    albedo = {name: [linear(int(text[i:i + 2], 16)) for i in (1, 3, 5)] for name, text in hexed.items()}
    plane = shape("rectangle", albedo["floor"], to_world=mi.ScalarTransform4f().scale(FLOOR_HALF))

    points = fitted(np.loadtxt(ASSETS / "chair-truth.xyz"))
    radius = 0.02
    points[:, 2] += radius
    np.savetxt(folder / "chair.xyz", points, fmt="%.6f")
    balls = {"splats": "chair.xyz", "material": {"color": hexed["object"]}, "convert": {"points_as": f"balls:{radius}"}}
    spheres = {f"ball{i}": shape("sphere", albedo["object"], center=list(p), radius=radius)
               for i, p in enumerate(points)}
    yield "chair, 2,048 balls", [ground, balls], {"floor": plane, **spheres}

    for name, path, upright in [("Spot", ASSETS.parent / "spot/spot.obj", False), ("part", ASSETS / "part.obj", True)]:
        vertices, faces = read_obj(path, upright)
        write_obj(folder / f"{name}.obj", vertices, faces)
        splats = {"splats": f"{name}.obj", "material": {"color": hexed["object"]}}
        has_facets = name == "part"
        mesh = shape("obj", albedo["object"], filename=str(folder / f"{name}.obj"), face_normals=has_facets)
        shapes = {"floor": plane, "object": mesh}
        yield f"{name}, {len(faces):,} triangles", [ground, splats], shapes


def srgb(linear_value):
    c = linear_value
    return round(255 * (12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055))


def linear(level):
    c = level / 255
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4


def main():
    eye, target = np.array([1.7, -2.6, 1.6]), np.array([0.0, 0.0, 0.4])
    print(f"Mitsuba {mi.__version__} ({mi.variant()}), {SAMPLES} samples, {SIDE}x{SIDE}.\n")
    print("| scene | Surfel | Mitsuba, depth 2 | FLIP | Surfel, bounce | Mitsuba, depth 6 | FLIP |")
    print("| --- | --: | --: | --: | --: | --: | --: |")
    keep = Path(sys.argv[5]) if len(sys.argv) > 5 else None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, objects, shapes in scenes(folder):
            row = [title]
            for bounce, depth in [(False, 2), (True, 6)]:
                ours, _ = surfel_image(folder, objects, eye, target, bounce)
                image, theirs = mitsuba_image(shapes, eye, target, depth)
                write_exr(folder / "mitsuba.exr", image)
                row += [f"{ours:.1f} s", f"{theirs:.1f} s", f"{flip(folder / 'mitsuba.exr', folder / 'surfel.exr'):.4f}"]
                if keep:
                    for file in ["surfel.exr", "mitsuba.exr"]:
                        target_file = keep / f"{title.split(',')[0]}-{depth}-{file}"
                        target_file.write_bytes((folder / file).read_bytes())
            print("| " + " | ".join(row) + " |", flush=True)
    print("\nTimes are CPU-seconds: of Surfel the whole program with reading and encoding, of Mitsuba the call of render.")


main()
