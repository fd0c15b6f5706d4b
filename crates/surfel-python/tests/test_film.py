"""Films: turntables, camera paths and sequences."""

import struct
import zlib

import numpy as np
import pytest
import surfel
from conftest import sphere

SMALL = {"size": (48, 36), "backend": "cpu"}


def frames(path):
    """Returns the compressed frames of an animated PNG."""
    data, at, found, current = path.read_bytes(), 8, [], b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        chunk = data[at + 8 : at + 8 + length]
        if kind == b"fcTL" and current:
            found.append(current)
            current = b""
        current += chunk if kind == b"IDAT" else chunk[4:] if kind == b"fdAT" else b""
        at += length + 12
    return [zlib.decompress(frame) for frame in [*found, current]]


def test_films_are_those_of_the_images(tmp_path):
    points, _ = sphere(400)
    scene = surfel.scene(points)
    notes = scene.film(tmp_path / "turn.apng", frames=3, fps=5, **SMALL)
    assert "3 frames, 0.6 s at 5 a second, encoded by Surfel as animated PNG" in notes[-1]
    film = frames(tmp_path / "turn.apng")
    assert len(film) == 3 and film[0] != film[1]
    with pytest.raises(FileExistsError):
        scene.film(tmp_path / "turn.apng", frames=3, **SMALL)
    scene.film(tmp_path / "turn.apng", frames=3, force=True, **SMALL)
    assert frames(tmp_path / "turn.apng") == film
    cameras = [image.camera for image in scene.render_many(frames=4, **SMALL)]
    images = list(scene.render_many(path=cameras[:3], frames=5, **SMALL))
    assert [image.name for image in images] == ["0000", "0001", "0002", "0003", "0004"]
    assert np.allclose(images[0].camera.eye, cameras[0].eye) and np.allclose(images[4].camera.eye, cameras[2].eye)
    scene.film(tmp_path / "path.gif", path=cameras[:2], fps=3, backend="cpu")
    assert (tmp_path / "path.gif").read_bytes().startswith(b"GIF89a")
    keys = {"keys": [{"camera": camera.to_dict(), "time": i} for i, camera in enumerate(cameras[:2])]}
    assert len(list(scene.render_many(path=keys, **SMALL))) == 26


def test_sequences_share_one_camera(tmp_path):
    points, _ = sphere(400)
    clouds = [points + [0.3 * i, 0, 0] for i in range(3)]
    notes = surfel.film(clouds, tmp_path / "a.apng", up="+y", view="front", **SMALL)
    assert any(note.startswith("inputs[0]: ") for note in notes) and "3 frames" in notes[-1]
    film = frames(tmp_path / "a.apng")
    assert len(film) == 3 and len(set(film)) == 3
    surfel.film(clouds, tmp_path / "b.apng", up="+y", view="front", turntable=True, **SMALL)
    turned = frames(tmp_path / "b.apng")
    assert len(turned) == 3 and turned[1] != film[1]


def test_wrong_films_are_refused(tmp_path):
    points, _ = sphere(300)
    scene = surfel.scene(points)
    with pytest.raises((OSError, surfel.Error), match="mp4, .gif or .apng"):
        scene.film(tmp_path / "a.avi", frames=2, **SMALL)
    with pytest.raises(surfel.UsageError, match="fps=0"):
        scene.film(tmp_path / "a.gif", fps=0, **SMALL)
    with pytest.raises(surfel.InputError, match="has 1 key"):
        scene.film(tmp_path / "a.gif", path=[surfel.Camera((0, 0, 5), (0, 0, 0), (9, 9), fov_y=40)], **SMALL)
    with pytest.raises(surfel.UsageError, match="contradict"):
        surfel.film([points], tmp_path / "a.gif", turntable=True, path="keys.json")
    with pytest.raises(surfel.InputError, match=r"^inputs\[1\]"):
        surfel.film([points, points[:0]], tmp_path / "a.gif", **SMALL)
    with pytest.raises(TypeError, match="colour"):
        surfel.film([points], tmp_path / "a.gif", colour="red")
    assert not list(tmp_path.iterdir())
