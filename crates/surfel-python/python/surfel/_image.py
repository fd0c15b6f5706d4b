"""An image and its planes."""

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
    """The image of which these are all tiles, from the top."""
    import numpy as np

    def planes(image):
        return image.__reduce__()[1][0]

    whole = {name: np.concatenate([planes(band)[name] for band in bands]) for name in planes(bands[0])}
    # What a worker measured of a band says little of the whole, but for how long they took together.
    stats = {key: bands[0].stats[key] for key in ("splats", "threads", "backend")}
    stats["frame_ms"] = sum(band.stats["frame_ms"] for band in bands)
    recipe = bands[0]._native.recipe()
    if recipe is not None:
        recipe = json.loads(recipe)
        recipe["drawn"].pop("region", None)
        recipe = json.dumps(recipe)
    return _made(whole, json.dumps(stats), recipe, bands[0].name)


class Image:
    """An image that was drawn, and what it was drawn by.

    Its planes are read-only arrays of NumPy, rows from the top; `numpy.array(image.depth)` is a copy to write to. A
    plane that wasn't asked for (`planes=`) raises `UsageError`. A notebook shows the image. It can be pickled.
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
        """Colours: float32 of shape (height, width, 4), linear RGBA, premultiplied by alpha."""
        return self._plane("linear")

    @property
    def rgba(self):
        """Colours as a PNG holds them: uint8 of shape (height, width, 4), sRGB-encoded RGB and straight alpha."""
        self._plane("linear")
        if self._rgba is None:
            self._rgba = self._native.rgba()
        return self._rgba

    @property
    def depth(self):
        """Distance along the view, not along the ray: float32 of shape (height, width), world units; inf where nothing
        is."""
        return self._plane("depth")

    @property
    def normal(self):
        """Unit normals in world space: float32 of shape (height, width, 3); 0 where nothing is."""
        return self._plane("normal")

    @property
    def weight(self):
        """Sum of the splats' kernels: float32 of shape (height, width); 0 where nothing is."""
        return self._plane("weight")

    @property
    def index(self):
        """Rows of the nearest splats in their files: uint32 of shape (height, width); 4294967295 where there is none."""
        return self._plane("index")

    @property
    def object(self):
        """Numbers of the nearest objects of the scene: uint32 of shape (height, width); 4294967295 where nothing is."""
        return self._plane("object")

    @property
    def label(self):
        """Labels of the nearest splats, by the attribute `label=`: uint32 of shape (height, width); 4294967295 where
        there is none."""
        return self._plane("label")

    @property
    def position(self):
        """World positions of what is seen: float64 of shape (height, width, 3); inf where nothing is."""
        return self._plane("position")

    @property
    def alpha(self):
        """What trained Gaussians cover: float32 of shape (height, width), 0 to 1."""
        return self._plane("alpha")

    @property
    def median_depth(self):
        """Depth at which half of the light of trained Gaussians is gone: float32 of shape (height, width); inf where
        nothing is."""
        return self._plane("median_depth")

    @property
    def distortion(self):
        """How far the depths of a pixel's trained Gaussians are spread, as 2DGS measures it: float32 of shape (height,
        width)."""
        return self._plane("distortion")

    @property
    def notes(self) -> list[str]:
        """What the program would say on stderr: what was dropped, assumed or estimated."""
        return self._native.notes

    @property
    def stats(self) -> dict:
        """What `--stats` prints of a frame: `frame_ms`, `passes` (name to ms), `splats`, `drawn`, `threads`,
        `backend`."""
        return json.loads(self._native.stats)

    @property
    def camera(self) -> Camera | None:
        """The camera that the image is from, for `Scene.render(camera=...)` of any scene. Near and far planes that were
        made for this scene are left out of it. None of an image of arrays (`compare`)."""
        text = self._native.camera_json()
        return None if text is None else Camera.from_dict(json.loads(text))

    @property
    def lights(self) -> list[dict] | None:
        """The lights of the image, for `Scene.render(lights=...)` of any scene. None: one shines along the view."""
        scene = self.scene_file
        return None if scene is None else scene.get("lights")

    @property
    def scene_file(self) -> dict | None:
        """The scene file (docs/images.md) that gives this image, as `--print-scene` writes it."""
        text = self._native.scene_json()
        return None if text is None else json.loads(text)

    def save(self, path, *, force: bool = False, png16: bool = False, exr_f32: bool = False, metadata: bool = True):
        """Writes a .png, .exr (all planes), .npz (all planes, for `numpy.load`) or .jpg that appears whole or not at
        all; a .png and an .exr with the scene that it is of, so that `surfel again` repeats it.

        force: overwrites a file. png16: 16 bits a sample. exr_f32: colours as 32-bit floats. metadata: False leaves
        the scene out.

        Raises FileExistsError, UsageError (another format) and OSError.
        """
        self._native.save(os.fspath(path), force, png16, exr_f32, metadata)

    def png(self, *, png16: bool = False, metadata: bool = True) -> bytes:
        """The bytes of a PNG, paths in its scene relative to the current folder."""
        self._plane("linear")
        return self._native.png(png16, metadata)

    def _repr_png_(self) -> bytes | None:
        return None if self._native.linear is None else self.png()

    def __reduce__(self):
        planes = {name: getattr(self._native, name) for name in _PLANES}
        planes = {name: plane for name, plane in planes.items() if plane is not None}
        return _made, (planes, self._native.stats, self._native.recipe(), self.name)

    def __array__(self, dtype=None, copy=None):
        """`rgba`, so that matplotlib and Pillow take an image as it is."""
        import numpy as np

        if dtype is None and not copy:
            return self.rgba
        return np.array(self.rgba, dtype=dtype)

    def __repr__(self) -> str:
        width, height = self.size
        planes = [name.replace("linear", "color") for name in _PLANES if getattr(self._native, name) is not None]
        return f"<surfel.Image {width}x{height}: {', '.join(planes)}>"
