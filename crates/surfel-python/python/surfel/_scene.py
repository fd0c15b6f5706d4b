"""Scenes and rendering."""

from __future__ import annotations

import json
import operator
import os

from . import _adapters, _arrays, _film, _flags, _native
from ._camera import Camera, opencv
from ._errors import InputError, UsageError
from ._image import Image


# Largest number of frames of a film: levels of large files are chosen for the views of all frames together.
_MOST_FRAMES = 1_000_000


def _listed(cameras, size) -> list[dict]:
    """Returns a list of cameras in the JSON format of `--cameras`."""
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
    """Files or arrays that form one scene. `scene` and `open` create scenes.

    Everything that is loaded, estimated and uploaded for an image is reused by the next. Several Python threads may
    render a scene at the same time. A pickled scene holds the names of its files, which the other process loads, or
    its arrays.
    """

    def __init__(self, native, paths: list[str], flags: dict):
        self._native = native
        self._paths = paths
        self._base = flags

    def _texts(self, flags: dict, where: str):
        return _flags.texts({**self._base, **flags}, _flags.RENDER, where)

    def render(self, *, K=None, world_from_camera=None, planes=None, **flags) -> Image:
        """Renders one image.

        Parameters
        ----------
        K : array of shape (3, 3), optional
            Focal lengths and principal point in pixels. Coordinates start at the centre of the first pixel, as in
            OpenCV. `size` is required with it.
        world_from_camera : array of shape (4, 4) or (3, 4), optional
            Pose of a camera that looks along its +z with y down, as in COLMAP and OpenCV. K and the pose need each
            other.
        planes : str or list of str, optional
            Planes to compute: "color", "depth", "normal" and "weight" (the default), "index", "object", "label" and
            "position" of the nearest surface, and "alpha", "median_depth" and "distortion" of trained Gaussians.
            Fewer planes are faster.
        camera : Camera, dict or path-like, optional
            A camera as in a scene file, such as another image's `camera`.
        lights : list of dict, optional
            Lights as in a scene file, such as `{"directional": {"direction": (0, 0, -1), "color": (1, 1, 1),
            "shadow": True}}`, `{"point": ...}` and `{"spot": ...}`. They replace the lights that follow the camera.
            An empty list leaves only ambient light.
        force : bool
            True overwrites the file that `colorbar` names.
        **flags
            Other flags of `surfel render`, with its defaults: `size=(width, height)` in pixels (1024x1024),
            `view="auto"` or a side or (azimuth, elevation) in degrees, `eye`, `target`, `camera_up`, `up`, `region`,
            `tile=(i, n)` (tile i of n, from the top), `fov_y` in degrees, `ortho`, `preset="balanced"`, `filter`,
            `mapping`, `cutoff`, `prefilter`, `depth_tolerance`, `accumulate`, `transparency`, `composite`, `sort`,
            `clip`, `shader`, `matcap`, `lod_error`, `all_levels`, `points_as`, `shadows`, `edge_aa`, `background`,
            `samples`, `label`, `backend`, `adapter`, `storage`, `threads`, and the keywords of `open` that control how files
            become splats.

        Returns
        -------
        Image

        Raises
        ------
        UsageError, InputError, BackendError
        OSError
            A file can't be read or written; also as FileNotFoundError and FileExistsError. Or the system allows no more
            threads.
        TypeError
            A keyword is unknown.
        MemoryError
            The scene, the image or the threads' stacks don't fit into memory.
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

    def render_many(self, cameras=None, *, frames=None, path=None, planes=None, **flags):
        """Renders an image from each camera, and yields images in order. The scene is uploaded once.

        Parameters
        ----------
        cameras : path-like or list, optional
            A file or folder that `--cameras` reads (COLMAP, transforms.json, KITTI, ...), or a list of Cameras, of
            pairs (K, world_from_camera), or of dicts with K, world_from_camera and optionally `size` and `name`.
        frames : int, optional
            Number of frames of one turn about the scene's up axis (`--turntable`), or along `path`, in place of
            `cameras`.
        path : path-like, list of Camera, or dict, optional
            A camera path: a file of `--path`, its content, or the cameras that it leads through.
        planes, **flags
            As in `render`.

        Yields
        ------
        Image
            Its `name` is the camera's name.

        Raises
        ------
        InputError
            A file of cameras is damaged, or a camera is invalid.
        Exception
            As in `render`.
        """
        frames = self._many(cameras, frames, planes, flags, path).start()
        try:
            while (drawn := frames.next()) is not None:
                name, frame = drawn
                yield Image(frame, name)
        finally:
            frames.close()

    def film(self, output, *, frames=None, path=None, cameras=None, fps=25, force=False, **flags) -> list[str]:
        """Draws a film: one turn about the scene's up axis, or along a path of the camera.

        Parameters
        ----------
        output : path-like
            A name that ends in .mp4 (encoded by the installed ffmpeg), .gif or .apng.
        frames : int, optional
            Number of frames. By default a turn lasts 4 seconds, and a path as long as its times state, or 2 seconds
            from key to key.
        path, cameras
            As in `render_many`; without both, the scene turns.
        fps : float
            Frames a second; a GIF has at most 50.
        force : bool
            True overwrites an existing file.
        **flags
            As in `render`.

        Returns
        -------
        list of str
            Notes, as the program prints them.

        Raises
        ------
        FileExistsError
            The file exists and `force` is False.
        Exception
            As in `render`.
        """
        if frames is None and cameras is None:
            frames = _native.film_frames(_film.keys(path), str(fps))
        many = self._many(cameras, frames, "color", flags, path)
        notes: list[str] = []

        def natives():
            drawn = many.start()
            try:
                while (one := drawn.next()) is not None:
                    notes[:] = Image(one[1]).notes
                    yield one[1]
            finally:
                drawn.close()

        note = _film.write(output, len(many), fps, force, natives())
        return [*notes, note]

    def _many(self, cameras, frames, planes, flags, path=None):
        """Prepares the images of `render_many` without drawing any."""
        keys = _film.keys(path)
        if path is not None and frames is None and cameras is None:
            frames = _native.film_frames(keys, "25")
        if (cameras is None) == (frames is None):
            raise UsageError("cameras or frames: expected one of them")
        file, text = None, None
        if frames is not None:
            frames = operator.index(frames)
            if not 1 <= frames <= _MOST_FRAMES:
                raise UsageError(f"frames={frames}: expected a whole number from 1 to {_MOST_FRAMES}")
        if isinstance(cameras, (str, os.PathLike)):
            file = os.fspath(cameras)
        elif cameras is not None:
            listed = _listed(cameras, flags.get("size", self._base.get("size")))
            text = json.dumps(listed) if listed else None
        return self._native.many(self._texts(flags, "render_many"), _flags.planes_of(planes), file, text, (frames, keys))

    def widget(self, *, height: int = 500, **flags):
        """Shows the scene in a notebook, to turn, colour, clip and pick: the page of `surfel view`.

        This Python process draws. In a notebook without widgets, and in its file, it is a still image. Needs the
        package anywidget: `pip install 'surfel[widget]'`.

        Parameters
        ----------
        height : int
            Height in the notebook in CSS pixels.
        **flags
            Where the page begins, as in `render`, except `lights` and `camera`.

        Returns
        -------
        anywidget.AnyWidget
            With the attributes `camera` and `picked`, which can be observed.

        Raises
        ------
        ImportError
            The package anywidget is missing.
        UsageError
            A flag is invalid.
        """
        from . import _widget

        return _widget.widget(self, height, flags)

    def prepare(self, **flags) -> list[str]:
        """Loads the files and converts them to splats, as the first `render` with these flags would do.

        Returns
        -------
        list of str
            Notes, as the program prints them.
        """
        return self._native.prepare(self._texts(flags, "prepare"))

    def info(self) -> dict:
        """Describes the scene's only file or its arrays, as `surfel.info` does."""
        from ._files import info

        return info(self)

    def save(self, output, **flags) -> list[str]:
        """Writes the scene's splats, as `surfel.convert` does."""
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
    """Creates a scene from arrays of points, a mesh, or disks. Missing normals and radii are estimated. Arrays are
    copied.

    Parameters
    ----------
    points : array of shape (n, 3), or object
        Positions of any real dtype and strides, in world units; float64 keeps its precision. Also accepted are
        objects of trimesh (Trimesh, PointCloud, Scene), PyVista (any data set, MultiBlock), Open3D (legacy and
        tensor) and laspy (LasData), and tables with columns x, y and z (pandas, Polars, Arrow, structured arrays of
        NumPy). Values of an object become attributes. Other arguments replace the object's own arrays.
    normals : array of shape (n, 3), optional
        Directions of any length.
    colors : array of shape (n, 3) or (n, 4), optional
        sRGB colours as uint8, uint16, or floats from 0 to 1, optionally with alpha.
    radii : array of shape (n,), or float, optional
        Radii in world units. With normals, each point is drawn as a disk of its radius. Without normals, normals are
        estimated; if the median radius exceeds five point spacings, the radii become an attribute and a note says so.
    attributes : dict, optional
        Values by name, of shape (n,) for points or (m,) for faces, for `color_by`, `where`, `label` and `classes`.
        NaN means no value. Of vectors, of shape (n, k), the name is the length, and name_0, ... are components
        (name_x, name_y and name_z for k = 3).
    faces : int array of shape (m, 3) or (m, 4), optional
        Rows of `points`, which then form a mesh.
    linear : bool
        True if colours are floats of linear light, which may exceed 1.
    **flags
        As in `open`.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        An array has the wrong shape or invalid values. NaN, infinite or masked points are dropped with a note; such
        colours, radii and face corners are refused.
    TypeError
        An array has the wrong dtype, or a keyword is unknown.
    MemoryError
        The arrays don't fit into memory.
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
    """Draws an image again from the scene that its file carries, as `surfel again` does. `compare` shows any
    difference.

    Parameters
    ----------
    picture : path-like
        A PNG or EXR that Surfel wrote with metadata.

    Returns
    -------
    Image

    Raises
    ------
    InputError
        The file carries no scene.
    FileNotFoundError
    """
    path = os.fspath(picture)
    native, flags = _native.Scene.of_picture(path)
    return Scene(native, [path], {name.replace("-", "_"): text for name, text in flags}).render()


def open(*paths, **flags) -> Scene:
    """Creates a scene from one scene file, or from any number of files of splats, points and meshes (docs/inputs.md).

    The first image reads the files.

    Parameters
    ----------
    *paths : path-like
        One scene file, or other files.
    columns : str or list of str, optional
        Names of a table's columns, such as "x,y,z,_,r,g,b".
    **flags
        Flags of `surfel render`, for all images of the scene. These control how files become splats: `repair`,
        `texture`, `colors`, `per_vertex`, `per_face`, `splats`, `radius_scale`, `max_points`, `cull`, `sharp`,
        `crease_angle`, `error`, `color_by`, `colormap`, `range`, `colorbar`, `crop`, `classes`, `returns`, `where`,
        `every`, `all_points`, `outliers`, `allow_outside`, `max_texture`, `columns` and `memory`.

    Returns
    -------
    Scene

    Raises
    ------
    FileNotFoundError
    TypeError
        A keyword is unknown.
    """
    _flags.texts(flags, _flags.RENDER, "open")
    if not paths:
        raise TypeError("open() needs a file's name at least")
    names = [os.fspath(path) for path in paths]
    for name in names:
        if not os.path.exists(name):
            raise FileNotFoundError(f"{name}: there is no such file")
    return Scene(_native.Scene(names, None, 0, []), names, flags)
