import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from typing_extensions import Required, Unpack

__version__: str

_Path = str | os.PathLike[str]
_Numbers = Sequence[float] | NDArray[Any]
_Plane = Literal[
    "color", "depth", "normal", "weight", "index", "object", "label", "position", "alpha", "median_depth", "distortion"
]

_CameraPath = _Path | Iterable[Camera] | Mapping[str, Any]

# Generated from the options table:
class _RenderFlags(TypedDict, total=False):
    force: bool
    label: str
    size: tuple[int, int]
    view: str | tuple[float, float]
    up: Literal["auto", "+x", "-x", "+y", "-y", "+z", "-z"]
    ortho: bool
    ortho_height: float
    fov_y: float
    eye: _Numbers
    target: _Numbers
    camera_up: _Numbers
    camera: Camera | Mapping[str, Any] | _Path
    region: tuple[int, int, int, int]
    preset: Literal["fastest", "fast", "balanced", "quality", "reference"]
    shader: Literal["unlit", "phong", "toon", "normal", "depth", "matcap", "edl"]
    shadows: bool
    light: Literal["headlight", "studio", "sky", "sun"]
    ground: Literal["none", "shadow", "plane", "grid"]
    bounce: bool
    edge_aa: bool | Literal["on", "off", "samples"]
    style: Literal["figure"]
    background: _Numbers | str
    matcap: _Path
    transparency: str
    composite: Literal["surface", "over"]
    filter: Literal["none", "clamp", "adjust", "principal", "ewa"]
    depth_tolerance: float | str
    color_by: str
    colormap: _Path
    range: _Numbers
    labels: _Path
    color: str
    colorbar: _Path
    colors: Literal["as-is", "fit"]
    texture: _Path | Literal["point", "ewa", "fit"]
    crop: _Numbers
    classes: Sequence[int] | str
    returns: Literal["last", "first", "single"]
    where: str | Sequence[str]
    every: int
    max_points: int
    all_points: bool
    outliers: Literal["keep", "drop"]
    points_as: str
    lod_error: float
    all_levels: bool
    splats: int | Literal["auto"]
    per_vertex: bool
    per_face: bool
    radius_scale: float
    cull: Literal["none", "back"]
    sharp: bool
    crease_angle: float
    error: float
    columns: str | Sequence[str | None]
    repair: bool
    allow_outside: bool
    max_texture: int
    memory: int | str
    tile: tuple[int, int] | str
    backend: Literal["auto", "cpu", "wgpu", "ash", "reference"]
    adapter: str
    threads: int
    mapping: Literal["exact", "affine"]
    cutoff: float
    prefilter: float
    accumulate: Literal["f32", "f16"]
    clip: Literal["exact", "paper", "line", "off"]
    sort: Literal["center", "pixel"]
    light_directions: int
    samples: int
    storage: Literal[16, 32, "16", "32"]

class _Convert(TypedDict, total=False):
    color_by: str
    colormap: _Path
    range: _Numbers
    labels: _Path
    colorbar: _Path
    colors: Literal["as-is", "fit"]
    texture: _Path | Literal["point", "ewa", "fit"]
    crop: _Numbers
    classes: Sequence[int] | str
    returns: Literal["last", "first", "single"]
    where: str | Sequence[str]
    every: int
    max_points: int
    all_points: bool
    outliers: Literal["keep", "drop"]
    splats: int | Literal["auto"]
    per_vertex: bool
    per_face: bool
    radius_scale: float
    cull: Literal["none", "back"]
    sharp: bool
    crease_angle: float
    error: float
    columns: str | Sequence[str | None]
    repair: bool
    allow_outside: bool
    max_texture: int
    memory: int | str
    shard: str | tuple[int, int]
    resume: bool
    threads: int

class _Ortho(TypedDict, total=False):
    gsd: Required[float]
    dsm: _Path | None
    normals: _Path | None
    bounds: _Numbers
    origin: _Numbers
    size: tuple[int, int]
    fill: float | None
    crs: str
    color_by: str
    colormap: _Path
    range: _Numbers
    labels: _Path
    colorbar: _Path
    colors: Literal["as-is", "fit"]
    texture: _Path | Literal["point", "ewa", "fit"]
    crop: _Numbers
    classes: Sequence[int] | str
    returns: Literal["last", "first", "single"]
    where: str | Sequence[str]
    every: int
    max_points: int
    all_points: bool
    outliers: Literal["keep", "drop"]
    splats: int | Literal["auto"]
    per_vertex: bool
    per_face: bool
    radius_scale: float
    sharp: bool
    crease_angle: float
    error: float
    columns: str | Sequence[str | None]
    repair: bool
    allow_outside: bool
    max_texture: int
    memory: int | str
    backend: Literal["auto", "cpu", "wgpu", "ash", "reference"]
    threads: int

class _Figure(TypedDict, total=False):
    title: str
    titles: str | Sequence[str]
    row_titles: str | Sequence[str]
    subjects: int
    wrap: int
    error_row: str | bool
    error_max: float
    annotate: str | Sequence[str]
    unit: str
    value_title: str
    no_legend: bool
    frusta: _Path
    text_at: str | Sequence[str]
    width: int | str
    size: tuple[int, int]
    dpi: float
    font_size: float
    view: str | tuple[float, float]
    up: Literal["auto", "+x", "-x", "+y", "-y", "+z", "-z"]
    ortho: bool
    ortho_height: float
    fov_y: float
    eye: _Numbers
    target: _Numbers
    camera_up: _Numbers
    camera: Camera | Mapping[str, Any] | _Path
    region: tuple[int, int, int, int]
    preset: Literal["fastest", "fast", "balanced", "quality", "reference"]
    shader: Literal["unlit", "phong", "toon", "normal", "depth", "matcap", "edl"]
    shadows: bool
    light: Literal["headlight", "studio", "sky", "sun"]
    ground: Literal["none", "shadow", "plane", "grid"]
    bounce: bool
    edge_aa: bool | Literal["on", "off", "samples"]
    style: Literal["figure"]
    background: _Numbers | str
    matcap: _Path
    transparency: str
    composite: Literal["surface", "over"]
    filter: Literal["none", "clamp", "adjust", "principal", "ewa"]
    depth_tolerance: float | str
    color_by: str
    colormap: _Path
    range: _Numbers
    labels: _Path
    color: str
    colors: Literal["as-is", "fit"]
    texture: _Path | Literal["point", "ewa", "fit"]
    crop: _Numbers
    classes: Sequence[int] | str
    returns: Literal["last", "first", "single"]
    where: str | Sequence[str]
    every: int
    max_points: int
    all_points: bool
    outliers: Literal["keep", "drop"]
    points_as: str
    lod_error: float
    all_levels: bool
    splats: int | Literal["auto"]
    per_vertex: bool
    per_face: bool
    radius_scale: float
    cull: Literal["none", "back"]
    sharp: bool
    crease_angle: float
    error: float
    columns: str | Sequence[str | None]
    repair: bool
    allow_outside: bool
    max_texture: int
    memory: int | str
    backend: Literal["auto", "cpu", "wgpu", "ash", "reference"]
    adapter: str
    threads: int
    mapping: Literal["exact", "affine"]
    cutoff: float
    prefilter: float
    accumulate: Literal["f32", "f16"]
    clip: Literal["exact", "paper", "line", "off"]
    sort: Literal["center", "pixel"]
    light_directions: int
    samples: int
    storage: Literal[16, 32, "16", "32"]

# End of what is generated.

class _Render(_RenderFlags, total=False):
    lights: Iterable[Mapping[str, Any]] | Mapping[str, Any]

class Error(Exception): ...
class UsageError(Error, ValueError): ...
class InputError(Error, ValueError): ...
class BackendError(Error, RuntimeError): ...

class Camera:
    def __init__(
        self,
        eye: _Numbers,
        target: _Numbers,
        size: tuple[int, int],
        *,
        up: _Numbers = ...,
        fov_y: float | None = ...,
        height: float | None = ...,
        focal: _Numbers | None = ...,
        principal: _Numbers | None = ...,
        near: float | None = ...,
        far: float | None = ...,
    ) -> None: ...
    @classmethod
    def from_dict(cls, camera: Mapping[str, Any]) -> Camera: ...
    @classmethod
    def from_matrices(
        cls, K: ArrayLike, world_from_camera: ArrayLike, size: tuple[int, int], *, near: float | None = ...
    ) -> Camera: ...
    @property
    def eye(self) -> tuple[float, float, float]: ...
    @property
    def target(self) -> tuple[float, float, float]: ...
    @property
    def up(self) -> tuple[float, float, float]: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def projection(self) -> dict[str, dict[str, float]]: ...
    @property
    def near(self) -> float | None: ...
    @property
    def far(self) -> float | None: ...
    @property
    def K(self) -> NDArray[np.float64] | None: ...
    @property
    def world_from_camera(self) -> NDArray[np.float64]: ...
    def to_dict(self) -> dict[str, Any]: ...
    def with_size(self, width: int, height: int) -> Camera: ...
    def __eq__(self, other: object) -> bool: ...
    def __hash__(self) -> int: ...

class Image:
    name: str
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def rgba(self) -> NDArray[np.uint8]: ...
    @property
    def linear(self) -> NDArray[np.float32]: ...
    @property
    def depth(self) -> NDArray[np.float32]: ...
    @property
    def normal(self) -> NDArray[np.float32]: ...
    @property
    def weight(self) -> NDArray[np.float32]: ...
    @property
    def index(self) -> NDArray[np.uint32]: ...
    @property
    def object(self) -> NDArray[np.uint32]: ...
    @property
    def label(self) -> NDArray[np.uint32]: ...
    @property
    def position(self) -> NDArray[np.float64]: ...
    @property
    def alpha(self) -> NDArray[np.float32]: ...
    @property
    def median_depth(self) -> NDArray[np.float32]: ...
    @property
    def distortion(self) -> NDArray[np.float32]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def stats(self) -> dict[str, Any]: ...
    @property
    def camera(self) -> Camera | None: ...
    @property
    def lights(self) -> list[dict[str, Any]] | None: ...
    @property
    def scene_file(self) -> dict[str, Any] | None: ...
    def save(
        self, path: _Path, *, force: bool = ..., png16: bool = ..., exr_f32: bool = ..., metadata: bool = ...
    ) -> None: ...
    def png(self, *, png16: bool = ..., metadata: bool = ...) -> bytes: ...
    def __array__(self, dtype: DTypeLike | None = ..., copy: bool | None = ...) -> NDArray[Any]: ...

class Figure:
    notes: list[str]
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def dpi(self) -> float: ...
    @property
    def rgba(self) -> NDArray[np.uint8]: ...
    def save(self, path: _Path, *, force: bool = ...) -> None: ...
    def png(self) -> bytes: ...
    def svg(self) -> str: ...
    def pdf(self) -> bytes: ...
    def __array__(self, dtype: DTypeLike | None = ..., copy: bool | None = ...) -> NDArray[Any]: ...

class Scene:
    def render(
        self,
        *,
        K: ArrayLike | None = ...,
        world_from_camera: ArrayLike | None = ...,
        planes: _Plane | Iterable[_Plane] | None = ...,
        **flags: Unpack[_Render],
    ) -> Image: ...
    def render_many(
        self,
        cameras: _Path | Iterable[tuple[ArrayLike, ArrayLike] | Mapping[str, Any] | Camera] | None = ...,
        *,
        frames: int | None = ...,
        path: _CameraPath | None = ...,
        planes: _Plane | Iterable[_Plane] | None = ...,
        **flags: Unpack[_Render],
    ) -> Iterator[Image]: ...
    def film(
        self,
        output: _Path,
        *,
        frames: int | None = ...,
        path: _CameraPath | None = ...,
        cameras: _Path | Iterable[tuple[ArrayLike, ArrayLike] | Mapping[str, Any] | Camera] | None = ...,
        fps: float = ...,
        **flags: Unpack[_Render],
    ) -> list[str]: ...
    def widget(self, *, height: int = ..., **flags: Unpack[_Render]) -> Any: ...
    def prepare(self, **flags: Unpack[_Render]) -> list[str]: ...
    def info(self) -> dict[str, Any]: ...
    def save(
        self, output: _Path, *, hybrid: bool = ..., ascii: bool = ..., force: bool = ..., **flags: Unpack[_Convert]
    ) -> list[str]: ...

def scene(
    points: Any,
    normals: ArrayLike | None = ...,
    colors: ArrayLike | None = ...,
    radii: ArrayLike | None = ...,
    *,
    attributes: Mapping[str, ArrayLike] | None = ...,
    faces: ArrayLike | None = ...,
    linear: bool = ...,
    **flags: Unpack[_Render],
) -> Scene: ...
def again(picture: _Path) -> Image: ...
def open(*paths: _Path, **flags: Unpack[_Render]) -> Scene: ...
def convert(
    input: _Path | Iterable[_Path] | Scene,
    output: _Path,
    *,
    hybrid: bool = ...,
    ascii: bool = ...,
    force: bool = ...,
    **flags: Unpack[_Convert],
) -> list[str]: ...
def figure(
    inputs: _Path | Iterable[Any] | Mapping[str, Any], **flags: Unpack[_Figure]
) -> Figure: ...
def film(
    inputs: _Path | Iterable[Any],
    output: _Path,
    *,
    turntable: bool = ...,
    path: _CameraPath | None = ...,
    fps: float = ...,
    **flags: Unpack[_Render],
) -> list[str]: ...
def ortho(
    inputs: _Path | Iterable[_Path] | Scene,
    output: _Path | None = ...,
    *,
    force: bool = ...,
    **flags: Unpack[_Ortho],
) -> dict[str, Any]: ...
def info(
    input: _Path | Scene, *, repair: bool = ..., allow_outside: bool = ..., max_texture: int | None = ..., columns: str | Sequence[str | None] | None = ...
) -> dict[str, Any]: ...
def compare(
    a: _Path | Image | ArrayLike, b: _Path | Image | ArrayLike, *, diff: _Path | None = ..., force: bool = ...
) -> dict[str, Any]: ...
def backends() -> list[dict[str, Any]]: ...
