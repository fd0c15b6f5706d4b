"""Rendering and conversion on workers of Dask, which `pip install surfel[dask]` installs.

Each worker loads the scene once. Results are identical to those of one process. Dask gives the tasks of a lost
worker to others. Results are yielded in order; workers run a few tasks ahead of the result that is read.
"""

from __future__ import annotations

from collections import deque

from distributed import get_client

from . import _workers
from ._image import Image, joined


def _held(job):
    return job


def _draw(job, i):
    return job.draw(i)


def _join(job):
    return job.join()


def _done(job, client):
    """Yields the results of the job's tasks."""
    client = get_client() if client is None else client
    # The job is copied to a worker with its first task there, and stays in memory until it is released.
    held = client.submit(_held, job, pure=False)
    tasks = deque()
    try:
        start = lambda i: tasks.append(client.submit(_draw, held, i, pure=False))  # noqa: E731
        join = lambda: tasks.append(client.submit(_join, held, pure=False))  # noqa: E731
        ahead = 2 * max(1, sum(client.nthreads().values()))
        yield from _workers.in_order(job, ahead, start, join, lambda: tasks.popleft().result())
    finally:
        client.cancel(list(tasks))


def render_many(scene, cameras=None, *, frames=None, planes=None, output=None, client=None, threads=1, **flags):
    """Renders images as `Scene.render_many` does, on workers of Dask. Yields images in order, identical to those of one
    process.

    Parameters
    ----------
    scene, cameras, frames, planes, **flags
        As in `Scene.render_many`.
    output : path-like, optional
        A file name with {name}, in a folder that all workers share. Workers write the files, whose names are yielded in
        place of images. Existing files are kept.
    client : distributed.Client, optional
        The current client by default.
    threads : int
        Cores of each thread of a worker.

    Raises
    ------
    ValueError
        There is no client.
    Exception
        As in `Scene.render_many`.
    """
    job = _workers.Frames(scene, cameras, frames, planes, output, {**flags, "threads": threads})
    return _done(job, client)


def render(scene, *, tiles=16, client=None, threads=1, **flags) -> Image:
    """Renders one image as `Scene.render` does, in tiles, on workers of Dask.

    Parameters
    ----------
    tiles : int
        Number of tiles.
    scene, **flags
        As in `Scene.render`.
    client : distributed.Client, optional
        The current client by default.
    threads : int
        Cores of each thread of a worker.

    Returns
    -------
    Image
        Its `stats["frame_ms"]` is the sum over all tiles.

    Raises
    ------
    ValueError
        There is no client.
    Exception
        As in `Scene.render`.
    """
    return joined(list(_done(_workers.Tiles(scene, tiles, {**flags, "threads": threads}), client)))


def convert(inputs, output, *, shares=16, client=None, threads=1, **flags):
    """Converts files as `surfel.convert` does, on workers of Dask. Yields the names of the written files.

    Parameters
    ----------
    inputs : list of path-like
    output : path-like
        A file name in a folder that all workers share. {stem} stands for the input's name without folder and
        extension. A name without {stem} that ends in .copc.laz is one file of all inputs, identical to that of one
        process. Existing files are kept, and unfinished shards are continued.
    shares : int
        Number of shards of a .copc.laz, which are written beside it and merged.
    client : distributed.Client, optional
        The current client by default.
    threads : int
        Cores of each thread of a worker.
    **flags
        As in `surfel.convert`.

    Raises
    ------
    ValueError
        There is no client.
    Exception
        As in `surfel.convert`.
    """
    return _done(_workers.conversion(inputs, output, shares, {**flags, "threads": threads}), client)
