"""Objects of other packages, by these packages themselves. Run by `cargo xtask test --full`, which installs them."""

import io

import numpy as np
import pytest
import surfel
from conftest import sphere

pytestmark = pytest.mark.packages
FLAT = {"size": (96, 72), "view": "front", "up": "+z", "shader": "unlit", "background": "transparent"}
LIT = {"size": (96, 72), "view": (30, 30), "up": "+z"}
# Of meshes; by themselves they would have more splats.
MESH, FLAT_MESH = {**LIT, "splats": 4000}, {**FLAT, "splats": 4000}
POINTS, COLORS = sphere(2000)


def same(a, b, error=0.0):
    assert np.isfinite(a.depth).sum() > 100
    return np.abs(a.linear - b.linear).max() <= error and np.array_equal(np.isfinite(a.depth), np.isfinite(b.depth))


def kind(thing, **given):
    return surfel.scene(thing, **given).info()["kind"]


def test_trimesh_meshes_stay_meshes():
    import trimesh

    box = trimesh.creation.box()
    wanted = surfel.scene(box.vertices, faces=box.faces).render(**MESH)
    assert kind(box) == "mesh" and same(surfel.scene(box).render(**MESH), wanted)
    ball = trimesh.creation.icosphere(subdivisions=4)
    colors = np.rint((ball.vertices * 0.5 + 0.5) * 255).astype(np.uint8)
    ball.visual.vertex_colors = np.c_[colors, np.full(len(colors), 255, np.uint8)]
    wanted = surfel.scene(ball.vertices, faces=ball.faces, colors=colors).render(**FLAT_MESH)
    assert same(surfel.scene(ball).render(**FLAT_MESH), wanted)
    assert len(np.unique(wanted.rgba.reshape(-1, 4), axis=0)) > 100
    # What is given besides takes its place.
    assert same(surfel.scene(ball, colors=colors[:, ::-1]).render(**FLAT_MESH),
                surfel.scene(ball.vertices, faces=ball.faces, colors=colors[:, ::-1]).render(**FLAT_MESH))
    with pytest.raises(TypeError, match="Path3D, expected an array of real numbers, or a mesh"):
        surfel.scene(trimesh.load_path(np.random.default_rng(0).normal(size=(5, 3))))


def test_trimesh_clouds_and_scenes():
    import trimesh

    wanted = surfel.scene(POINTS, colors=COLORS).render(**FLAT)
    rgba = np.c_[COLORS, np.full(len(COLORS), 255, np.uint8)]
    cloud = trimesh.PointCloud(POINTS, colors=rgba)
    assert kind(cloud) == "points" and same(surfel.scene(cloud).render(**FLAT), wanted)
    assert same(surfel.scene(trimesh.Scene(cloud)).render(**FLAT), wanted)
    # Transforms of a scene are applied, and two meshes are one.
    box, place = trimesh.creation.box(), trimesh.transformations.translation_matrix([3, 0, 0])
    scene = trimesh.Scene([box])
    scene.add_geometry(box, transform=place)
    moved = box.copy().apply_transform(place)
    both = trimesh.util.concatenate([box, moved])
    assert scene.bounds[1, 0] > 3 and kind(scene) == "mesh"
    assert same(surfel.scene(scene).render(**MESH), surfel.scene(both).render(**MESH))
    with pytest.raises(surfel.InputError, match="1 meshes and 1 clouds"):
        surfel.scene(trimesh.Scene([box, cloud]))
    with pytest.raises(surfel.InputError, match="holds nothing to draw"):
        surfel.scene(trimesh.Scene())


def test_trimesh_textures_are_drawn():
    import trimesh
    from PIL import Image

    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], float)
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    checks = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.ones((16, 16), int)).astype(np.uint8) * 255
    uv = [[0, 0], [1, 0], [1, 1], [0, 1]]
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.fromarray(np.stack([checks] * 3, axis=2)))
    for thing in (mesh, trimesh.Scene(mesh)):
        image = surfel.scene(thing, cull="none").render(**{**FLAT, "size": (192, 192)})
        inside = image.linear[image.linear[..., 3] == 1][:, 0]
        # Half of it is black and half white, as in the texture.
        assert 0.3 < (inside < 0.1).mean() < 0.6 and 0.3 < (inside > 0.9).mean() < 0.6


def test_pyvista_meshes_and_their_arrays():
    import pyvista

    cube = surfel.scene(pyvista.Cube())
    assert cube.info()["kind"] == "mesh"
    image = cube.render(**MESH)
    normals = image.normal[np.isfinite(image.depth)]
    # Three flat sides.
    assert np.mean(np.abs(normals).max(axis=1) > 0.99) > 0.9
    ball = pyvista.Sphere(theta_resolution=60, phi_resolution=60)
    colors = np.rint((np.asarray(ball.points) + 0.5) * 255).astype(np.uint8)
    ball["RGB"], ball["Ångström [nm]"] = colors, ball.points[:, 2]
    scene = surfel.scene(ball)
    wanted = surfel.scene(ball.points, faces=ball.regular_faces, colors=colors, normals=ball.point_normals)
    assert same(scene.render(**FLAT_MESH), wanted.render(**FLAT_MESH)) and "colors: the array 'RGB'" in scene.prepare(view="front")
    strips = surfel.scene(ball.strip()).render(**FLAT_MESH)
    assert np.abs(strips.linear - wanted.render(**FLAT_MESH).linear).mean() < 0.02
    for grid in (ball.cast_to_unstructured_grid(), pyvista.MultiBlock({"a": ball, "nothing": None})):
        assert kind(grid) == "mesh" and same(surfel.scene(grid).render(**FLAT_MESH), wanted.render(**FLAT_MESH), 1e-3)


def test_pyvista_points_grids_and_blocks():
    import pyvista

    wanted = surfel.scene(POINTS, colors=COLORS).render(**FLAT)
    cloud = pyvista.PolyData(POINTS)
    cloud["colors"], cloud["height"] = COLORS, POINTS[:, 2]
    for thing in (cloud, cloud.cast_to_unstructured_grid(), pyvista.MultiBlock([cloud])):
        assert kind(thing) == "points" and same(surfel.scene(thing).render(**FLAT), wanted)
    floats = pyvista.PolyData(POINTS)
    floats["rgb"] = COLORS / 255
    assert same(surfel.scene(floats).render(**FLAT), wanted, 1e-5)
    colored = surfel.scene(cloud, color_by="height").render(**FLAT)
    assert same(colored, surfel.scene(POINTS, attributes={"h": POINTS[:, 2]}, color_by="h").render(**FLAT))
    solid = pyvista.ImageData(dimensions=(4, 4, 4))
    scene = surfel.scene(solid)
    assert scene.info()["kind"] == "mesh" and any("outer surface" in note for note in scene.prepare(splats=100))
    x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    assert kind(pyvista.StructuredGrid(x, y, x * y)) == "mesh"
    blocks = pyvista.MultiBlock([pyvista.Cube(), pyvista.Sphere(center=(3, 0, 0))])
    assert np.isfinite(surfel.scene(blocks).render(**MESH).depth).sum() > 300
    with pytest.raises(surfel.InputError, match="1 meshes and 1 clouds"):
        surfel.scene(pyvista.MultiBlock([pyvista.Cube(), cloud]))
    lines = pyvista.PolyData(POINTS, lines=[2, 0, 1])
    assert any("left out the lines" in note for note in surfel.scene(lines).prepare())


def test_pyvista_values_of_cells_go_with_their_faces():
    import pyvista
    from surfel import _adapters

    # Quads and triangles beside a line: its cells come first, and a quad becomes two triangles.
    mixed = pyvista.PolyData(np.random.default_rng(1).normal(size=(7, 3)), faces=[4, 0, 1, 2, 3, 3, 4, 5, 6],
                             lines=[2, 0, 6])
    mixed.cell_data["stress"] = [7.0, 1.0, 2.0]
    found = _adapters.adapted(mixed, True)
    assert found.face_attributes["stress"].tolist() == [1, 1, 2]
    assert found.faces[2].tolist() == [4, 5, 6] and set(found.faces[:2].ravel()) == {0, 1, 2, 3}


def test_vtk_objects_are_read_by_pyvista():
    import vtk

    source = vtk.vtkSphereSource()
    source.Update()
    assert kind(source.GetOutput()) == "mesh"


def test_open3d_objects_legacy_and_tensor():
    import open3d

    wanted = surfel.scene(POINTS, normals=POINTS, colors=COLORS).render(**FLAT)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(POINTS))
    bare = surfel.scene(cloud).render(**LIT)
    assert same(bare, surfel.scene(POINTS).render(**LIT))
    cloud.colors, cloud.normals = open3d.utility.Vector3dVector(COLORS / 255), open3d.utility.Vector3dVector(POINTS)
    tensor = open3d.t.geometry.PointCloud.from_legacy(cloud)
    tensor.point["height"] = open3d.core.Tensor(POINTS[:, 2:].astype(np.float32))
    for thing in (cloud, tensor):
        assert kind(thing) == "points" and same(surfel.scene(thing).render(**FLAT), wanted, 2e-3)
    values = surfel.scene(cloud.points, colors=cloud.colors, normals=cloud.normals)
    assert same(values.render(**FLAT), wanted, 1e-5)
    assert np.ptp(surfel.scene(tensor, color_by="height").render(**FLAT).linear[..., 0]) > 0.5
    mesh = open3d.geometry.TriangleMesh.create_torus()
    wanted = surfel.scene(np.asarray(mesh.vertices), faces=np.asarray(mesh.triangles)).render(**MESH)
    assert kind(mesh) == "mesh" and same(surfel.scene(mesh).render(**MESH), wanted)
    mesh.compute_vertex_normals()
    mesh.paint_uniform_color([1, 0.4, 0])
    for thing in (mesh, open3d.t.geometry.TriangleMesh.from_legacy(mesh)):
        image = surfel.scene(thing).render(**FLAT_MESH)
        inside = image.linear[image.linear[..., 3] == 1]
        assert kind(thing) == "mesh" and np.abs(inside[:, :3] - [1, 0.13287, 0]).max() < 1e-3
    with pytest.raises(surfel.InputError, match="points: holds no point"):
        surfel.scene(open3d.geometry.PointCloud())
    with pytest.raises(TypeError, match="LineSet"):
        surfel.scene(open3d.geometry.LineSet())


def las(count=3000):
    import laspy

    rng = np.random.default_rng(2)
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 4_000_000, 100]
    tile = laspy.LasData(header)
    x, y = rng.uniform(0, 60, (2, count))
    tile.x, tile.y, tile.z = np.stack([x, y, 2 * np.sin(x / 9)]) + np.array(header.offsets)[:, None]
    tile.classification = rng.integers(2, 7, count).astype(np.uint8)
    tile.intensity = np.rint(60 * x).astype(np.uint16)
    tile.red = tile.green = tile.blue = np.rint(1000 * y).astype(np.uint16)
    return tile


def test_laspy_data_are_as_their_file(tmp_path):
    tile = las()
    tile.write(tmp_path / "tile.las")
    flags = {"size": (96, 72), "view": (30, 40)}
    opened = surfel.open(tmp_path / "tile.las")
    for more in ({}, {"color_by": "classification"}, {"color_by": "intensity", "classes": [2, 3]}, {"where": "z>101"}):
        wanted = opened.render(**flags, **more)
        assert same(surfel.scene(tile).render(**flags, **more), wanted), more
    assert same(surfel.scene(tile.points).render(**flags), opened.render(**flags))
    some = tile[np.asarray(tile.classification) == 2]
    assert same(surfel.scene(some).render(**flags, up="+z"), opened.render(**flags, up="+z", classes=[2]))
    told, wanted = surfel.scene(tile).info(), surfel.info(tmp_path / "tile.las")
    assert told["points"] == wanted["points"] and told["classes"] == wanted["classes"]
    # With labels of one's own, what else the file has stays.
    labels = np.arange(len(tile.x)) % 2
    scene = surfel.scene(tile, attributes={"predicted": labels})
    wanted = opened.render(**flags, color_by="intensity")
    assert same(scene.render(**flags, color_by="intensity"), wanted, 1e-3)
    assert len(np.unique(scene.render(**flags, color_by="predicted", shader="unlit").rgba.reshape(-1, 4), axis=0)) > 2
    surfel.ortho(surfel.scene(tile), tmp_path / "o.tif", gsd=2)


def test_tables_of_pandas_polars_and_arrow():
    import pandas
    import polars
    import pyarrow

    columns = {"X": POINTS[:, 0], "Y": POINTS[:, 1], "Z": POINTS[:, 2], "R": COLORS[:, 0].astype(int),
               "G": COLORS[:, 1].astype(int), "B": COLORS[:, 2].astype(int), "err (m)": POINTS[:, 0],
               "kind": ["tree", "house"] * 1000}
    wanted = surfel.scene(POINTS, colors=COLORS).render(**FLAT)
    by_error = surfel.scene(POINTS, attributes={"e": POINTS[:, 0]}, color_by="e").render(**FLAT)
    for table in (pandas.DataFrame(columns), polars.DataFrame(columns), pyarrow.table(columns)):
        scene = surfel.scene(table)
        assert same(scene.render(**FLAT), wanted) and same(scene.render(**FLAT, color_by="err (m)"), by_error)
        assert "points: left out the columns that hold no numbers: kind" in scene.prepare(view="front")
    frame = pandas.DataFrame(columns)
    # Columns and their pieces are arrays; missing values are none.
    assert same(surfel.scene(frame[["X", "Y", "Z"]].to_numpy(), colors=frame[["R", "G", "B"]]).render(**FLAT), wanted)
    frame["n"] = pandas.array([None if i % 3 == 0 else i for i in range(2000)], dtype="Int64")
    given = np.where(np.arange(2000) % 3 == 0, np.nan, np.arange(2000))
    assert same(surfel.scene(frame, color_by="n").render(**FLAT),
                surfel.scene(POINTS, attributes={"n": given}, color_by="n").render(**FLAT))
    read = pandas.read_csv(io.StringIO("x,y,z\n" + "\n".join(f"{x},{y},{z}" for x, y, z in POINTS.tolist())))
    assert same(surfel.scene(read).render(**FLAT), surfel.scene(POINTS).render(**FLAT))
    with pytest.raises(surfel.InputError, match="no columns x, y and z; it has 0, 1, 2"):
        surfel.scene(pandas.DataFrame(POINTS))


def test_tensors_of_torch():
    import torch

    wanted = surfel.scene(POINTS.astype(np.float32), colors=COLORS).render(**FLAT)
    points = torch.tensor(POINTS, dtype=torch.float32, requires_grad=True)
    assert same(surfel.scene(points, colors=torch.from_numpy(COLORS)).render(**FLAT), wanted)
    floats = torch.from_numpy(COLORS) / 255
    assert same(surfel.scene(points, colors=floats).render(**FLAT), wanted, 1e-5)
    assert same(surfel.scene(points, colors=floats.bfloat16()).render(**FLAT), wanted, 1e-2)
    assert same(surfel.scene(points.half()).render(**FLAT), surfel.scene(POINTS.astype(np.float16)).render(**FLAT))
    drawn = surfel.scene(points, attributes={"e": points[:, 2]}, color_by="e").render(**FLAT)
    alone = surfel.scene(POINTS.astype("f4"), attributes={"e": POINTS[:, 2]}, color_by="e").render(**FLAT)
    assert same(drawn, alone, 1e-3)


def test_colors_of_matplotlib_are_as_it_shows_them():
    import matplotlib

    mapped = matplotlib.colormaps["viridis"](0.5 + 0.5 * POINTS[:, 2])
    wanted = surfel.scene(POINTS, colors=(mapped[:, :3] * 255).round().astype(np.uint8)).render(**FLAT)
    image = surfel.scene(POINTS, colors=mapped).render(**FLAT)
    assert np.abs(image.rgba.astype(int) - wanted.rgba).max() <= 1
