"""Scenes, and how they are drawn."""

from __future__ import annotations

import json
import os

from . import _arrays, _flags, _native
from ._errors import InputError, UsageError
from ._image import Image


def _camera(K, world_from_camera, size, name=None) -> dict:
    """A camera of OpenCV's axes as the JSON that `--cameras` reads."""
    import numpy as np

    def matrix(what, value, shapes):
        array = np.asarray(_arrays._array(what, value), dtype=np.float64)
        if array.shape not in shapes:
            raise InputError(f"{what}: shape {array.shape}, expected {' or '.join(map(str, shapes))}")
        if not np.isfinite(array).all():
            raise InputError(f"{what}: holds numbers that are not finite")
        return array

    K = matrix("K", K, [(3, 3)])
    T = matrix("world_from_camera", world_from_camera, [(4, 4), (3, 4)])
    R = T[:3, :3].T
    camera = {"K": K.tolist(), "R": R.tolist(), "t": (-R @ T[:3, 3]).tolist()}
    if size is not None:
        camera["size"] = [int(side) for side in size]
    if name is not None:
        camera["name"] = str(name)
    return camera


def _listed(cameras, size) -> list[dict]:
    """A list of cameras as the JSON that `--cameras` reads."""
    listed = []
    for i, camera in enumerate(cameras):
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
                raise InputError(f"cameras[{i}]: expected (K, world_from_camera) or a dict of them") from None
        if own is None and size is None:
            raise UsageError(f"size: needed, as in size=(640, 480), or in cameras[{i}]")
        listed.append(_camera(K, T, own, f"{i:04}" if name is None else name))
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
        or a side or (azimuth, elevation) in degrees, `eye`, `target`, `camera_up`, `up`, `region`, `tile=(i, n)` (band i of n of the rows), `fov_y`, `ortho`,
        `camera` (a file), `preset="balanced"`, `filter`, `mapping`, `cutoff`, `prefilter`, `depth_tolerance`,
        `transparency`, `composite`, `sort`, `clip`, `shader`, `matcap`, `lod_error`, `all_levels`, `shadows`, `edge_aa`,
        `background`, `samples`, `backend`, `adapter`, `storage`, `threads`, and those on how files become splats (`open`).

        K: (3, 3), focal lengths and principal point in pixels, counted from the first pixel's centre as OpenCV does;
        it is for images of `size`, which must be given. world_from_camera: (4, 4) or (3, 4), the pose of a camera that
        looks along its +z with y down, as COLMAP's and OpenCV's.

        planes: some of "color", "depth", "normal", "weight"; all of these by default. Fewer are faster. "index",
            "object", "label" and "position" are planes of what is nearest.

        Raises UsageError, InputError, BackendError, OSError, TypeError (an unknown keyword).
        """
        camera = None
        if (K is None) != (world_from_camera is None):
            raise UsageError("K and world_from_camera go together: give both or neither")
        if K is not None:
            size = flags.get("size", self._base.get("size"))
            if size is None:
                raise UsageError("size: needed with K, as in size=(640, 480)")
            camera = json.dumps(_camera(K, world_from_camera, None))
        return Image(self._native.render(self._texts(flags, "render"), _flags.planes_of(planes), camera))

    def render_many(self, cameras=None, *, frames=None, planes=None, **flags):
        """Draws an image from each camera, some at once, and gives them in order; a scene is uploaded once.

        cameras: a file or folder that `--cameras` reads (COLMAP, transforms.json, KITTI, ...), or a list of pairs
        (K, world_from_camera) or of dicts with these, `size` and `name`. Or frames: so many of one turn of the scene
        about its up axis (`--turntable`). Other keywords as in `render`. Images have the cameras' names (`.name`).

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
        return _unpickled, (paths, self._native.data(), self._base)

    def __repr__(self) -> str:
        return f"<surfel.Scene of {'arrays' if self._paths == ['-'] else ', '.join(self._paths)}>"


def _unpickled(paths, data, flags) -> Scene:
    if data is not None:
        import numpy as np

        data = np.frombuffer(data, np.uint8)
    return Scene(_native.Scene(paths, data), paths, flags)


def scene(points, normals=None, colors=None, radii=None, *, attributes=None, faces=None, **flags) -> Scene:
    """A scene of points, a mesh, or disks; what is missing is estimated. Arrays are copied.

    points: (n, 3), any real dtype and strides; float64 keeps its precision. Or an object of torch, Open3D, trimesh,
    PyVista or laspy, whose arrays are taken.
    normals: (n, 3). colors: (n, 3) or (n, 4) with alpha; uint8 and uint16 are sRGB-encoded, floats linear from 0 to 1.
    radii: (n,) or a number, world units; needs normals, and then each point is a disk as it is.
    attributes: names to (n,), which `color_by`, `label`, `where` and `classes` use; with faces to (m,), too.
    faces: (m, 3) whole numbers: a mesh.
    Other keywords as in `open`.

    Raises InputError (shape, values) and TypeError (dtype), naming the argument.
    """
    _flags.texts(flags, _flags.RENDER, "scene")
    given = {"normals": normals, "colors": colors, "radii": radii, "attributes": attributes, "faces": faces}
    found = _arrays.of_object(points) or {"points": points}
    found.update((name, value) for name, value in given.items() if value is not None)
    return Scene(_native.Scene(["-"], _arrays.to_ply(**found)), ["-"], flags)


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
    `outliers`, `allow_outside`, `max_texture` and `memory`. Files are read by the first image.

    Raises FileNotFoundError, TypeError (an unknown keyword).
    """
    _flags.texts(flags, _flags.RENDER, "open")
    if not paths:
        raise TypeError("open() needs a file's name at least")
    names = [os.fspath(path) for path in paths]
    for name in names:
        if not os.path.exists(name):
            raise FileNotFoundError(f"{name}: there is no such file")
    return Scene(_native.Scene(names, None), names, flags)
