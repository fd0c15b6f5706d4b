"""Surfel beside Open3D and PyVista: the same points from the same camera, and how far depth and normals are from the
exact surface, a torus whose rays are intersected by f64.

Writes a table in Markdown. A rival that isn't installed, or has no way to draw without a display, is said to be left
out. Usage: python rivals.py [POINTS [SIDE]]; docs/data/rivals.md has what it printed.
"""

import sys
import time
from importlib.metadata import version
from importlib.util import find_spec

import numpy as np

import surfel

COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
SIDE = int(sys.argv[2]) if len(sys.argv) > 2 else 512
MAJOR, MINOR = 1.0, 0.4
FOCAL = 1.2 * SIDE
EYE = np.array([2.2, -1.9, 1.7])
REPEATS = 5


def torus():
    """Points spread evenly over the torus, and its normals."""
    rng = np.random.default_rng(1)
    u, v, keep = rng.uniform(0, 2 * np.pi, (3, 2 * COUNT))
    keep = keep / (2 * np.pi) < (MAJOR + MINOR * np.cos(v)) / (MAJOR + MINOR)
    u, v = u[keep][:COUNT], v[keep][:COUNT]
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=1)
    return MAJOR * np.stack([np.cos(u), np.sin(u), 0 * u], axis=1) + MINOR * normals, normals


def axes():
    """Right, down and forward of the camera, as rows."""
    forward = -EYE / np.linalg.norm(EYE)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def exact():
    """Depth along the view and normals of the torus; infinite and zero where a pixel's ray misses it."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    local = np.stack([(x - SIDE / 2) / FOCAL, (y - SIDE / 2) / FOCAL, np.ones_like(x)], axis=-1)
    rays = (local @ axes()).reshape(-1, 3)

    def distance(t):
        p = EYE + rays * t[:, None]
        return np.hypot(np.hypot(p[:, 0], p[:, 1]) - MAJOR, p[:, 2]) - MINOR

    # Sphere tracing finds the first hit; the rays are longer than 1, so steps are shortened.
    t, scale = np.zeros(len(rays)), 1 / np.linalg.norm(rays, axis=1)
    for _ in range(400):
        t = np.minimum(t + distance(t) * scale, 1e3)
    hit = np.abs(distance(t)) < 1e-9
    p = EYE + rays * t[:, None]
    ring = p * [1, 1, 0]
    ring *= MAJOR / np.linalg.norm(ring, axis=1, keepdims=True)
    normals = (p - ring) / MINOR
    depth = np.where(hit, t, np.inf).reshape(SIDE, SIDE)
    return depth, (normals * hit[:, None]).reshape(SIDE, SIDE, 3)


def timed(draw):
    """The median time of a frame in ms, and its planes."""
    planes = draw()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        planes = draw()
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times)), *planes


def of_surfel(points, normals, given):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = axes().T, EYE
    K = [[FOCAL, 0, SIDE / 2 - 0.5], [0, FOCAL, SIDE / 2 - 0.5], [0, 0, 1]]
    scene = surfel.scene(points, normals=normals if given else None, size=(SIDE, SIDE))

    def draw():
        image = scene.render(K=K, world_from_camera=pose, planes=["color", "depth", "normal"])
        return image.depth, image.normal

    return timed(draw)


def of_open3d(points, normals, _):
    import open3d as o3d

    render = o3d.visualization.rendering.OffscreenRenderer(SIDE, SIDE)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    cloud.paint_uniform_color([0.8, 0.8, 0.8])
    material = o3d.visualization.rendering.MaterialRecord()
    material.shader, material.point_size = "normals", 3.0
    render.scene.add_geometry("cloud", cloud, material)
    extrinsic = np.eye(4)
    extrinsic[:3, :3], extrinsic[:3, 3] = axes(), -axes() @ EYE
    render.setup_camera(np.array([[FOCAL, 0, SIDE / 2], [0, FOCAL, SIDE / 2], [0, 0, 1]]), extrinsic, SIDE, SIDE)

    def draw():
        render.render_to_image()
        return np.asarray(render.render_to_depth_image(z_in_view_space=True)), None

    return timed(draw)


def of_pyvista(points, normals, _):
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=(SIDE, SIDE))
    plotter.add_mesh(pv.PolyData(points), style="points", point_size=3.0, lighting=False)
    camera = plotter.camera
    camera.position, camera.focal_point, camera.up = EYE, (0, 0, 0), (0, 0, 1)
    camera.view_angle = 2 * np.degrees(np.arctan(SIDE / 2 / FOCAL))
    camera.clipping_range = (1.0, 8.0)
    plotter.show(auto_close=False)

    def draw():
        plotter.render()
        plotter.screenshot(return_img=True)
        return -np.nan_to_num(plotter.get_image_depth(), nan=-np.inf), None

    return timed(draw)


def main():
    points, normals = torus()
    depth, normal = exact()
    inside = np.isfinite(depth)
    # Pixels whose neighbours are all of the surface and not across a step: edges are a matter of their own.
    steady = inside.copy()
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        other = np.roll(depth, (dy, dx), (0, 1))
        with np.errstate(invalid="ignore"):
            steady &= np.isfinite(other) & (np.abs(other - depth) < 0.05)
    versions = ", ".join(f"{name} {version(name)}" for name in ("surfel", "open3d", "pyvista") if find_spec(name))
    print(f"A torus of {len(points)} points, {SIDE}x{SIDE} pixels; {steady.sum()} pixels inside of its surface;"
          f" {versions}.\n")
    print("| | ms a frame | holes | depth wrong by over 0.05 | median depth error | 95 % | median normal error |")
    print("| --- | --: | --: | --: | --: | --: | --: |")
    rivals = [("surfel", of_surfel, False), ("surfel, normals given", of_surfel, True), ("Open3D", of_open3d, None),
              ("PyVista", of_pyvista, None)]
    for name, draw, given in rivals:
        try:
            ms, found, turned = draw(points, normals, given)
        except Exception as error:  # noqa: BLE001: whatever a rival fails with is what is told
            if draw is of_surfel:
                raise
            text = str(error).strip().splitlines()
            print(f"| {name} | left out: {type(error).__name__} {text[0][:70] if text else ''} | | | | | |")
            continue
        holes = steady & ~np.isfinite(found)
        seen = steady & np.isfinite(found)
        error = np.abs(found[seen] - depth[seen])
        angle = ""
        if turned is not None:
            cosine = np.clip((turned[seen] * normal[seen]).sum(axis=1), -1, 1)
            angle = f"{np.degrees(np.median(np.arccos(cosine))):.2f}°"
        share = f"{100 * holes.sum() / steady.sum():.3f} %"
        far = f"{100 * (error > 0.05).mean():.3f} %"
        row = [name, f"{ms:.1f}", share, far, f"{np.median(error):.5f}", f"{np.percentile(error, 95):.5f}", angle]
        print("| " + " | ".join(row) + " |", flush=True)
        if draw is of_surfel:
            assert not holes.any() and np.median(error) < 2e-3, "surfel's own promise"


if __name__ == "__main__":
    main()
