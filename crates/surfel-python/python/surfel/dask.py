"""Pictures and files by the workers of Dask, which `pip install surfel[dask]` installs.

Workers hold a scene, which each loads once. What they give are the bits of one process; Dask gives the tasks of a lost
worker to others. All give their results in order, some tasks ahead of what is taken.
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
    """What the job's tasks give."""
    client = get_client() if client is None else client
    # It goes to a worker with the first task there, and stays until it is let go.
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
    """`Scene.render_many` by the workers of `client` (the current one), with `threads` cores for each of their threads.

    output: a name with {name} of files that workers write, in a folder that they share; then the files' names are
    given, and files that exist are left as they are. Raises what `Scene.render_many` raises, and ValueError without a
    client.
    """
    job = _workers.Frames(scene, cameras, frames, planes, output, {**flags, "threads": threads})
    return _done(job, client)


def render(scene, *, tiles=16, client=None, threads=1, **flags) -> Image:
    """`Scene.render`, in so many bands of rows by the workers of `client` (the current one); `stats["frame_ms"]` is
    what they took together. Raises what `Scene.render` raises, and ValueError without a client."""
    return joined(list(_done(_workers.Tiles(scene, tiles, {**flags, "threads": threads}), client)))


def convert(inputs, output, *, shares=16, client=None, threads=1, **flags):
    """`surfel.convert` of each of the files, by itself; gives the names of what was written.

    output: a name with {stem}, the input's without folder and endings, in a folder that workers share. A name without
    it that ends in .copc.laz is one file of all inputs, the bytes of one process: so many shares of it are written
    beside it, and put together. Files that exist are left as they are, and unfinished shares gone on with. Raises what
    `surfel.convert` raises, and ValueError without a client.
    """
    return _done(_workers.conversion(inputs, output, shares, {**flags, "threads": threads}), client)
