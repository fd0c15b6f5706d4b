"""Pictures and files by the workers of Ray, which `pip install surfel[ray]` installs.

Actors hold a scene, which each loads once. What they give are the bits of one process; Ray starts a lost one again, and
its task with it. All give their results in order, some tasks ahead of what is taken.
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
    """What the job's tasks give, by so many actors."""
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
    """`Scene.render_many` by `workers` actors (as many as fit) of `threads` cores each.

    output: a name with {name} of files that workers write, in a folder that they share; then the files' names are
    given, and files that exist are left as they are. Raises what `Scene.render_many` raises.
    """
    job = _workers.Frames(scene, cameras, frames, planes, output, {**flags, "threads": threads})
    return _done(job, workers, threads)


def render(scene, *, tiles=16, workers=None, threads=1, **flags) -> Image:
    """`Scene.render`, in so many bands of rows by `workers` actors of `threads` cores each; `stats["frame_ms"]` is what
    they took together. Raises what `Scene.render` raises."""
    job = _workers.Tiles(scene, tiles, {**flags, "threads": threads})
    return joined(list(_done(job, workers, threads)))


def convert(inputs, output, *, shares=16, workers=None, threads=1, **flags):
    """`surfel.convert` of each of the files, by itself; gives the names of what was written.

    output: a name with {stem}, the input's without folder and endings, in a folder that workers share. A name without
    it that ends in .copc.laz is one file of all inputs, the bytes of one process: so many shares of it are written
    beside it, and put together. Files that exist are left as they are, and unfinished shares gone on with. Raises what
    `surfel.convert` raises.
    """
    job = _workers.conversion(inputs, output, shares, {**flags, "threads": threads})
    return _done(job, workers, threads)
