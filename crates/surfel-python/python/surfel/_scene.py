"""Scenes, and how they are drawn."""

from __future__ import annotations

import json
import operator
import os

from . import _adapters, _arrays, _flags, _native
from ._camera import Camera, opencv
from ._errors import InputError, UsageError
from ._image import Image


# Levels of large files are chosen for the views of all frames together.
_MOST_FRAMES = 1_000_000


def _listed(cameras, size) -> list[dict]:
    """A list of cameras as the JSON that `--cameras` reads."""
    listed = []
    for i, camera in enumerate(cameras):
        if isinstance(camera, Camera):
            listed.append({"camera": camera.to_dict(), "name": f"{i:04}"})
            continue
        if isinstance(camera, dict):
            unknown = set(camera) - {"K", "world_from_camera", "size", "name"}
            if unknown or not {"K", "world_from_camera"} <= set(camera):
                raise InputError(f"cameras[{i}]: keys {sorted(camera)}, expected K and world_from_camera, and"
                                 " size and name if you like")
            K, T, own, name = (camera.get(k) for k in ("K", "world_from_camera", "size", "name"))
        else:
            try:
                (K, T), own, name = camera, None, None
            except (TypeError, ValueError):
                raise InputError(f"cameras[{i}]: expected (K, world_from_camera), a dict of them or a Camera") from None
        if own is None and size is None:
            raise UsageError(f"size: needed, as in size=(640, 480), or in cameras[{i}]")
        listed.append(opencv(K, T, own, f"{i:04}" if name is None else name))
    return listed


class Scene:
    """Files, or arrays, that make one scene; made by `scene` and `open`.

    What was loaded, estimated and uploaded for an image serves the next. Threads of Python may draw it at once. Pickled
    for another process it is its files' names, which that process loads, or its arrays.
    """

    def __init__(self, native, paths: list[str], flags: dict):
        self._native = native
        self._paths = paths
        self._base = flags

    def _texts(self, flags: dict, where: str):
        return _flags.texts({**self._base, **flags}, _flags.RENDER, where)

    def render(self, *, K=None, world_from_camera=None, planes=None, **flags) -> Image:
        """Draws one image.

        Keywords are the flags of `surfel render`, with its defaults: `size=(width, height)` (1024x1024), `view="auto"`
        or a side or (azimuth, elevation) in degrees, `eye`, `target`, `camera_up`, `up`, `region`, `tile=(i, n)` (band
        i of n of the rows), `fov_y`, `ortho`, `camera` (a Camera, a dict, or a file), `lights`, `preset="balanced"`,
        `filter`, `mapping`, `cutoff`, `prefilter`, `depth_tolerance`, `accumulate`, `transparency`, `composite`,
        `sort`, `clip`, `shader`, `matcap`, `lod_error`, `all_levels`, `shadows`, `edge_aa`, `background`, `samples`, `label`,
        `backend`, `adapter`, `storage`, `threads`, and those on how files become splats (`open`).

        K: (3, 3), focal lengths and principal point in pixels, counted from the first pixel's centre as OpenCV does;
        it is for images of `size`, which must be given. world_from_camera: (4, 4) or (3, 4), the pose of a camera that
        looks along its +z with y down, as COLMAP's and OpenCV's.

        camera: as a scene file has it, such as another image's `camera`. lights: a list of dicts as in a scene file,
        such as `{"directional": {"direction": (0, 0, -1), "color": (1, 1, 1), "shadow": True}}`, `{"point": ...}` and
        `{"spot": ...}`, in place of those that stay with the camera; an empty list leaves the ambient light alone.

        force: overwrites the file that `colorbar` names.

        planes: some of "color", "depth", "normal", "weight"; all of these by default. Fewer are faster. "index",
            "object", "label" and "position" are planes of what is nearest.

        Raises UsageError, InputError, BackendError, OSError (FileNotFoundError and FileExistsError among them),
        TypeError (an unknown keyword), MemoryError.
        """
        camera = None
        if (K is None) != (world_from_camera is None):
            raise UsageError("K and world_from_camera go together: give both or neither")
        if K is not None:
            size = flags.get("size", self._base.get("size"))
            if size is None:
                raise UsageError("size: needed with K, as in size=(640, 480)")
            camera = json.dumps(opencv(K, world_from_camera, None))
        return Image(self._native.render(self._texts(flags, "render"), _flags.planes_of(planes), camera))

    def render_many(self, cameras=None, *, frames=None, planes=None, **flags):
        """Draws an image from each camera, some at once, and gives them in order; a scene is uploaded once.

        cameras: a file or folder that `--cameras` reads (COLMAP, transforms.json, KITTI, ...), or a list of pairs
        (K, world_from_camera), of dicts with these, `size` and `name`, or of Cameras. Or frames: so many of one turn of
        the scene about its up axis (`--turntable`). Other keywords as in `render`. Images have the cameras' names (`.name`).

        Raises what `render` raises; of cameras in files InputError.
        """
        frames = self._many(cameras, frames, planes, flags).start()
        try:
            while (drawn := frames.next()) is not None:
                name, frame = drawn
                yield Image(frame, name)
        finally:
            frames.close()

    def _many(self, cameras, frames, planes, flags):
        """The pictures of `render_many`, none drawn yet."""
        if (cameras is None) == (frames is None):
            raise UsageError("cameras or frames: expected one of them")
        path, text = None, None
        if frames is not None:
            frames = operator.index(frames)
            if not 1 <= frames <= _MOST_FRAMES:
                raise UsageError(f"frames={frames}: expected a whole number from 1 to {_MOST_FRAMES}")
        if isinstance(cameras, (str, os.PathLike)):
            path = os.fspath(cameras)
        elif cameras is not None:
            listed = _listed(cameras, flags.get("size", self._base.get("size")))
            text = json.dumps(listed) if listed else None
        return self._native.many(self._texts(flags, "render_many"), _flags.planes_of(planes), path, text, frames)

    def prepare(self, **flags) -> list[str]:
        """Loads the files and makes splats of them, which the first `render` of these flags would do; what there is to
        say about it."""
        return self._native.prepare(self._texts(flags, "prepare"))

    def info(self) -> dict:
        """`info` of its only file, or of its arrays."""
        from ._files import info

        return info(self)

    def save(self, output, **flags) -> list[str]:
        """Writes its splats: `convert` of its only file, or of its arrays."""
        from ._files import convert

        return convert(self, output, **flags)

    def __reduce__(self):
        # Another process loads the files, or gets the arrays.
        paths = [path if path == "-" else os.path.abspath(path) for path in self._paths]
        return _unpickled, (paths, self._native.data(), self._native.points(), self._native.notes(), self._base)

    def __repr__(self) -> str:
        return f"<surfel.Scene of {'arrays' if self._paths == ['-'] else ', '.join(self._paths)}>"


def _unpickled(paths, data, points, notes, flags) -> Scene:
    if data is not None:
        import numpy as np

        data = np.frombuffer(data, np.uint8)
    return Scene(_native.Scene(paths, data, points, notes), paths, flags)


def scene(
    points, normals=None, colors=None, radii=None, *, attributes=None, faces=None, linear=False, **flags
) -> Scene:
    """A scene of points, a mesh, or disks; what is missing is estimated. Arrays are copied.

    points: (n, 3), any real dtype and strides; float64 keeps its precision. Or an object that holds points or a mesh:
    of trimesh (Trimesh, PointCloud, Scene), PyVista (any data set, MultiBlock), Open3D (legacy and tensor), laspy
    (LasData), or a table with columns x, y and z (pandas, Polars, Arrow, structured arrays of NumPy). Its arrays of
    values are attributes, and arrays that are given besides take the place of its own.
    normals: (n, 3). colors: (n, 3) or (n, 4) with alpha; as displayed (sRGB): uint8, uint16, or floats from 0 to 1.
    linear: True for colours that are floats of linear light, which may exceed 1.
    radii: (n,) or a number, world units: with normals each point is a disk as it is. Without them normals are estimated,
    and radii whose median exceeds five spacings of the points are an attribute instead, which a note says.
    attributes: names to values of each point, (n,), or of each face, (m,), which `color_by`, `where`, `label` and
    `classes` use; NaN is no value. Of vectors, (n, k), the name is their length, and name_0, ... (of three name_x,
    name_y, name_z) are their components.
    faces: (m, 3) or (m, 4) whole numbers: a mesh.
    Other keywords as in `open`.

    Points that are NaN, infinite or masked are left out, which a note says; such colours, radii and corners are
    refused.

    Raises InputError (shape, values) and TypeError (dtype), naming the argument; MemoryError.
    """
    _flags.texts(flags, _flags.RENDER, "scene")
    given = {"normals": normals, "colors": colors, "radii": radii, "attributes": attributes, "faces": faces}
    given = {name: value for name, value in given.items() if value is not None}
    found = _adapters.adapted(points, alone=not given)
    notes, count = [], 0
    if isinstance(found, bytes):
        import numpy as np

        if linear:
            raise UsageError("linear: is for colours that are floats, and this object has none: leave it out")
        data = np.frombuffer(found, np.uint8)
    else:
        arrays = _arrays.with_given(found or _arrays.Arrays(points), given)
        data, count = _arrays.to_ply(arrays, linear, flags.get("repair", False))
        notes = arrays.notes
    return Scene(_native.Scene(["-"], data, count, notes), ["-"], flags)


def again(picture) -> Image:
    """Draws an image again from the scene that it carries, as `surfel again` does; `compare` says whether it is the
    same.

    picture: a PNG or EXR that surfel drew with metadata. Raises InputError for one without, FileNotFoundError.
    """
    path = os.fspath(picture)
    native, flags = _native.Scene.of_picture(path)
    return Scene(native, [path], {name.replace("-", "_"): text for name, text in flags}).render()


def open(*paths, **flags) -> Scene:
    """A scene of one scene file, or of any number of files of splats, points and meshes (docs/inputs.md).

    Keywords are flags of `surfel render`, for all images; those on how files become splats are `repair`, `texture`,
    `per_vertex`, `per_face`, `splats`, `radius_scale`, `max_points`, `cull`, `sharp`, `crease_angle`, `error`,
    `color_by`, `colormap`, `range`, `colorbar`, `crop`, `classes`, `returns`, `where`, `every`, `all_points`,
    `outliers`, `allow_outside`, `max_texture`, `columns` (names of a table's columns: text such as "x,y,z,_,r,g,b", or a
    list of names) and `memory`. Files are read by the first image.

    Raises FileNotFoundError, TypeError (an unknown keyword).
    """
    _flags.texts(flags, _flags.RENDER, "open")
    if not paths:
        raise TypeError("open() needs a file's name at least")
    names = [os.fspath(path) for path in paths]
    for name in names:
        if not os.path.exists(name):
            raise FileNotFoundError(f"{name}: there is no such file")
    return Scene(_native.Scene(names, None, 0, []), names, flags)
