"""Surfel draws a surface from points: scans, point clouds, meshes and splats, without a GPU or a window.

>>> import surfel
>>> image = surfel.scene(points, colors=colors).render(size=(1024, 768))
>>> image.save("scan.png"); image.depth

Every keyword of `Scene.render` is a flag of the program `surfel`, `-` as `_`, with the same default and the same bits:
`surfel render --help` and docs/python.md say what they mean. Arguments that make no sense raise `UsageError`, files and
arrays that are wrong `InputError`, both `ValueError`; backends that aren't here raise `BackendError`. Files raise
Python's own OSErrors, such as FileNotFoundError and FileExistsError; what doesn't fit into memory MemoryError.
"""

from __future__ import annotations

from ._camera import Camera
from ._errors import BackendError, Error, InputError, UsageError
from ._files import backends, compare, convert, info, ortho
from ._image import Image
from ._native import __version__
from ._scene import Scene, again, open, scene

__all__ = [
    "BackendError",
    "Camera",
    "Error",
    "Image",
    "InputError",
    "Scene",
    "UsageError",
    "__version__",
    "again",
    "backends",
    "compare",
    "convert",
    "info",
    "open",
    "ortho",
    "scene",
]
