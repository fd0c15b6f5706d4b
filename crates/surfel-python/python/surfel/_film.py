"""Films: sequences of files or arrays."""

from __future__ import annotations

import json
import os
import tempfile

from . import _figure, _flags, _native
from ._camera import Camera
from ._errors import UsageError


def keys(path) -> tuple[str | None, str | None]:
    """Returns a camera path as the name of a file, or as its content."""
    if path is None:
        return None, None
    if isinstance(path, (str, os.PathLike)):
        return os.fspath(path), None
    if isinstance(path, dict):
        return None, json.dumps(path)
    cameras = [camera.to_dict() if isinstance(camera, Camera) else camera for camera in path]
    return None, json.dumps({"keys": [{"camera": camera} for camera in cameras]})


def write(output, frames: int, fps, force: bool, natives) -> str:
    """Writes frames as a film, and returns a note."""
    rate = str(fps)
    film = _native.Film(os.fspath(output), bool(force), frames, rate)
    try:
        for native in natives:
            film.push(native)
        encoder = film.finish()
    finally:
        film.close()
    number = "1 frame" if frames == 1 else f"{frames} frames"
    return f"{os.fspath(output)}: {number}, {frames / float(rate):.1f} s at {rate} a second, encoded by {encoder}"


def film(inputs, output, *, turntable=False, path=None, fps=25, force=False, **flags) -> list[str]:
    """Draws clouds as the frames of one film, as `surfel render --sequence` does.

    Camera, light, up axis, colours and the size of balls are chosen once, from up to 12 of the frames.

    Parameters
    ----------
    inputs : list of path-like, array-like or object
        Files, point arrays of shape (n, 3), or objects that `scene` accepts, a frame for each.
    output : path-like
        A name that ends in .mp4 (encoded by the installed ffmpeg), .gif or .apng.
    turntable : bool
        True turns the scene about its up axis, once over all frames.
    path : path-like, list of Camera, or dict, optional
        A camera path: a file of `--path`, its content, or the cameras that it leads through.
    fps : float
        Frames a second.
    force : bool
        True overwrites an existing file.
    **flags
        Flags of `Scene.render`.

    Returns
    -------
    list of str
        Notes, as the program prints them.

    Raises
    ------
    UsageError, InputError, OSError
    """
    inputs = [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
    if not inputs:
        raise UsageError("inputs: no file, expected one at least")
    if turntable and path is not None:
        raise UsageError("turntable and path contradict each other: give one of them")
    texts = _flags.texts(flags, _flags.RENDER, "film")
    with tempfile.TemporaryDirectory(prefix="surfel-") as folder:
        notes: list[str] = []
        paths = [_figure._path(item, i, folder, notes) for i, item in enumerate(inputs)]
        with _figure.named(paths, folder) as name:
            sequence = _native.Sequence(paths, texts, turntable, keys(path))
            drawn = (sequence.draw(i) for i in range(len(sequence)))
            note = write(output, len(sequence), fps, force, drawn)
            return [*notes, *map(name, sequence.notes), note]
