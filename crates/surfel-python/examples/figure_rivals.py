"""The same figure by five programs: 2,048 balls on white, with a soft shadow on the ground where the program has one.

Writes an image by each into FOLDER, and a table of lines of code, seconds and CPU-seconds in Markdown. A program that
isn't installed, or can't draw here, is named with its reason. Each runs in a process of its own. Usage: python
figure_rivals.py POINTS.xyz FOLDER; docs/data/rivals.md has what it printed.
"""

import inspect
import resource
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

SIDE = 512
RADIUS = 0.018


def by_surfel(points, out):
    import surfel
    scene = surfel.scene(points, points_as=f"balls:{RADIUS}", color="steelblue", up="+z")
    image = scene.render(light="studio", bounce=True, ground="shadow", view="40,25", background="white",
                         size=(SIDE, SIDE))
    image.save(out)


def by_pyvista(points, out):
    import pyvista as pv
    plotter = pv.Plotter(off_screen=True, window_size=(SIDE, SIDE), lighting="light kit")
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    plotter.add_mesh(pv.PolyData(points).glyph(geom=pv.Sphere(radius=RADIUS), scale=False), color="steelblue")
    plotter.add_mesh(pv.Plane((0, 0, points[:, 2].min() - RADIUS), (0, 0, 1), 6, 6), color="white")
    plotter.enable_ssao(radius=0.3)
    plotter.enable_shadows()
    plotter.camera_position = [(1.6, -2.0, 1.5), (0, 0, 0.5), (0, 0, 1)]
    plotter.screenshot(out)


def by_open3d(points, out):
    import open3d as o3d
    from open3d.visualization import rendering
    renderer = rendering.OffscreenRenderer(SIDE, SIDE)
    renderer.scene.set_background([1, 1, 1, 1])
    material = rendering.MaterialRecord()
    material.shader, material.base_color = "defaultLit", [0.27, 0.51, 0.71, 1]
    ball = o3d.geometry.TriangleMesh.create_sphere(RADIUS, 12)
    balls = o3d.geometry.TriangleMesh()
    for point in points:
        balls += o3d.geometry.TriangleMesh(ball).translate(point)
    balls.compute_vertex_normals()
    renderer.scene.add_geometry("balls", balls, material)
    renderer.scene.show_ground_plane(True, rendering.Scene.GroundPlane.XY)
    renderer.setup_camera(35, [0, 0, 0.5], [1.6, -2.0, 1.5], [0, 0, 1])
    o3d.io.write_image(out, renderer.render_to_image())


def by_polyscope(points, out):
    import polyscope as ps
    ps.set_allow_headless_backends(True)
    ps.init()
    ps.set_window_size(SIDE, SIDE)
    ps.set_up_dir("z_up")
    ps.set_ground_plane_mode("shadow_only")
    ps.register_point_cloud("chair", points, radius=RADIUS / 2, color=(0.27, 0.51, 0.71))
    ps.look_at((1.6, -2.0, 1.5), (0, 0, 0.5))
    ps.screenshot(out, transparent_bg=False)


def by_hakowan(points, out):
    import hakowan as hkw
    import lagrange
    mesh = lagrange.SurfaceMesh()
    mesh.add_vertices(points)
    layer = hkw.layer(mesh).mark("point").channel(size=RADIUS, material=hkw.material.Plastic("steelblue"))
    config = hkw.config()
    config.z_up()
    config.film.width = config.film.height = SIDE
    hkw.render(layer, config, filename=out, backend="mitsuba")


PROGRAMS = {"surfel": by_surfel, "pyvista": by_pyvista, "open3d": by_open3d, "polyscope": by_polyscope,
            "hakowan": by_hakowan}


def main():
    points, folder = sys.argv[1], Path(sys.argv[2])
    folder.mkdir(exist_ok=True)
    print(f"The same figure of {Path(points).name} at {SIDE}x{SIDE} pixels.\n")
    print("| program | lines | seconds | CPU-seconds | ground shadow |\n| --- | --: | --: | --: | --- |")
    for name, draw in PROGRAMS.items():
        lines = len(inspect.getsource(draw).splitlines()) - 1
        out = folder / f"{name}.png"
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        command = [sys.executable, __file__, points, str(out), name]
        try:
            run = subprocess.run(command, capture_output=True, text=True, timeout=600)
            failed = run.returncode != 0 or not out.exists()
            reason = (run.stderr.strip().splitlines() or ["ended without an image"])[-1]
        except subprocess.TimeoutExpired:
            failed, reason = True, "no image after 600 s"
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        try:
            title = f"{name} {version(name)}"
        except Exception:
            title = name
        if failed:
            print(f"| {title} | {lines} | | | left out: {reason[:90]} |")
            continue
        shadow = {"surfel": "soft", "polyscope": "soft", "hakowan": "none", "pyvista": "hard", "open3d": "none"}[name]
        print(f"| {title} | {lines} | {time.perf_counter() - start:.1f} | {cpu:.1f} | {shadow} |", flush=True)


if len(sys.argv) == 4:
    import numpy
    PROGRAMS[sys.argv[3]](numpy.loadtxt(sys.argv[1]), sys.argv[2])
else:
    main()
