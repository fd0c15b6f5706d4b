"""Arrays of any kind go in; wrong arguments are told apart."""

import ast
import pathlib

import numpy as np
import pytest
import surfel
from conftest import sphere

SMALL = {"size": (48, 36), "planes": ["color", "depth"], "view": "front", "up": "+y"}


def same(a, b):
    return np.array_equal(a.linear, b.linear) and np.array_equal(a.depth, b.depth)


def test_strides_dtypes_and_read_only_arrays_give_the_same_image():
    points, colors = sphere(800)
    single = points.astype(np.float32)
    wanted = surfel.scene(single, colors=colors).render(**SMALL)
    wide = np.zeros((800, 7), np.float32)
    wide[:, ::3] = single
    frozen = single.copy()
    frozen.setflags(write=False)
    for other in (wide[:, ::3], np.asfortranarray(single), single[::-1][::-1], single.astype(np.float64), frozen,
                  single.astype(">f4"), single.tolist(), np.repeat(single, 2, axis=0)[::2]):
        assert same(surfel.scene(other, colors=colors).render(**SMALL), wanted)
    backward = surfel.scene(single[::-1], colors=colors[::-1]).render(**SMALL)
    assert np.isfinite(backward.depth).sum() == np.isfinite(wanted.depth).sum()
    assert np.array_equal(frozen, single), "nothing is written to"
    half = surfel.scene(single.astype(np.float16)).render(**SMALL)
    assert np.isfinite(half.depth).any()


def test_float64_keeps_its_precision_far_from_the_origin():
    points, _ = sphere(800)
    near = surfel.scene(points).render(**SMALL)
    far = surfel.scene(points + [500_000.0, 4_000_000.0, 100.0]).render(**SMALL)
    covered = np.isfinite(near.depth) & np.isfinite(far.depth)
    assert covered.sum() > 300 and np.abs(near.depth[covered] - far.depth[covered]).max() < 1e-3


def test_arrays_are_copied():
    points, _ = sphere(800)
    scene = surfel.scene(points)
    wanted = surfel.scene(points).render(**SMALL)
    points[:] = 0
    assert same(scene.render(**SMALL), wanted)


def test_planes_that_were_not_asked_for_are_told():
    image = surfel.scene(sphere(100)[0]).render(size=(8, 8), planes="depth")
    with pytest.raises(surfel.UsageError, match="normal.*planes"):
        _ = image.normal
    with pytest.raises(surfel.UsageError, match="linear"):
        _ = image.rgba
    assert image._repr_png_() is None
    with pytest.raises(ValueError, match="read-only"):
        image.depth[0, 0] = 1


def test_notebooks_and_other_libraries_take_images():
    image = surfel.scene(sphere(100)[0]).render(size=(8, 6))
    assert image._repr_png_().startswith(b"\x89PNG")
    assert np.array_equal(np.asarray(image), image.rgba) and np.array(image).shape == (6, 8, 4)
    assert "8x6" in repr(image) and image.notes and image.stats["backend"] == "cpu"


POINTS, COLORS = sphere(60)


@pytest.mark.parametrize(
    ("call", "kind", "said"),
    [
        (lambda: surfel.scene(np.zeros((5, 2))), surfel.InputError, r"points: shape \(5, 2\), expected \(n, 3\)"),
        (lambda: surfel.scene(np.zeros((0, 3))), surfel.InputError, "points: holds no point"),
        (lambda: surfel.scene(np.zeros(3)), surfel.InputError, "points: shape"),
        (lambda: surfel.scene(np.zeros((5, 3), complex)), TypeError, "points: dtype complex128"),
        (lambda: surfel.scene("a.ply"), TypeError, "points"),
        (lambda: surfel.scene(POINTS, normals=POINTS[:9]), surfel.InputError, "normals: 9 rows, expected 60"),
        (lambda: surfel.scene(POINTS, colors=COLORS[:, :2]), surfel.InputError, "colors: shape"),
        (lambda: surfel.scene(POINTS).render(where="z>0 and"), surfel.UsageError, "where=.*ends after character 7"),
        (lambda: surfel.scene(POINTS, faces=[[0, 1, 60]]), surfel.InputError, "faces: from 0 to 60"),
        (lambda: surfel.scene(POINTS, sise=3), TypeError, "'sise': did you mean size"),
        (lambda: surfel.scene(POINTS).render(cmap="turbo"), TypeError, "'cmap': did you mean colormap"),
        (lambda: surfel.scene(POINTS).render(size=(0, 5)), surfel.UsageError, "size=0x5: expected WxH"),
        (lambda: surfel.scene(POINTS).render(size={}), surfel.UsageError, "size"),
        (lambda: surfel.scene(POINTS).render(preset="best"), surfel.UsageError, "preset=best: expected fastest"),
        (lambda: surfel.scene(POINTS).render(presett="fast"), TypeError, "render.*presett.*did you mean preset"),
        (lambda: surfel.scene(POINTS).render(view="top", eye=(1, 2, 3)), surfel.UsageError, "view and eye contradict"),
        (lambda: surfel.scene(POINTS).render(planes=["color", "uv"]), surfel.UsageError, "planes: 'uv'"),
        (lambda: surfel.scene(POINTS).render(planes=[]), surfel.UsageError, "planes"),
        (lambda: surfel.scene(POINTS).render(K=np.eye(3)), surfel.UsageError, "K and world_from_camera"),
        (lambda: surfel.scene(POINTS).render(K=np.eye(3), world_from_camera=np.eye(4)), surfel.UsageError, "size"),
        (lambda: surfel.scene(POINTS).render(K=np.eye(4), world_from_camera=np.eye(4), size=(8, 8)),
         surfel.InputError, "K: shape"),
        (lambda: surfel.scene(POINTS).render(K=np.eye(3), world_from_camera=2 * np.eye(4), size=(8, 8)),
         surfel.InputError, "stretches"),
        (lambda: surfel.scene(POINTS).render(splats=10), surfel.UsageError, "holds points, expected a mesh for splats"),
        (lambda: surfel.scene(POINTS).render(color_by="heat"), surfel.UsageError, "attribute 'heat' but height"),
        (lambda: surfel.scene(POINTS).render(crease_angle=30), surfel.UsageError, "crease_angle is for sharp"),
        (lambda: surfel.scene(POINTS).render(backend="vulkan"), surfel.BackendError, "no backend 'vulkan'"),
        (lambda: surfel.scene(POINTS).render(threads=0), surfel.UsageError, "threads"),
        (lambda: surfel.scene(POINTS).render(region=(0, 0, 9999, 1), size=(8, 8)), surfel.UsageError, "region"),
        (lambda: surfel.scene(POINTS).render(samples=2, backend="cpu"), surfel.UsageError, "samples needs"),
        (lambda: surfel.open(), TypeError, "open"),
        (lambda: surfel.open("no such file.ply"), FileNotFoundError, "no such file.ply"),
        (lambda: surfel.open(__file__).render(), surfel.InputError, "test_arguments.py"),
        (lambda: surfel.info("no such file.ply"), FileNotFoundError, "no such file.ply"),
        (lambda: surfel.convert(__file__, "a.obj"), surfel.UsageError, "ends in .ply"),
        (lambda: surfel.compare(np.zeros((4, 4, 3)), np.zeros((4, 5, 3))), surfel.InputError, "equal sizes"),
        (lambda: surfel.compare(np.zeros((4, 4)), 1), surfel.UsageError, "a: an array of shape"),
        (lambda: list(surfel.scene(POINTS).render_many()), surfel.UsageError, "cameras or frames"),
        (lambda: list(surfel.scene(POINTS).render_many([(1, 2, 3)], size=(8, 8))), surfel.InputError, r"cameras\[0\]"),
        (lambda: list(surfel.scene(POINTS).render_many([{"K": 1}])), surfel.InputError, r"cameras\[0\]: keys"),
        (lambda: surfel.scene(POINTS).render(size=(8, 8)).save("a.gif"), surfel.UsageError, "ends in .png"),
    ],
)
def test_wrong_arguments_are_named(call, kind, said):
    with pytest.raises(kind, match=said) as caught:
        call()
    assert "--" not in str(caught.value) and "defect" not in str(caught.value)


def test_existing_files_are_kept(tmp_path):
    (tmp_path / "a.png").write_bytes(b"mine")
    image = surfel.scene(POINTS).render(size=(8, 8))
    with pytest.raises(FileExistsError, match="force=True"):
        image.save(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == b"mine"
    image.save(tmp_path / "a.png", force=True)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_tensors_are_taken_by_their_protocol():
    points, colors = sphere(800)
    wanted = surfel.scene(points, colors=colors).render(**SMALL)

    class Tensor:
        """What torch's tensors do: they give an array when they are detached and in the memory of the CPU."""

        def __init__(self, array, steps=()):
            self.array, self.steps = array, steps

        def detach(self):
            return Tensor(self.array, (*self.steps, "detach"))

        def cpu(self):
            return Tensor(self.array, (*self.steps, "cpu"))

        def numpy(self):
            if self.steps != ("detach", "cpu"):
                raise RuntimeError("requires grad, or is elsewhere")
            return self.array

        def __array__(self, dtype=None, copy=None):
            return self.numpy()

    assert same(surfel.scene(Tensor(points), colors=Tensor(colors)).render(**SMALL), wanted)
    drawn = surfel.scene(Tensor(points), attributes={"e": Tensor(points[:, 0])}, color_by="e").render(**SMALL)
    assert same(drawn, surfel.scene(points, attributes={"e": points[:, 0]}, color_by="e").render(**SMALL))


def test_stubs_know_every_flag():
    from surfel._flags import CONVERT, FIGURE, ORTHO, RENDER, SPLATS

    stub = pathlib.Path(surfel.__file__).with_name("__init__.pyi")
    tree = ast.parse(stub.read_text())
    flags = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            flags[node.name] = {item.target.id for item in node.body if isinstance(item, ast.AnnAssign)}
    assert flags["_RenderFlags"] | flags["_Render"] == RENDER
    assert flags["_Convert"] == CONVERT and flags["_Ortho"] == ORTHO
    assert flags["_Figure"] == FIGURE
    assert SPLATS < RENDER & CONVERT
    defined = {n.name for n in tree.body if isinstance(n, (ast.ClassDef, ast.FunctionDef))} | {"__version__"}
    assert set(surfel.__all__) <= defined
