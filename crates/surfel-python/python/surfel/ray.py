"""Rendering and conversion on workers of Ray, which `pip install surfel[ray]` installs.

Each actor loads the scene once. Results are identical to those of one process. Ray restarts a lost actor and its task.
Results are yielded in order; workers run a few tasks ahead of the result that is read.
"""

from __future__ import annotations

import ray
from ray.util import ActorPool

from . import _workers
from ._image import Image, joined


class _Actor:
    def __init__(self, job):
        self._job = job

    def draw(self, i):
        return self._job.draw(i)

    def join(self):
        return self._job.join()


def _done(job, workers, threads):
    """Yields the results of the job's tasks."""
    if not ray.is_initialized():
        ray.init()
    cpus = int(ray.cluster_resources().get("CPU", 1)) // threads
    workers = max(1, min(cpus if workers is None else workers, len(job)))
    actor = ray.remote(num_cpus=threads, max_restarts=-1, max_task_retries=-1)(_Actor)
    shared = ray.put(job)
    actors = [actor.remote(shared) for _ in range(workers)]
    pool = ActorPool(actors)
    try:
        start = lambda i: pool.submit(lambda actor, i: actor.draw.remote(i), i)  # noqa: E731
        join = lambda: pool.submit(lambda actor, _: actor.join.remote(), None)  # noqa: E731
        yield from _workers.in_order(job, 2 * workers, start, join, pool.get_next)
    finally:
        for one in actors:
            ray.kill(one)


def render_many(scene, cameras=None, *, frames=None, planes=None, output=None, workers=None, threads=1, **flags):
    """Renders images as `Scene.render_many` does, on workers of Ray. Yields images in order, identical to those of one
    process.

    Parameters
    ----------
    scene, cameras, frames, planes, **flags
        As in `Scene.render_many`.
    output : path-like, optional
        A file name with {name}, in a folder that all workers share. Workers write the files, whose names are yielded in
        place of images. Existing files are kept.
    workers : int, optional
        Number of actors; as many as the cluster has cores for by default.
    threads : int
        Cores of each actor.

    Raises
    ------
    Exception
        As in `Scene.render_many`.
    """
    job = _workers.Frames(scene, cameras, frames, planes, output, {**flags, "threads": threads})
    return _done(job, workers, threads)


def render(scene, *, tiles=16, workers=None, threads=1, **flags) -> Image:
    """Renders one image as `Scene.render` does, in tiles, on workers of Ray.

    Parameters
    ----------
    tiles : int
        Number of tiles.
    scene, **flags
        As in `Scene.render`.
    workers : int, optional
        Number of actors; as many as the cluster has cores for by default.
    threads : int
        Cores of each actor.

    Returns
    -------
    Image
        Its `stats["frame_ms"]` is the sum over all tiles.

    Raises
    ------
    Exception
        As in `Scene.render`.
    """
    job = _workers.Tiles(scene, tiles, {**flags, "threads": threads})
    return joined(list(_done(job, workers, threads)))


def convert(inputs, output, *, shares=16, workers=None, threads=1, **flags):
    """Converts files as `surfel.convert` does, on workers of Ray. Yields the names of the written files.

    Parameters
    ----------
    inputs : list of path-like
    output : path-like
        A file name in a folder that all workers share. {stem} stands for the input's name without folder and
        extension. A name without {stem} that ends in .copc.laz is one file of all inputs, identical to that of one
        process. Existing files are kept, and unfinished shards are continued.
    shares : int
        Number of shards of a .copc.laz, which are written beside it and merged.
    workers : int, optional
        Number of actors; as many as the cluster has cores for by default.
    threads : int
        Cores of each actor.
    **flags
        As in `surfel.convert`.

    Raises
    ------
    Exception
        As in `surfel.convert`.
    """
    job = _workers.conversion(inputs, output, shares, {**flags, "threads": threads})
    return _done(job, workers, threads)
