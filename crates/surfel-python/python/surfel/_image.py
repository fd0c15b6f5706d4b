"""Rendered images and their planes."""

from __future__ import annotations

import json
import os

from . import _native
from ._camera import Camera
from ._errors import UsageError


_PLANES = ("linear", "depth", "normal", "weight", "index", "object", "label", "position", "alpha", "median_depth",
           "distortion")


def _made(planes: dict, stats: str, recipe: str | None, name: str) -> Image:
    import numpy as np

    planes = {key: np.require(plane, requirements=["C", "A"]) for key, plane in planes.items()}
    return Image(_native.frame_of(planes, stats, recipe), name)


def joined(bands: list[Image]) -> Image:
    """Joins the tiles of one image.

    Parameters
    ----------
    bands : list of Image
        All tiles of the image, from top to bottom.
    """
    import numpy as np

    def planes(image):
        return image.__reduce__()[1][0]

    whole = {name: np.concatenate([planes(band)[name] for band in bands]) for name in planes(bands[0])}
    # Most statistics of a tile don't apply to the whole image.
    stats = {key: bands[0].stats[key] for key in ("splats", "threads", "backend")}
    stats["frame_ms"] = sum(band.stats["frame_ms"] for band in bands)
    recipe = bands[0]._native.recipe()
    if recipe is not None:
        recipe = json.loads(recipe)
        recipe["drawn"].pop("region", None)
        recipe = json.dumps(recipe)
    return _made(whole, json.dumps(stats), recipe, bands[0].name)


class Image:
    """A rendered image, with the scene and flags that it was drawn by.

    Planes are read-only NumPy arrays, with rows from the top. `numpy.array(image.depth)` is a writable copy. Reading a
    plane that wasn't requested by `planes=` raises `UsageError`. Notebooks display the image. Images can be pickled.

    Attributes
    ----------
    name : str
        Name of the camera, for images of `Scene.render_many`; otherwise empty.
    """

    def __init__(self, native, name: str = ""):
        self._native = native
        self._rgba = None
        self.name = name
        """Name of the camera, of images of `render_many`."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self._native.width, self._native.height

    def _plane(self, name: str):
        plane = getattr(self._native, name)
        if plane is None:
            wanted = "color" if name == "linear" else name
            raise UsageError(f"{name}: this plane wasn't drawn: ask for it, as in render(planes=['{wanted}'])")
        return plane

    @property
    def linear(self):
        """Linear RGBA, premultiplied by alpha: float32 of shape (height, width, 4)."""
        return self._plane("linear")

    @property
    def rgba(self):
        """Colours as in a PNG: uint8 of shape (height, width, 4). RGB is sRGB-encoded, alpha is straight."""
        self._plane("linear")
        if self._rgba is None:
            self._rgba = self._native.rgba()
        return self._rgba

    @property
    def depth(self):
        """Distance along the view direction (not along the ray), in world units: float32 of shape (height, width).

        Pixels without a surface are inf.
        """
        return self._plane("depth")

    @property
    def normal(self):
        """Unit normals in world space: float32 of shape (height, width, 3). Pixels without a surface are 0."""
        return self._plane("normal")

    @property
    def weight(self):
        """Sum of the kernel weights of the splats: float32 of shape (height, width). Pixels without a surface are 0."""
        return self._plane("weight")

    @property
    def index(self):
        """Row of the nearest splat in its file: uint32 of shape (height, width). Pixels without a surface are
        4294967295.
        """
        return self._plane("index")

    @property
    def object(self):
        """Index of the nearest object in the scene: uint32 of shape (height, width). Pixels without a surface are
        4294967295.
        """
        return self._plane("object")

    @property
    def label(self):
        """Label of the nearest splat: uint32 of shape (height, width). The flag `label=` names the attribute.

        Pixels without a surface or a label are 4294967295.
        """
        return self._plane("label")

    @property
    def position(self):
        """World position of the visible surface: float64 of shape (height, width, 3). Pixels without a surface are inf.
        """
        return self._plane("position")

    @property
    def alpha(self):
        """Opacity of trained Gaussians, from 0 to 1: float32 of shape (height, width)."""
        return self._plane("alpha")

    @property
    def median_depth(self):
        """Depth at which trained Gaussians absorb half of the light, in world units: float32 of shape (height, width).

        Pixels without Gaussians are inf.
        """
        return self._plane("median_depth")

    @property
    def distortion(self):
        """Depth distortion of trained Gaussians, as 2DGS defines it: float32 of shape (height, width)."""
        return self._plane("distortion")

    @property
    def notes(self) -> list[str]:
        """Notes that the program prints on stderr: dropped points, assumptions and estimates."""
        return self._native.notes

    @property
    def stats(self) -> dict:
        """Statistics of the frame, as `--stats` prints them.

        Keys are `frame_ms`, `passes` (milliseconds by name), `splats`, `drawn`, `bytes_per_splat`, `threads` and
        `backend`.
        """
        return json.loads(self._native.stats)

    @property
    def camera(self) -> Camera | None:
        """Camera of the image, for `Scene.render(camera=...)` of any scene. None for an image made of arrays.

        Near and far planes that were fitted to this scene are omitted.
        """
        text = self._native.camera_json()
        return None if text is None else Camera.from_dict(json.loads(text))

    @property
    def lights(self) -> list[dict] | None:
        """Lights of the image, for `Scene.render(lights=...)` of any scene. None for a single light along the view
        direction.
        """
        scene = self.scene_file
        return None if scene is None else scene.get("lights")

    @property
    def scene_file(self) -> dict | None:
        """Scene file (docs/images.md) that reproduces the image, as `--print-scene` writes it."""
        text = self._native.scene_json()
        return None if text is None else json.loads(text)

    def save(self, path, *, force: bool = False, png16: bool = False, exr_f32: bool = False, metadata: bool = True):
        """Writes the image to a file. The file appears whole or not at all.

        Parameters
        ----------
        path : path-like
            A name that ends in .png, .exr (all planes), .npz (all planes, for `numpy.load`) or .jpg.
        force : bool
            True overwrites an existing file.
        png16 : bool
            True writes 16 bits a sample to a PNG.
        exr_f32 : bool
            True writes 32-bit floats as the colours of an EXR.
        metadata : bool
            False omits the scene, which `surfel again` needs to draw a PNG or an EXR again.

        Raises
        ------
        FileExistsError
            The file exists and `force` is False.
        UsageError
            The name has another ending.
        OSError
            The file can't be written.
        MemoryError
            The encoded image doesn't fit into memory.
        """
        self._native.save(os.fspath(path), force, png16, exr_f32, metadata)

    def png(self, *, png16: bool = False, metadata: bool = True) -> bytes:
        """Encodes the image as a PNG. Paths in its scene are relative to the current folder.

        Parameters
        ----------
        png16 : bool
            True writes 16 bits a sample.
        metadata : bool
            False omits the scene.

        Returns
        -------
        bytes
        """
        self._plane("linear")
        return self._native.png(png16, metadata)

    def _repr_png_(self) -> bytes | None:
        return None if self._native.linear is None else self.png()

    def __reduce__(self):
        planes = {name: getattr(self._native, name) for name in _PLANES}
        planes = {name: plane for name, plane in planes.items() if plane is not None}
        return _made, (planes, self._native.stats, self._native.recipe(), self.name)

    def __array__(self, dtype=None, copy=None):
        """Returns `rgba`, so that matplotlib and Pillow accept an image."""
        import numpy as np

        if dtype is None and not copy:
            return self.rgba
        return np.array(self.rgba, dtype=dtype)

    def __repr__(self) -> str:
        width, height = self.size
        planes = [name.replace("linear", "color") for name in _PLANES if getattr(self._native, name) is not None]
        return f"<surfel.Image {width}x{height}: {', '.join(planes)}>"
