"""Cameras and lights as objects, which scenes share; files that are written again; exceptions."""

import json
import pickle

import numpy as np
import pytest
import surfel
from conftest import sphere

POINTS, COLORS = sphere(800)
SIZE = {"size": (64, 48)}
K, T = [[60.0, 0, 31.5], [0, 62.0, 23.5], [0, 0, 1]], np.eye(4)
T[:3, :3], T[:3, 3] = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]]), [0, 0, 4]


def same(a, b):
    return np.array_equal(a.linear, b.linear) and np.array_equal(a.depth, b.depth)


@pytest.mark.parametrize("flags", [{}, {"view": (30, 40), "ortho": True}, {"view": "top", "fov_y": 20},
                                   {"K": K, "world_from_camera": T}])
def test_an_images_camera_gives_the_image_again(flags):
    scene = surfel.scene(POINTS, colors=COLORS, up="+z")
    image = scene.render(**SIZE, **flags)
    camera = image.camera
    assert camera.near is None and camera.far is None and camera.size == (64, 48)
    lights = {"lights": image.lights} if image.lights is not None else {"shader": "unlit"}
    wanted = image if image.lights is not None else scene.render(**SIZE, **flags, **lights)
    pickled = pickle.loads(pickle.dumps(camera))
    for given in (camera, camera.to_dict(), pickled, surfel.Camera.from_dict(camera.to_dict())):
        again = scene.render(camera=given, **lights)
        assert same(again, wanted) and again.camera == camera == pickle.loads(pickle.dumps(again)).camera
    assert np.isfinite(image.depth).sum() > 100


def test_scenes_share_a_camera_whatever_is_near():
    far = surfel.scene(POINTS, up="+z").render(**SIZE, view=(30, 40))
    eye = np.array(far.camera.eye)
    # A second sphere, between the first and the eye: before the plane that the first one's image has.
    small = surfel.scene(0.05 * POINTS + 0.95 * eye)
    seen = small.render(camera=far.camera, lights=far.lights, shader="phong")
    assert seen.camera == far.camera and np.isfinite(seen.depth).any()
    assert np.nanmax(np.where(np.isfinite(seen.depth), seen.depth, np.nan)) < 0.1 * np.linalg.norm(eye)
    stated = surfel.Camera.from_dict({**far.camera.to_dict(), "near": 0.5 * float(np.linalg.norm(eye))})
    clipped = small.render(camera=stated)
    assert not np.isfinite(clipped.depth).any() and clipped.camera.near == stated.near


def test_cameras_of_files_keep_their_planes(tmp_path):
    image = surfel.scene(POINTS, up="+z").render(**SIZE)
    (tmp_path / "camera.json").write_text(json.dumps({**image.camera.to_dict(), "near": 0.25}))
    of_file = surfel.scene(POINTS).render(camera=tmp_path / "camera.json")
    assert of_file.camera.near == 0.25 and of_file.camera.size == (64, 48)


def test_cameras_are_made_of_numbers_and_of_matrices():
    camera = surfel.Camera.from_matrices(K, T, (64, 48))
    assert np.allclose(camera.K, K) and np.allclose(camera.world_from_camera, T)
    scene = surfel.scene(POINTS, colors=COLORS)
    flags = {"shader": "unlit"}
    wanted = scene.render(K=K, world_from_camera=T, **SIZE, **flags)
    drawn = scene.render(camera=camera, **flags)
    assert np.abs(drawn.linear - wanted.linear).max() < 1e-5 and np.isfinite(drawn.depth).sum() > 100
    lens = surfel.Camera((0, 0, 4), (0, 0, 0), (64, 48), fov_y=45)
    assert lens == surfel.Camera([0, 0, 4], np.zeros(3), np.array([64, 48]), fov_y=45.0) and lens != camera
    assert len({lens, camera, surfel.Camera((0, 0, 4), (0, 0, 0), (64, 48), fov_y=45)}) == 2
    assert np.isclose(lens.K[0, 0], 24 / np.tan(np.radians(22.5))) and np.allclose(lens.world_from_camera, T)
    assert surfel.Camera((0, 0, 4), (0, 0, 0), (64, 48), height=3).K is None and "64x48" in repr(lens)
    # Another size shows the same.
    half = camera.with_size(32, 24)
    assert np.allclose(half.K[:2, :2], 0.5 * camera.K[:2, :2]) and half.size == (32, 24)
    small = scene.render(camera=half, **flags)
    assert abs(np.isfinite(small.depth).mean() - np.isfinite(drawn.depth).mean()) < 0.04


def test_many_cameras_are_any_of_these():
    scene = surfel.scene(POINTS, colors=COLORS, **SIZE)
    lens = surfel.Camera((0, 0, 4), (0, 0, 0), (64, 48), fov_y=45)
    near = surfel.Camera((0, 0, 4), (0, 0, 0), (64, 48), fov_y=45, near=3.5)
    images = list(scene.render_many([(K, T), lens, {"K": K, "world_from_camera": T, "name": "third"}, near]))
    assert [image.name for image in images] == ["0000", "0001", "third", "0003"]
    assert same(images[0], images[2]) and images[1].camera == lens and images[3].camera == near
    assert same(images[0], scene.render(K=K, world_from_camera=T))
    assert np.isfinite(images[1].depth).sum() > np.isfinite(images[3].depth).sum() > 0
    with pytest.raises(surfel.UsageError, match=r"cameras\[1\]: camera.up is parallel"):
        list(scene.render_many([lens, surfel.Camera((0, 4, 0), (0, 0, 0), (8, 8), fov_y=9)]))


def test_lights_are_the_scenes_or_those_given():
    scene = surfel.scene(POINTS, up="+z", view="front", **SIZE)
    image = scene.render()
    assert [list(light) for light in image.lights] == [["directional"]] * 3
    assert same(scene.render(lights=image.lights), image)
    dark = scene.render(lights=[])
    left = scene.render(lights=[{"directional": {"direction": np.array([1, 0, 0])}}])
    right = scene.render(lights={"directional": {"direction": (-1, 0, 0), "color": [1, 0, 0]}})
    assert dark.lights == [] and dark.linear.sum() < left.linear.sum()
    half = np.isfinite(image.depth)
    half[:, 28:] = False
    # Each lights its side alone, and the second is red.
    assert left.linear[half][:, 0].mean() > right.linear[half][:, 0].mean() + 0.1
    assert right.linear[half[:, ::-1]][:, 0].mean() > right.linear[half[:, ::-1]][:, 1].mean() + 0.1
    assert left.lights == [{"directional": {"direction": [1, 0, 0], "color": [1, 1, 1], "shadow": False}}]
    assert scene.render(lights=left.lights, shadows=True).lights[0]["directional"]["shadow"]
    more = [{"point": {"position": (0, -5, 0)}},
            {"spot": {"position": (0, -5, 0), "direction": (0, 1, 0), "inner_deg": 5, "outer_deg": 9}}]
    assert scene.render(lights=more).linear.sum() > dark.linear.sum()
    camera = surfel.Camera((0, -4, 0), (0, 0, 0), (64, 48), fov_y=45, up=(0, 0, 1))
    many = list(surfel.scene(POINTS).render_many([camera], lights=more))
    assert [list(light) for light in many[0].lights] == [["point"], ["spot"]]


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        ({"lights": [{"directional": {"direction": (0, 0, 0)}}]}, r"lights\[0\].direction"),
        ({"lights": [{"sun": {}}]}, r"lights\[0\]: unknown variant `sun`, expected .*directional"),
        ({"lights": [{"point": {"position": (0, 0, float("nan"))}}]}, "lights: .*expected a list of objects"),
        ({"lights": 3}, "lights: 3, expected a list"),
        ({"lights": [{"point": {"position": (0, 0, 0)}}] * 257}, "lights: 257 of them, expected at most 256"),
        ({"camera": {"eye": (0, 0, 1)}}, "camera: has no 'target'"),
        ({"camera": {"eye": (0, 0, 1), "target": (0, 0, 0), "size": (8, 8), "projection": {"fish": {}}}}, "projection"),
        ({"camera": surfel.Camera((0, 0, 4), (0, 0, 4), (8, 8), fov_y=45)}, "eye and camera.target are the same"),
        ({"camera": surfel.Camera((0, 0, 4), (0, 0, 0), (8, 8), fov_y=180)}, "fov_y_deg"),
        ({"camera": surfel.Camera((0, 0, 4), (0, 0, 0), (8, 8), fov_y=9), "view": "top"}, "view and camera contradict"),
    ],
)
def test_wrong_lights_and_cameras_are_usage_errors(flags, said):
    with pytest.raises(surfel.UsageError, match=said):
        surfel.scene(POINTS).render(**flags)


@pytest.mark.parametrize(
    ("given", "kind", "said"),
    [
        ({"size": (8, 8)}, surfel.UsageError, "no projection, expected one of"),
        ({"size": (8, 8), "fov_y": 9, "height": 2}, surfel.UsageError, "fov_y and height, expected one"),
        ({"size": (8, 8), "focal": (9, 9)}, surfel.UsageError, "principal"),
        ({"size": (0, 8), "fov_y": 9}, surfel.UsageError, "size: "),
        ({"size": 8, "fov_y": 9}, surfel.UsageError, "size: 8, expected"),
        ({"size": (8, 8), "fov_y": "wide"}, surfel.UsageError, "fov_y: "),
        ({"size": (8, 8), "fov_y": 9, "up": (0, 1)}, surfel.UsageError, "up: 2 numbers, expected 3"),
    ],
)
def test_cameras_say_what_they_need(given, kind, said):
    with pytest.raises(kind, match=said):
        surfel.Camera((0, 0, 4), (0, 0, 0), **given)


def test_cells_that_write_files_can_be_run_again(tmp_path):
    values = {"attributes": {"e": POINTS[:, 0]}}
    bar, image = tmp_path / "bar.png", tmp_path / "image.png"
    flags = {**SIZE, "color_by": "e", "colorbar": bar}
    for _ in range(2):
        scene = surfel.scene(POINTS, **values)
        scene.render(**flags, force=True).save(image, force=True)
        assert bar.read_bytes().startswith(b"\x89PNG")
    # The same bar may stay, and another one takes its place by force alone.
    surfel.scene(POINTS, **values).render(**flags)
    with pytest.raises(FileExistsError, match="bar.png: already exists: force=True overwrites it"):
        surfel.scene(POINTS, attributes={"e": 2 * POINTS[:, 0]}).render(**flags)
    # It is written by every call, also of what is kept from the last.
    wanted = bar.read_bytes()
    bar.write_bytes(b"another's")
    scene.render(**flags, force=True)
    assert bar.read_bytes() == wanted
    bar.unlink()
    list(scene.render_many(frames=2, **flags, force=True))
    assert bar.read_bytes() == wanted
    ground = POINTS * [9, 9, 1]
    calls = [
        lambda **f: scene.save(tmp_path / "a.ply", **f),
        lambda **f: surfel.convert(scene, tmp_path / "b.ply", color_by="e", colorbar=tmp_path / "c.png", **f),
        lambda **f: surfel.ortho(surfel.scene(ground), tmp_path / "o.tif", gsd=1, dsm=tmp_path / "d.tif", **f),
        lambda **f: surfel.compare(image, image, diff=tmp_path / "diff.png", **f),
        lambda **f: scene.render(**SIZE).save(tmp_path / "i.exr", **f),
    ]
    for number, call in enumerate(calls):
        call()
        with pytest.raises(FileExistsError, match="force=True"):
            call()
        assert call(force=True) is not NotImplemented, number


def test_exceptions_are_those_of_the_manual(tmp_path):
    scene = surfel.scene(POINTS)
    (tmp_path / "text.ply").write_text("no ply")
    (tmp_path / "folder.ply").mkdir()
    for kind, call in [
        (surfel.UsageError, lambda: list(scene.render_many(frames=0))),
        (surfel.UsageError, lambda: list(scene.render_many(frames=-1))),
        (surfel.UsageError, lambda: list(scene.render_many(frames=2_000_000_000))),
        (surfel.UsageError, lambda: list(scene.render_many(frames=10**30))),
        (TypeError, lambda: list(scene.render_many(frames=2.5))),
        (TypeError, lambda: list(scene.render_many(3))),
        (surfel.UsageError, lambda: scene.render(size=(1e30, 8))),
        (surfel.UsageError, lambda: scene.render(size=(8, 8.5))),
        (surfel.UsageError, lambda: scene.render(size=(float("nan"), 8))),
        (surfel.UsageError, lambda: scene.render(fov_y=float("inf"))),
        (surfel.UsageError, lambda: scene.render(threads=10**30)),
        (surfel.UsageError, lambda: scene.render(splats=-(10**30))),
        (TypeError, lambda: scene.render(fov_y=object())),
        (TypeError, lambda: surfel.open(3)),
        (TypeError, lambda: surfel.info(3)),
        (TypeError, lambda: surfel.scene(POINTS, linear=True, colours=COLORS)),
        (TypeError, lambda: surfel.convert(scene)),
        (FileNotFoundError, lambda: scene.render(camera=tmp_path / "none.json")),
        (FileNotFoundError, lambda: scene.render(**SIZE).save(tmp_path / "none" / "a.png")),
        (FileNotFoundError, lambda: scene.save(tmp_path / "none" / "a.ply")),
        (FileNotFoundError, lambda: surfel.compare(tmp_path / "a.png", tmp_path / "b.png")),
        (FileNotFoundError, lambda: surfel.again(tmp_path / "none.png")),
        (FileNotFoundError, lambda: list(scene.render_many(tmp_path / "none"))),
        (FileNotFoundError, lambda: surfel.convert(tmp_path / "none.ply", tmp_path / "a.ply")),
        (FileNotFoundError, lambda: surfel.ortho(tmp_path / "none.laz", tmp_path / "a.tif", gsd=1)),
        (OSError, lambda: surfel.info(tmp_path / "folder.ply")),
        (OSError, lambda: scene.save(tmp_path / "text.ply" / "a.ply")),
        (surfel.InputError, lambda: surfel.info(tmp_path / "text.ply")),
        (surfel.InputError, lambda: surfel.again(tmp_path / "text.ply")),
        (surfel.InputError, lambda: surfel.compare(tmp_path / "text.ply", tmp_path / "text.ply")),
        (surfel.BackendError, lambda: scene.render(backend="gpu")),
        (FileNotFoundError, lambda: surfel.open("a\0b.ply")),
        (OSError, lambda: scene.render(**SIZE).save(tmp_path / "a\0.png")),
    ]:
        with pytest.raises(kind) as caught:
            call()
        assert type(caught.value).__module__ in ("surfel._errors", "builtins"), caught.value
    assert issubclass(surfel.UsageError, ValueError) and issubclass(surfel.InputError, ValueError)
    assert issubclass(surfel.BackendError, RuntimeError) and issubclass(surfel.BackendError, surfel.Error)
