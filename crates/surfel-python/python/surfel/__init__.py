"""Surfel draws surfaces from points: scans, point clouds, meshes and splats, without a GPU or a window.

>>> import surfel
>>> image = surfel.scene(points, colors=colors).render(size=(1024, 768))
>>> image.save("scan.png"); image.depth

Every keyword of `Scene.render` is a flag of the program `surfel`, with `_` in place of `-`. Defaults and images are the
same to the bit. `surfel render --help` and docs/python.md explain the flags.

Invalid arguments raise `UsageError`; invalid files and arrays raise `InputError`. Both are `ValueError`s. An
unavailable backend raises `BackendError`. File errors are Python's own `OSError`s, such as `FileNotFoundError` and
`FileExistsError`. Data that doesn't fit into memory raises `MemoryError`.
"""

from __future__ import annotations

from ._camera import Camera
from ._errors import BackendError, Error, InputError, UsageError
from ._figure import Figure, figure
from ._files import backends, compare, convert, info, ortho
from ._film import film
from ._image import Image
from ._native import __version__
from ._scene import Scene, again, open, scene

__all__ = [
    "BackendError",
    "Camera",
    "Error",
    "Figure",
    "Image",
    "InputError",
    "Scene",
    "UsageError",
    "__version__",
    "again",
    "backends",
    "compare",
    "convert",
    "figure",
    "film",
    "info",
    "open",
    "ortho",
    "scene",
]
