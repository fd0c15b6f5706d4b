"""Jobs of the worker processes of Ray and Dask. Results are identical to those of one process."""

from __future__ import annotations

import os

from ._errors import UsageError
from ._files import convert
from ._image import Image
from ._scene import Scene

COPC = ".copc.laz"
# Maximum number of tasks of a job: the limit of `--tile` and `--shard`.
MOST = 1_000_000


class Frames:
    """Images of one scene from several cameras or frames. A pickled job holds the scene's inputs."""

    def __init__(self, scene: Scene, cameras, frames, planes, output, flags: dict):
        if cameras is not None and not isinstance(cameras, (str, os.PathLike)):
            cameras = list(cameras)
        self._made_of = scene, cameras, frames, planes, output, flags
        self._output = None if output is None else os.path.abspath(output)
        self._many = scene._many(cameras, frames, planes, flags)
        if self._output is not None and "{name}" not in self._output and len(self._many) > 1:
            raise UsageError(f"output={output!r}: expected {{name}} in the name, for several images")

    def __reduce__(self):
        scene, cameras, frames, planes, _, flags = self._made_of
        return Frames, (scene, cameras, frames, planes, self._output, flags)

    def __len__(self) -> int:
        return len(self._many)

    def draw(self, i: int):
        """Draws image i. Returns the image, or the name of its file."""
        name = self._many.name(i)
        path = None if self._output is None else self._output.replace("{name}", name)
        # A task that a lost worker had ended is begun anew.
        if path is None or not os.path.exists(path):
            image = Image(self._many.draw(i), name)
            if path is None:
                return image
            image.save(path)
        return path


class Tiles:
    """Tiles of one image of a scene. A pickled job holds the scene's inputs."""

    def __init__(self, scene: Scene, tiles: int, flags: dict):
        if not isinstance(tiles, int) or not 1 <= tiles <= MOST:
            raise UsageError(f"tiles={tiles!r}: expected a whole number from 1 to {MOST}")
        self._made_of = scene, tiles, flags
        # Arguments that make no sense are told before workers start.
        given = {name: value for name, value in flags.items() if name not in ("K", "world_from_camera", "planes")}
        scene._texts(given, "render")

    def __reduce__(self):
        return Tiles, self._made_of

    def __len__(self) -> int:
        return self._made_of[1]

    def draw(self, i: int) -> Image:
        scene, tiles, flags = self._made_of
        return scene.render(tile=(i, tiles), **flags)


class Files:
    """Files that are converted independently."""

    def __init__(self, inputs, output: str, flags: dict):
        self._flags = flags
        self._inputs = [os.path.abspath(path) for path in inputs]
        self._outputs = []
        for path in self._inputs:
            stem = os.path.basename(path).split(".")[0]
            self._outputs.append(os.path.abspath(os.fspath(output).replace("{stem}", stem)))
        twice = [path for path in self._outputs if self._outputs.count(path) > 1]
        if twice:
            raise UsageError(f"output={output!r}: {twice[0]} of several inputs, expected {{stem}} and other names")

    def __len__(self) -> int:
        return len(self._inputs)

    def draw(self, i: int) -> str:
        if not os.path.exists(self._outputs[i]):
            convert(self._inputs[i], self._outputs[i], **self._flags)
        return self._outputs[i]


class Shares:
    """Shards of one conversion, as files beside the output, and their merge."""

    def __init__(self, inputs, output: str, shares: int, flags: dict):
        if not isinstance(shares, int) or not 1 <= shares <= MOST:
            raise UsageError(f"shares={shares!r}: expected a whole number from 1 to {MOST}")
        if isinstance(inputs, (str, os.PathLike)):
            inputs = [inputs]
        self._flags = flags
        self._inputs = [os.path.abspath(path) for path in inputs]
        self._output = os.path.abspath(output)
        stem = self._output[:-len(COPC)]
        self._shares = [f"{stem}.{i:04}.shard" for i in range(shares)]

    def __len__(self) -> int:
        return len(self._shares)

    def draw(self, i: int) -> None:
        if not os.path.exists(self._output):
            # What a lost worker had begun is gone on with.
            shard = (i, len(self._shares))
            convert(self._inputs, self._shares[i], **self._flags, shard=shard, resume=True)

    def join(self) -> str:
        if not os.path.exists(self._output):
            convert(self._shares, self._output, **self._flags)
        for path in filter(os.path.exists, self._shares):
            os.remove(path)
        return self._output


def conversion(inputs, output, shares: int, flags: dict):
    """Returns a job that writes one file of all inputs (a .copc.laz without {stem}), or one file for each input."""
    output = os.fspath(output)
    if output.lower().endswith(COPC) and "{stem}" not in output:
        return Shares(inputs, output, shares, flags)
    return Files(inputs, output, flags)


def in_order(job, ahead: int, start, start_join, wait):
    """Starts tasks, up to `ahead` more than are finished, and yields their results in order.

    For a job with `join`, which starts after all tasks, only its result is yielded.
    """
    def each():
        for i in range(len(job)):
            start(i)
            if i >= ahead:
                yield wait()
        for _ in range(min(len(job), ahead)):
            yield wait()

    if not hasattr(job, "join"):
        yield from each()
        return
    for _ in each():
        pass
    start_join()
    yield wait()
